"""``sysid fit``: models of a log, judged, ranked and kept in the workspace."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.errors import UsageError

from . import reading, render
from .fit_report import show
from .workspace import StoredModel, Workspace

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.read_options import ReadOptions
    from sysid.data.record import Record
    from sysid.estimation.identify import Identification, Request

_FITTING = "Fitting"
_JUDGING = "Judging"


def fit(
    logs: reading.Logs,
    structure: Annotated[
        str | None,
        typer.Option(
            "--structure",
            metavar="NAME",
            rich_help_panel=_FITTING,
            help="arx, armax, oe, bj …; several as a,b. All that apply unless given.",
        ),
    ] = None,
    orders: Annotated[
        str | None,
        typer.Option(
            "--orders",
            metavar="TEXT",
            rich_help_panel=_FITTING,
            help='"na=2 nb=2 nk=1", matrices "na=1,0;0,1", ranges "na=1:4". Searched unless given.',
        ),
    ] = None,
    val: Annotated[
        list[Path] | None,
        typer.Option(
            "--val",
            metavar="LOG",
            rich_help_panel=_JUDGING,
            help="Log to judge on; never used to choose anything. Again for more.",
        ),
    ] = None,
    split: Annotated[
        float | None,
        typer.Option(
            "--split",
            metavar="SHARE",
            rich_help_panel=_JUDGING,
            help="Fit on this share of each log, judge on the rest, e.g. 0.7.",
        ),
    ] = None,
    focus: Annotated[
        str,
        typer.Option(
            "--focus",
            metavar="WHAT",
            rich_help_panel=_FITTING,
            help="Minimise errors of prediction or of simulation.",
        ),
    ] = "prediction",
    criteria: Annotated[
        str,
        typer.Option(
            "--criteria",
            metavar="NAME",
            rich_help_panel=_FITTING,
            help="What ranks orders and structures: fit, aic, bic, fpe …",
        ),
    ] = "fit",
    detrend: Annotated[
        str,
        typer.Option(
            "--detrend",
            metavar="HOW",
            rich_help_panel=_FITTING,
            help="auto, none, mean or linear; what is removed is stored and re-applied.",
        ),
    ] = "auto",
    initial: Annotated[
        str,
        typer.Option(
            "--initial",
            metavar="HOW",
            rich_help_panel=_FITTING,
            help="Initial states in the fit: auto, zero, estimated or backcast.",
        ),
    ] = "auto",
    fix: Annotated[
        list[str] | None,
        typer.Option(
            "--fix",
            metavar="NAME=VALUE",
            rich_help_panel=_FITTING,
            help="Hold a parameter at a value, e.g. a1=-0.9.",
        ),
    ] = None,
    bound: Annotated[
        list[str] | None,
        typer.Option(
            "--bound",
            metavar="NAME=LOW:HIGH",
            rich_help_panel=_FITTING,
            help="Keep a parameter between bounds, e.g. a1=-1:0.",
        ),
    ] = None,
    option: Annotated[
        list[str] | None,
        typer.Option(
            "--option",
            metavar="NAME=VALUE",
            rich_help_panel=_FITTING,
            help="Option of the structure; `sysid structures NAME` lists them.",
        ),
    ] = None,
    trim: reading.Trim = None,
    low_pass: reading.LowPass = None,
    decimate: reading.Decimate = 1,
    robust: Annotated[
        bool,
        typer.Option("--robust", rich_help_panel=_FITTING, help="Huber loss: outliers count less."),
    ] = False,
    stable: Annotated[
        bool,
        typer.Option("--stable", rich_help_panel=_FITTING, help="Admit only stable models."),
    ] = False,
    initial_state: Annotated[
        str,
        typer.Option(
            "--initial-state",
            metavar="HOW",
            rich_help_panel=_JUDGING,
            help="Start of the free run in the figures: estimated, measured or zero.",
        ),
    ] = "estimated",
    skip: Annotated[
        int,
        typer.Option(
            "--skip",
            metavar="N",
            min=0,
            rich_help_panel=_JUDGING,
            help="Leave the first N samples out of the error figures.",
        ),
    ] = 0,
    horizon: Annotated[
        list[int] | None,
        typer.Option(
            "--horizon",
            metavar="K",
            min=2,
            rich_help_panel=_JUDGING,
            help="Also show the K-step prediction. Again for more.",
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw the best model: .svg or .png."),
    ] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", metavar="N", min=1, help="Processes for the search.")
    ] = 2,
    inputs: reading.Inputs = None,
    outputs: reading.Outputs = None,
    time: reading.Time = None,
    ts: reading.SampleTime = None,
    units: reading.Units = None,
    pwm_max: reading.PwmMax = None,
    delimiter: reading.Delimiter = None,
    decimal: reading.Decimal = None,
    resample: reading.Resample = "auto",
    workspace: reading.WorkspaceRoot = reading.DEFAULT_WORKSPACE,
    json: reading.Json = False,
) -> None:
    """Fit models to a log, judge them, and keep them in the workspace.

    Without --structure every structure that applies is fitted with a small order search, and the
    one that is ahead in free run on a held-out part of the estimation data comes first.
    """
    from sysid.report.plots import picture_format

    if plot is not None:
        picture_format(plot)
    read = reading.read_options(
        inputs, outputs, time, ts, units, pwm_max, delimiter, decimal, resample
    )
    steps = reading.preparation(trim, low_pass, decimate)
    request = _request(
        structure,
        orders,
        focus,
        criteria,
        detrend,
        initial,
        fix,
        bound,
        option,
        robust,
        stable,
        initial_state,
        skip,
        horizon,
        split,
        jobs,
        read,
        steps,
        logs,
    )
    found = _identify(logs, val or [], read, steps, request)
    place = Workspace(workspace)
    stored = [place.save(a.model, a.to_json()) for a in reversed(found.assessments)][::-1]
    place.remember("latest", [s.id for s in stored])
    if plot is not None:
        from .pictures import draw_fit

        draw_fit(plot, stored[0].id, found)
    _document(stored, found) if json else show(stored, found, plot)


def _request(
    structure: str | None,
    orders: str | None,
    focus: str,
    criteria: str,
    detrend: str,
    initial: str,
    fix: list[str] | None,
    bound: list[str] | None,
    option: list[str] | None,
    robust: bool,
    stable: bool,
    initial_state: str,
    skip: int,
    horizon: list[int] | None,
    split: float | None,
    jobs: int,
    read: "ReadOptions",
    steps: "Preparation",
    logs: list[Path],
) -> "Request":
    """The options as the library takes them."""
    from sysid.estimation.assessment import Policy
    from sysid.estimation.figures import Start
    from sysid.estimation.identify import Request
    from sysid.estimation.search import FitOptions
    from sysid.structures.base import Focus, Initial

    fixed = {}
    for item in fix or []:
        name, value = _pair(item, "--fix", "a1=-0.9")
        fixed[name] = _number(value, item, "--fix")
        if math.isinf(fixed[name]):
            raise UsageError(f"--fix cannot hold {name} at {value!r}; give a finite number")
    bounds = {}
    for item in bound or []:
        name, value = _pair(item, "--bound", "a1=-1:0")
        low, sign, high = value.partition(":")
        if not sign:
            raise UsageError(f"--bound cannot read {item!r}; write NAME=LOW:HIGH such as a1=-1:0")
        bounds[name] = (_number(low, item, "--bound"), _number(high, item, "--bound"))
    options = FitOptions(
        focus=Focus(reading.choice(focus, [f.value for f in Focus], "--focus")),
        initial=Initial(reading.choice(initial, [i.value for i in Initial], "--initial")),
        robust=robust,
        stable=stable,
        fixed=fixed,
        bounds=bounds,
        structure_options=dict(_pair(item, "--option", "units=20") for item in option or []),
        extra={
            "files": [str(p.resolve()) for p in logs],
            "read": read.to_json(),
            "prepare": steps.to_json(),
        },
    )
    start = Start(reading.choice(initial_state, [s.value for s in Start], "--initial-state"))
    names = tuple(n.strip().lower() for n in (structure or "").split(",") if n.strip())
    policy = Policy(start, skip, tuple(sorted(set(horizon or []))))
    return Request(names, orders, options, detrend, criteria, split, policy, jobs)


def _pair(item: str, option: str, example: str) -> tuple[str, str]:
    name, sign, value = (part.strip() for part in item.partition("="))
    if not (name and sign and value):
        raise UsageError(f"{option} cannot read {item!r}; write it like {example}")
    return name, value


def _number(text: str, item: str, option: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if value != value:
        raise UsageError(f"{option} cannot read {item!r}: {text!r} is not a number")
    return value


def _identify(
    logs: list[Path],
    val: list[Path],
    read: "ReadOptions",
    steps: "Preparation",
    request: "Request",
) -> "Identification":
    from sysid.data.finding import Severity
    from sysid.data.io import read_files
    from sysid.data.quality import inspect_records, require_usable
    from sysid.estimation.identify import identify

    files = read_files(logs, read)
    records = [steps.apply(r) for f in files for r in f.records]
    judged = read_files(val, read) if val else ()
    held: list[Record] = [steps.apply(r) for f in judged for r in f.records]
    require_usable(records)
    findings = [*(f for file in files for f in file.findings), *inspect_records(records)]
    notes = tuple(f.text for f in findings if f.severity >= Severity.WARNING)
    with render.progress("Fitting", total=1000) as tick:
        done = 0

        def progress(share: float, _what: str) -> None:
            nonlocal done
            tick(round(1000 * share) - done)
            done = round(1000 * share)

        return identify(records, held, request, progress, notes)


def _document(stored: list[StoredModel], found: "Identification") -> None:
    models = [{"model": s.id, "path": str(s.path), **s.report} for s in stored]
    document: dict[str, Any] = dict(models[0])
    document["reason"] = found.reason
    document["failed"] = dict(found.failed)
    document["models"] = models
    render.document(document)
