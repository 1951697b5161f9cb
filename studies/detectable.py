"""Does ``sysid.diagnose`` name what it says a log would have shown?

A log of a plain machine of ``sysid_datasets.physics`` is diagnosed; each size in ``detectable`` is
a promise. Then a cause of the effect is put into the same machine, in both drives, so many times as
large (twice by default), and the log is made and diagnosed again. Sizes of causes are in units of
physics; ``WAYS`` says what they are in those of the catalogue.
"""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from sysid_datasets.physics import actuator_causes as actuator
from sysid_datasets.physics import motor_causes as motor
from sysid_datasets.physics import sensor_causes as sensor
from sysid_datasets.physics.hidden import Cause, Hidden
from sysid_datasets.physics.logs import Case, make, write
from sysid_datasets.physics.robots import Rig, figures, plain_machine

from studies.physics_diagnose import diagnose
from studies.runner import Study, finished, seeds
from sysid.report.markdown import table

STUDY = Study("detectable", "detectable.md", runs=3)

STYLES, NOISES = ("steps", "joystick", "multisine"), (0.005, 0.01, 0.02)
DRAWS = 200
"""Causes drawn until one has both drives."""

WAVE = np.sqrt(2.0)
"""Size of a wave over that of its cosine, with a sine as large."""


@dataclass(frozen=True)
class Way:
    """How a promise becomes a cause.

    Attributes:
        cause: puts it into a rig.
        drawn: (sizes of the cause, free speed) → severity in the catalogue's unit.
        promised: stated size → the same severity.
    """

    cause: Cause
    drawn: Callable[[Mapping[str, float], float], float]
    promised: Callable[[float], float] = float


WAYS = {
    "dead-zone": Way(actuator.switches_that_turn_on_late, lambda z, k: z["duty"]),
    "input-saturation": Way(actuator.largest_duty, lambda z, k: 1.0 - z["duty"], lambda v: 1.0 - v),
    "input-delay": Way(actuator.late_command, lambda z, k: z["delay_s"]),
    "actuator-lag": Way(actuator.soft_start, lambda z, k: z["time_s"]),
    "dead-time": Way(actuator.dead_time, lambda z, k: z["share"]),
    "backlash": Way(motor.gap, lambda z, k: z["gap_rad"]),
    "coulomb-friction": Way(motor.coulomb, lambda z, k: z["share_of_stall"] * k),
    "quadratic-drag": Way(motor.fan, lambda z, k: z["share_of_stall_at_free_speed"] / k),
    "load-bias": Way(motor.constant_load, lambda z, k: abs(z["share_of_stall"]) * k),
    "gravity-load": Way(motor.unbalanced, lambda z, k: z["share_of_stall"] * k, lambda v: WAVE * v),
    "speed-ripple": Way(
        motor.eccentric_gear, lambda z, k: 0.5 * z["share"] * k, lambda v: WAVE * v
    ),
    "quantisation": Way(sensor.coarse_ticks, lambda z, k: z["quantum_rad_s"]),
    "dropouts": Way(sensor.lost_lines, lambda z, k: z["share"]),
}


def plain(seed: int) -> Case:
    """A machine in which nothing is hidden."""
    rig = Rig(plain_machine(np.random.default_rng([9, seed])))
    style, sigma = STYLES[seed % len(STYLES)], NOISES[seed // len(STYLES) % len(NOISES)]
    return Case("detectable", seed, rig, style=style, sigma=sigma, duration=100.0)


def planted(base: Case, way: Way, severity: float) -> tuple[Case, Hidden]:
    """The same machine with a cause of a given severity in both drives."""
    free, factor = figures(base.rig.machine).speed, 1.0
    draw = next(
        k
        for k in range(DRAWS)
        if len(way.cause(np.random.default_rng(k), base.rig, 1.0)[1].channels) == 2
    )
    for _ in range(4):  # most sizes are in proportion to the factor, some are rounded
        _, hidden = way.cause(np.random.default_rng(draw), base.rig, factor)
        factor *= severity / max(way.drawn(hidden.sizes, free), 1e-9)
    rig, hidden = way.cause(np.random.default_rng(draw), base.rig, factor)
    return replace(base, rig=rig, hidden=(hidden,)), hidden


def answered(case: Case) -> dict[str, Any]:
    """What a diagnosis says of both logs of a case."""
    with tempfile.TemporaryDirectory() as folder:
        write(make(case), Path(folder))
        return diagnose(Path(folder) / "est.csv", Path(folder) / "val.csv", None)


def of_machine(seed: int, times: float) -> list[dict[str, Any]]:
    """All promises of one machine and whether they are kept."""
    base = plain(seed)
    promised, found = answered(base)["detectable"], []
    for id, way in WAYS.items():
        size = promised.get(id)
        run = {"seed": seed, "id": id, "stated": size, "kept": None, "said": []}
        if size is not None:
            case, hidden = planted(base, way, times * way.promised(size))
            entries = [(e["id"], *e["indistinguishable"]) for e in answered(case)["effects"]]
            run["kept"] = any({id, *hidden.also} & set(e) for e in entries)
            run["said"] = ["=".join(e) for e in entries]
        found.append(run)
    return found


def report(runs: Sequence[Mapping[str, Any]], times: float) -> str:
    """The page."""
    kept = [r for r in runs if r["kept"]]
    asked = [r for r in runs if r["kept"] is not None]
    rows = []
    for id in WAYS:
        mine = [r for r in runs if r["id"] == id]
        told = [r for r in mine if r["kept"] is not None]
        sizes = ", ".join("–" if r["stated"] is None else f"{r['stated']:.3g}" for r in mine)
        missed = "; ".join(", ".join(r["said"]) or "no name" for r in told if not r["kept"])
        rows.append([f"`{id}`", sizes, f"{sum(r['kept'] for r in told)}/{len(told)}", missed])
    share = 100.0 * len(kept) / max(len(asked), 1)
    page = HEAD.format(
        times=times,
        kept=len(kept),
        asked=len(asked),
        share=share,
    )
    return page + table(["effect", "stated", "named", "else"], rows, "llrl") + "\n"


def main() -> None:
    """Run the study and write its report."""
    parser = STUDY.parser(__doc__)
    parser.add_argument("--times", type=float, default=2.0, help="of the stated size")
    asked = parser.parse_args()
    wanted = {f"{seed}/{asked.times:g}": (seed, asked.times) for seed in seeds(asked)}
    runs = [run for machine in finished(of_machine, wanted, asked).values() for run in machine]
    STUDY.write(asked, report(runs, asked.times))


HEAD = """# Does a log show what `sysid.diagnose` says that it would show?

On logs of plain machines simulated from physics (`datasets/physics`; steps, joystick, multisine),
`detectable` states the smallest size of each effect that would have been found. A cause of
{times:g} times that size is then put into the same machine. Its right name came in {kept} of
{asked} ({share:.1f} %). *Stated*: a machine each, – where no size shows there; *else*: what was
said where the right name did not come.

"""

if __name__ == "__main__":
    main()
