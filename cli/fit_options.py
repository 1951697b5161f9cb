"""The options that say how to fit and how to judge, declared once, as the library takes them."""

import math
from typing import TYPE_CHECKING, Annotated

import typer

from sysid.errors import UsageError

from . import reading

if TYPE_CHECKING:
    from sysid.estimation.assessment.findings import Policy
    from sysid.fitting.options import FitOptions

FITTING = "Fitting"
JUDGING = "Judging"
"""Panels of the help."""


def names(text: str | None) -> tuple[str, ...]:
    """``--structure arx,oe`` as names; none where the option is not given."""
    return tuple(n.strip().lower() for n in (text or "").split(",") if n.strip())


def estimation(
    focus: Annotated[
        str,
        typer.Option(
            "--focus",
            metavar="WHAT",
            rich_help_panel=FITTING,
            help="Minimise errors of prediction or of simulation.",
        ),
    ] = "prediction",
    initial: Annotated[
        str,
        typer.Option(
            "--initial",
            metavar="HOW",
            rich_help_panel=FITTING,
            help="Initial states in the fit: auto, zero, estimated or backcast.",
        ),
    ] = "auto",
    fixed: Annotated[
        list[str] | None,
        typer.Option(
            "--fix",
            metavar="NAME=VALUE",
            rich_help_panel=FITTING,
            help="Hold a parameter at a value, e.g. a1=-0.9.",
        ),
    ] = None,
    bounds: Annotated[
        list[str] | None,
        typer.Option(
            "--bound",
            metavar="NAME=LOW:HIGH",
            rich_help_panel=FITTING,
            help="Keep a parameter between bounds, e.g. a1=-1:0.",
        ),
    ] = None,
    structure_options: Annotated[
        list[str] | None,
        typer.Option(
            "--option",
            metavar="NAME=VALUE",
            rich_help_panel=FITTING,
            help="Option of the structure; `sysid structures NAME` lists them.",
        ),
    ] = None,
    robust: Annotated[
        bool,
        typer.Option("--robust", rich_help_panel=FITTING, help="Find outliers, leave them out."),
    ] = False,
    stable: Annotated[
        bool,
        typer.Option("--stable", rich_help_panel=FITTING, help="Admit only stable models."),
    ] = False,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            metavar="NAME",
            rich_help_panel=FITTING,
            help="Iterations of the search: levenberg-marquardt, gauss-newton or gradient.",
        ),
    ] = "levenberg-marquardt",
    max_evaluations: Annotated[
        int | None,
        typer.Option(
            "--max-iterations",
            metavar="N",
            min=1,
            rich_help_panel=FITTING,
            help="Longest search from one start; 200 for most structures.",
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            "--tolerance",
            metavar="X",
            rich_help_panel=FITTING,
            help="Relative change of error and step at which a search has converged, e.g. 1e-9.",
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
        typer.Option(
            "--initial-state",
            metavar="HOW",
            rich_help_panel=JUDGING,
            help="Start of the free run in the figures: estimated, measured or zero.",
        ),
    ] = "estimated",
    skip: Annotated[
        int,
        typer.Option(
            "--skip",
            metavar="N",
            min=0,
            rich_help_panel=JUDGING,
            help="Leave the first N samples out of the error figures.",
        ),
    ] = 0,
    horizons: Annotated[
        list[int] | None,
        typer.Option(
            "--horizon",
            metavar="K",
            min=2,
            rich_help_panel=JUDGING,
            help="Also show the K-step prediction. Again for more.",
        ),
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
        raise UsageError(f"--fix cannot hold {name} at {text!r}; give a finite number")
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
