"""``sysid bench pendulum``: the inertia of a body from its swing on a bar."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.errors import UsageError

from .. import reading, render, targets

if TYPE_CHECKING:
    from sysid.data.reading.read_options import ReadOptions
    from sysid.testbench.pendulum.inertia import Hanging
    from sysid.testbench.pendulum.study import PendulumStudy

_hanging = reading.in_panel("The suspended body [the thesis's robot]")


def hanging(
    m: Annotated[float | None, _hanging("--m", "KG", "Mass of the body.")] = None,
    l: Annotated[  # noqa: E741  the thesis's letter
        float | None, _hanging("--l", "M", "Distance of its centre of gravity from the hinge.")
    ] = None,
    m1: Annotated[float | None, _hanging("--m1", "KG", "Mass of the bar.")] = None,
    l1: Annotated[
        float | None,
        _hanging("--l1", "M", "Distance of the bar's centre of gravity from the hinge."),
    ] = None,
    I1: Annotated[float | None, _hanging("--I1", "KG_M2", "The bar's own inertia.")] = None,
    g: Annotated[float | None, _hanging("--g", "M_S2", "Acceleration of gravity.")] = None,
    errors: Annotated[
        list[str] | None,
        _hanging(
            "--std-error",
            "NAME=VALUE",
            "Standard error of one of these or of the period: l=0.002; repeat (or a,b) for more "
            "[1 mm, 1 g, 1e-4 kg m², 0.005 m/s², 5 ms].",
        ),
    ] = None,
) -> "tuple[Hanging, float | None]":
    """What hangs and the period's own error, as the library takes them.

    Raises:
        UsageError: a number cannot be.
    """
    from sysid.testbench.pendulum.inertia import Hanging

    given = {"m": m, "l": l, "m1": m1, "l1": l1, "I1": I1, "g": g}
    stated = _std_errors(errors or [])
    period = stated.pop("period", None)
    letters = {name: value for name, value in given.items() if value is not None}
    return Hanging(**letters, errors=stated), period


def _std_errors(given: list[str]) -> dict[str, float]:
    errors: dict[str, float] = {}
    for pair in (p for item in given for p in item.split(",")):
        name, sign, number = (part.strip() for part in pair.partition("="))
        try:
            errors[name] = float(number)
        except ValueError:
            sign = ""
        if not sign:
            raise UsageError(f"--std-error cannot read {pair!r}; write NAME=VALUE such as l=0.002")
    return errors


def swing_options(
    outputs: Annotated[
        str | None,
        reading.in_panel("Reading the log")(
            "--output", "NAME", "Column of the angle [found by name]."
        ),
    ] = None,
    time: reading.Time = None,
    ts: reading.SampleTime = None,
    units: reading.Units = None,
    delimiter: reading.Delimiter = None,
    decimal: reading.Decimal = None,
    map: reading.Map = None,
    stamps: reading.Stamps = "auto",
    latency: reading.Latency = None,
) -> "ReadOptions":
    """The options of reading that a swing needs."""
    return reading.read_options(
        outputs=[outputs] if outputs else None,
        time=time,
        ts=ts,
        units=units,
        delimiter=delimiter,
        decimal=decimal,
        map=map,
        stamps=stamps,
        latency=latency,
    )


@reading.composed(body=hanging, read=swing_options)
def pendulum(
    logs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[LOG...]",
            help="CSV, Parquet or bag: time and angle, quaternion or position; several together.",
        ),
    ] = None,
    period: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="The period, where there is no log.")
    ] = None,
    amplitude: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Amplitude that belongs to --period [10]."),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            metavar="LxW",
            help="Length and width of the body in m, to compare J with a box of its mass.",
        ),
    ] = None,
    *,
    body: "tuple[Hanging, float | None]",
    trim: reading.Trim = None,
    read: "ReadOptions",
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw swing, fit and periods: .svg, .png.")
    ] = None,
    json: reading.Json = False,
) -> None:
    """Inertia of a robot from its free swing on a bar (thesis 2.51, 5.7), with its error.

    Each log is fitted with a fading swing; periods counted without a model check it. Give a log,
    or the period that was read off one.
    """
    targets.check_picture(plot)
    study = _study(logs or [], period, amplitude, size, body, trim, read)
    facts = study.summary()
    if plot is not None:
        if not study.logs:
            raise UsageError("--plot draws the swing of a log; omit it with --period")
        from .pictures import draw_swing

        draw_swing(plot, study)
        facts["plot"] = plot
    render.document(facts) if json else _show(study, facts)


def _study(
    logs: list[Path],
    period: float | None,
    amplitude: float | None,
    size: str | None,
    body: "tuple[Hanging, float | None]",
    trim: str | None,
    read: "ReadOptions",
) -> "PendulumStudy":
    from sysid.testbench.pendulum import study

    what, error = body
    box = None if size is None else _lengths(size)
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
    for option, value in (("--amplitude", amplitude), ("--std-error period", error)):
        if value is not None:
            raise UsageError(f"{option} belongs to --period; a log already contains it")
    seconds = reading.seconds_to_trim(trim) if trim is not None else (0.0, 0.0)
    return study.inertia_of_logs(logs, what, read, trim=seconds, size=box)


def _lengths(text: str) -> tuple[float, float]:
    try:
        a, b = (float(part) for part in text.lower().replace("×", "x").split("x"))
    except ValueError:
        raise UsageError(f"--size cannot read {text!r}; write LxW in m, e.g. 0.19x0.134") from None
    return a, b


def _show(study: "PendulumStudy", facts: dict[str, Any]) -> None:
    if study.logs:
        rows = [_row(log) for log in facts["logs"]]
        render.table(_HEADINGS, rows, caption="s; counted: from passages through the middle")
    render.table(
        ("", "value", "std. error", "unit"),
        [
            ("period", f"{study.period:.6g}", study.period_std_error, "s"),
            ("period of small swings", f"{study.small_period:.6g}", study.small_std_error, "s"),
            ("inertia, period as it is", study.inertia, study.std_error, "kg m²"),
            ("inertia, amplitude taken out", study.corrected, study.corrected_std_error, "kg m²"),
        ],
    )
    named = {"period": study.period_std_error} | {
        n: h["std_error"] for n, h in facts["hanging"].items()
    }
    render.table(
        ("quantity", "std. error", "dJ/dq", "moves J by [kg m²]"),
        [
            (name, named[name], facts["sensitivities"][name], part)
            for name, part in facts["contributions_kg_m2"].items()
        ],
    )
    for sentence in facts["sentences"]:
        render.say(sentence)
    render.findings(study.findings)
    if "plot" in facts:
        render.say(f"Picture: {facts['plot']}")


_HEADINGS = ("log", "period", "std. error", "counted", "T₀", "amplitude [°]", "damping", "periods")


def _row(log: dict[str, Any]) -> tuple[object, ...]:
    swing = log["amplitude_deg"]
    return (
        log["name"],
        f"{log['period_s']:.6f}",
        log["period_std_error"],
        f"{log['counted']['passages']['period_s']:.6f}",
        f"{log['small_swing_period_s']:.6f}",
        f"{swing['first']:.3g} … {swing['last']:.3g}",
        f"{log['damping_ratio']:.2g}",
        f"{log['periods']:.1f}",
    )
