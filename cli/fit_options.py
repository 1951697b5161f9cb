"""Options of fitting and validation, declared once, as the library takes them."""

import math
from typing import TYPE_CHECKING, Annotated

from sysid.errors import UsageError

from . import reading

if TYPE_CHECKING:
    from sysid.estimation.assessment.findings import Policy
    from sysid.fitting.options import FitOptions

fitting_option, judging_option = reading.in_panel("Fitting"), reading.in_panel("Judging")


def names(text: str | None) -> tuple[str, ...]:
    """``--structure arx,oe`` as names; none where the option is not given."""
    return tuple(n.strip().lower() for n in (text or "").split(",") if n.strip())


def estimation(
    focus: Annotated[
        str,
        fitting_option("--focus", "WHAT", "Minimise prediction or simulation errors."),
    ] = "prediction",
    initial: Annotated[
        str,
        fitting_option(
            "--initial", "HOW", "Initial states in the fit: auto, zero, estimated or backcast."
        ),
    ] = "auto",
    fixed: Annotated[
        list[str] | None,
        fitting_option("--fix", "NAME=VALUE", "Fix a parameter at a value, e.g. a1=-0.9."),
    ] = None,
    bounds: Annotated[
        list[str] | None,
        fitting_option(
            "--bound", "NAME=LOW:HIGH", "Keep a parameter between bounds, e.g. a1=-1:0."
        ),
    ] = None,
    structure_options: Annotated[
        list[str] | None,
        fitting_option(
            "--option", "NAME=VALUE", "Option of the structure; `sysid structures NAME` lists them."
        ),
    ] = None,
    robust: Annotated[
        bool,
        fitting_option("--robust", None, "Detect outliers and leave them out."),
    ] = False,
    stable: Annotated[
        bool,
        fitting_option("--stable", None, "Restrict the search to stable models."),
    ] = False,
    method: Annotated[
        str,
        fitting_option(
            "--method",
            "NAME",
            "Search direction: levenberg-marquardt, gauss-newton or gradient.",
        ),
    ] = "levenberg-marquardt",
    max_evaluations: Annotated[
        int | None,
        fitting_option(
            "--max-iterations",
            "N",
            "Most iterations from one start; 200 for most structures.",
            min=1,
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        fitting_option(
            "--tolerance",
            "X",
            "Relative change of cost and step at convergence, e.g. 1e-9.",
        ),
    ] = None,
) -> "FitOptions":
    """How to fit, as every option of it says.

    Raises:
        UsageError: an option cannot be read.
    """
    from sysid.fitting.marquardt import Method
    from sysid.fitting.options import FitOptions
    from sysid.fitting.problem import Focus, Initial

    if tolerance is not None and not 0.0 < tolerance < 1.0:
        raise UsageError(f"--tolerance is a relative change between 0 and 1, got {tolerance:g}")
    return FitOptions(
        focus=Focus(reading.choice(focus, [f.value for f in Focus], "--focus")),
        initial=Initial(reading.choice(initial, [i.value for i in Initial], "--initial")),
        robust=robust,
        stable=stable,
        fixed=dict(_fixed(item) for item in fixed or []),
        bounds=dict(_bounded(item) for item in bounds or []),
        max_evaluations=max_evaluations,
        tolerance=tolerance,
        method=Method(reading.choice(method, [m.value for m in Method], "--method")),
        structure_options=dict(
            _pair(item, "--option", "units=20") for item in structure_options or []
        ),
    )


def judging(
    start: Annotated[
        str,
        judging_option(
            "--initial-state",
            "HOW",
            "Initial state of the free run: estimated, measured or zero.",
        ),
    ] = "estimated",
    skip: Annotated[
        int,
        judging_option("--skip", "N", "Leave the first N samples out of the error figures.", min=0),
    ] = 0,
    horizons: Annotated[
        list[int] | None,
        judging_option("--horizon", "K", "Also show the K-step prediction; repeatable.", min=2),
    ] = None,
) -> "Policy":
    """How figures are made.

    Raises:
        UsageError: there is no such initial state.
    """
    from sysid.estimation.assessment.figures import Start
    from sysid.estimation.assessment.findings import Policy

    chosen = reading.choice(start, [s.value for s in Start], "--initial-state")
    return Policy(Start(chosen), skip, tuple(sorted(set(horizons or []))))


def _fixed(item: str) -> tuple[str, float]:
    name, text = _pair(item, "--fix", "a1=-0.9")
    value = _number(text, item, "--fix")
    if math.isinf(value):
        raise UsageError(f"--fix cannot fix {name} at {text!r}; give a finite number")
    return name, value


def _bounded(item: str) -> tuple[str, tuple[float, float]]:
    name, text = _pair(item, "--bound", "a1=-1:0")
    low, sign, high = text.partition(":")
    if not sign:
        raise UsageError(f"--bound cannot read {item!r}; write NAME=LOW:HIGH such as a1=-1:0")
    return name, (_number(low, item, "--bound"), _number(high, item, "--bound"))


def _pair(item: str, option: str, example: str) -> tuple[str, str]:
    name, sign, value = (part.strip() for part in item.partition("="))
    if not (name and sign and value):
        raise UsageError(f"{option} cannot read {item!r}; write it like {example}")
    return name, value


def _number(text: str, item: str, option: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise UsageError(f"{option} cannot read {item!r}: {text!r} is not a number")
    return value
