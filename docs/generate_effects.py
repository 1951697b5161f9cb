"""Write ``docs/effects.md`` from the catalogue itself: python docs/generate_effects.py.

A test fails when the page is stale.
"""

from pathlib import Path

from sysid.effects.base import Effect
from sysid.effects.catalogue import CHANGED, catalogue
from sysid.report.markdown import table

PAGE = Path(__file__).resolve().parent / "effects.md"

HEAD = """# The catalogue of effects

Written by `python docs/generate_effects.py` from the catalogue itself: do not edit.

What `sysid diagnose` can select and add. Each track obeys τ ω̇ = T − ω with T = K d; d is the
command in units of full drive, so that torques count in units of the speed they hold. An effect
changes one place of that chain and does nothing at its null value. The order is: command, torque
of the drive (supply, bridge, winding), loads from outside (weights, slopes, the other track),
friction, speed, measurement; a weight does not fade with the winding, and friction holds what is
lighter than itself ([0034](decisions/0034-friction-comes-last.md)). Units: `drive` is a share of
full drive, `speed` the unit of the output, `1` a pure number. *Ties*: effects that many logs
cannot distinguish from it. *Undone*: a mission can compensate it (`control.compensate`, see
[control.md](control.md#compensating-identified-effects)).
"""

HEADER = ["effect", "equation", "parameters", "what it is, what it looks like", "ties", "undone"]

STAGES = {
    "actuator": "between command and torque",
    "motor": "motor, gear and load",
    "vehicle": "between tracks and ground; needs x, y and psi in the log",
    "sensor": "between speed and reading",
    "any": "of a given model",
}

SAMPLES = """## In the samples themselves

`quantisation` (measurements on a grid), `held-telemetry` (a sensor slower than the log, whose
measurements repeat until the next one) and `dropouts` (measurements lost, repeated or zero) are
visible in the samples. They are reported and masked, not added to the model.
"""

OWN = """Effects of your own: [diagnose.md](diagnose.md#an-effect-of-your-own).
"""


def page() -> str:
    """The text of ``effects.md``."""
    effects = [*catalogue().values(), CHANGED]
    parts = [HEAD]
    for stage, where in STAGES.items():
        of_stage = [e for e in effects if e.stage == stage]
        parts.append(f"## {stage.capitalize()}: {where}\n")
        parts.append(table(HEADER, [_row(e) for e in of_stage]))
        parts.append("To show it:\n")
        parts.append("\n".join(f"- `{e.id}`: {e.texts.experiment}" for e in of_stage) + "\n")
    return "\n".join([*parts, SAMPLES, OWN])


def _row(e: Effect) -> list[str]:
    parameters = ", ".join(f"`{p.name}` [{p.unit or '1'}]" for p in e.parameters)
    ties = ", ".join(f"`{id}`" for id in e.hints.ties)
    undone = "yes" if e.inverse else ""
    return [
        f"`{e.id}`",
        e.texts.equation,
        parameters,
        " ".join(
            [
                e.texts.sentence,
                *(law.sentence for law in e.laws if law.sentence),
                e.texts.looks_like,
            ]
        ),
        ties,
        undone,
    ]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
