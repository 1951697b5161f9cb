"""``sysid bench pendulum``: the inertia of a body from its swing on a bar."""

import math
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError

from .. import reading, render, targets
from ..options import argument, changed, command, group, in_panel, numbers, option, pairs

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.testbench.pendulum.inertia import Hanging
    from sysid.testbench.pendulum.study import PendulumStudy

_hanging = in_panel("The suspended body [the thesis's robot]", advanced=True)


@dataclass(frozen=True)
class Hung:
    """What hangs, and the errors of its numbers."""

    m: float | None = _hanging("KG", "Mass of the body.")
    l: float | None = _hanging(  # noqa: E741  the thesis's letter
        "M", "Distance of its centre of gravity from the hinge."
    )
    m1: float | None = _hanging("KG", "Mass of the bar.")
    l1: float | None = _hanging("M", "Distance of the bar's centre of gravity from the hinge.")
    I1: float | None = _hanging("KG_M2", "The bar's own inertia.")
    g: float | None = _hanging("M_S2", "Acceleration of gravity.")
    errors: list[str] | None = _hanging(
        "NAME=VALUE",
        "Standard error of one of these or of the period; l=0.002, repeat (or a,b) for more "
        "[1 mm, 1 g, 1e-4 kg m², 0.005 m/s², 5 ms].",
        "--std-error",
        parse=partial(pairs, option="--std-error", advice="NAME=VALUE such as l=0.002", read=float),
    )

    def made(self) -> "tuple[Hanging, float | None]":
        """What hangs and the period's own error, as the library takes them."""
        from sysid.testbench.pendulum.inertia import Hanging

        given = changed(self)
        stated = given.pop("errors", {})
        period = stated.pop("period", None)
        return Hanging(**given, errors=stated), period


@command
def pendulum(
    logs: list[Path] | None = argument(
        "[LOG...]",
        "CSV, Parquet or bag: time and angle, quaternion or position; several together.",
        default=None,
    ),
    period: float | None = option("SECONDS", "The period, where there is no log."),
    amplitude: float | None = option("DEG", "Amplitude of the swing of --period [10].", "--swing"),
    size: str | None = option(
        "LxW", "Length and width of the body in m, to compare J with a box of its mass."
    ),
    body: "tuple[Hanging, float | None]" = group(Hung),
    steps: "Preparation" = group(reading.Preparing, "trim"),
    outputs: str | None = in_panel("Reading the log")(
        "NAME", "Column of the angle [found by name].", "-y", "--output"
    ),
    read: "ReadOptions" = group(
        reading.Reading, "time", "ts", "units", "delimiter", "decimal", "map", "stamps", "latency"
    ),
    plot: Path | None = targets.picture("Draw swing, fit and periods: .svg, .png."),
    json: bool = reading.JSON,
) -> None:
    """Find the inertia of a robot from its free swing on a bar.

    Each log is fitted with a fading swing; periods counted without a model check it. Give a log,
    or the period that was read off one.
    """
    read = replace(read, outputs=(outputs,) if outputs else ())
    study = _study(logs or [], period, amplitude, size, body, steps, read)
    facts = study.summary()
    if plot is not None:
        if not study.logs:
            raise UsageError("--plot draws the swing of a log; omit it with --period")
        from sysid.report.bench import draw_swing

        draw_swing(plot, study)
        facts["plot"] = plot
    render.document(facts) if json else _show(study, facts)


def _study(
    logs: list[Path],
    period: float | None,
    amplitude: float | None,
    size: str | None,
    body: "tuple[Hanging, float | None]",
    steps: "Preparation",
    read: "ReadOptions",
) -> "PendulumStudy":
    from sysid.testbench.pendulum import study

    what, error = body
    box = None
    if size is not None:
        each = size.lower().replace("×", "x")
        length, width = numbers(each, "--size", "LxW in m, e.g. 0.19x0.134", "x", 2)
        box = length, width
    if (period is None) == (not logs):
        raise UsageError("give either a log of the swing or its period with --period")
    if period is not None:
        return study.inertia_of_period(
            period,
            what,
            std_error=study.RESOLUTION if error is None else error,
            amplitude=study.AMPLITUDE if amplitude is None else math.radians(amplitude),
            size=box,
        )
    for name, value in (("--swing", amplitude), ("--std-error period", error)):
        if value is not None:
            raise UsageError(f"{name} belongs to --period; a log already contains it")
    seconds = steps.trim_start, steps.trim_end
    return study.inertia_of_logs(logs, what, read, trim=seconds, size=box)


def _show(study: "PendulumStudy", facts: dict[str, Any]) -> None:
    if study.logs:
        rows = [_row(log) for log in facts["logs"]]
        render.table(_HEADINGS, rows, caption="s; counted: from passages through the middle")
    render.table(
        ("", "value", "± 95 %", "unit"),
        [
            ("period", f"{study.period:.6g}", render.reach(study.period_std_error), "s"),
            ("period of small swings", f"{study.small_period:.6g}",
             render.reach(study.small_std_error), "s"),
            ("inertia, period as it is", study.inertia, render.reach(study.std_error), "kg m²"),
            ("inertia, amplitude taken out", study.corrected,
             render.reach(study.corrected_std_error), "kg m²"),
        ],
    )  # fmt: skip
    named = {"period": study.period_std_error} | {
        n: h["std_error"] for n, h in facts["hanging"].items()
    }
    render.table(
        ("quantity", "± 95 %", "dJ/dq", "moves J by [kg m²]"),
        [
            (name, render.reach(named[name]), facts["sensitivities"][name], render.reach(part, 3))
            for name, part in facts["contributions_kg_m2"].items()
        ],
    )
    for sentence in facts["sentences"]:
        render.say(sentence)
    render.findings(study.findings)
    render.files(facts, plot="Picture")


_HEADINGS = ("log", "period", "± 95 %", "counted", "T₀", "amplitude [°]", "damping", "periods")


def _row(log: dict[str, Any]) -> tuple[object, ...]:
    swing = log["amplitude_deg"]
    return (
        log["name"],
        f"{log['period_s']:.6f}",
        render.reach(log["period_std_error"]),
        f"{log['counted']['passages']['period_s']:.6f}",
        f"{log['small_swing_period_s']:.6f}",
        f"{swing['first']:.3g} … {swing['last']:.3g}",
        f"{log['damping_ratio']:.2g}",
        f"{log['periods']:.1f}",
    )
