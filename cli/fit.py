"""``sysid fit``: fit, validate and rank models of a log, and store them in the workspace."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.workspace.logs import judged_on
from sysid.workspace.store import StoredModel, Workspace

from . import fit_options, reading, render
from .fit_report import show
from .fit_response import fit_response, is_response
from .live.follow import Followed, check_alone, follow, stopping
from .live.options import Following
from .options import command, group, option
from .read_as import decided
from .report import command_of
from .show import show_model

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.record import Record
    from sysid.estimation.assessment.findings import Policy
    from sysid.estimation.identify import Identification, Request
    from sysid.estimation.information.before_fit import Identifiability
    from sysid.fitting.options import FitOptions


@command
def fit(
    logs: list[Path] = reading.LOGS,
    structures: str | None = fit_options.STRUCTURES,
    orders: str | None = fit_options.fitting_option(
        "TEXT",
        'As "na=2 nb=1:4 nk=1"; with commas a matrix, with "oe: …; arx: …" each [searched].',
    ),
    validation: list[Path] | None = fit_options.validation(
        "Validation log, never used to choose a model; repeatable."
    ),
    split: float | None = fit_options.judging_option(
        "SHARE", "Fit on this share of a log, validate on the rest: 0.7."
    ),
    criterion: str = fit_options.criterion("Ranks orders and structures: fit, aic, bic …"),
    detrend: str = fit_options.fitting_option(
        "HOW",
        "Offsets: auto, none, level (estimated with the model), mean or linear (removed).",
        default="auto",
        advanced=True,
    ),
    jobs: int = option(
        "N", "Processes for the search.", "-j", "--jobs", default=2, min=1, advanced=True
    ),
    options: "FitOptions" = group(fit_options.Fitting),
    policy: "Policy" = group(fit_options.Judging),
    steps: "Preparation" = group(reading.Preparing),
    read: "ReadOptions" = group(reading.Reading),
    how: Following = group(Following),
    workspace: Path = reading.WORKSPACE,
    full: bool = reading.FULL,
    json: bool = reading.JSON,
) -> None:
    """Fit models to a log, validate them and store them.

    With --follow the log is still being written: gain, time constant and dead zone are shown as
    they converge, and Ctrl-C stores the model.

    Without --structure arx, armax, oe and bj (process on few samples, ss on several outputs) are
    fitted. The best in free run on held-out estimation data comes first.
    """
    if is_response(logs):
        names, own = fit_options.names(structures), options.structure_options or {}
        fit_response(logs[0], names, orders, own, steps.band, workspace, json)
        return
    with stopping(how.follow) as stop:  # Ctrl-C is how following ends
        from sysid.estimation.identify import Request

        files = [str(p.resolve()) for p in logs]
        origin: dict[str, Any] = {
            "files": files,
            "read": read.to_json(),
            "prepare": steps.to_json(),
        }
        asked = fit_options.names(structures)
        if written := [str(Path(n).resolve()) for n in asked if n.endswith((".yaml", ".yml"))]:
            origin["equations"] = written[0]
        request = Request(
            structures=asked,
            orders=orders,
            options=replace(options, extra=origin),
            detrend=detrend,
            criterion=criterion,
            split=split,
            policy=policy,
            jobs=jobs,
        )
        store = Workspace(workspace)
        followed: Followed | None = None
        notes: tuple[str, ...] = ()
        records: tuple[Any, ...] = ()
        apart: Mapping[str, Identifiability] = {}
        if how.follow:
            check_alone(validation, steps)
            followed = follow(logs, how, request, read, store, stop, quiet=json)
            identification, records = followed.found, followed.records
        else:
            identification, notes, records, apart = _identify(
                logs, validation or [], read, steps, request
            )
        stored = _stored(store, identification, validation or logs)
    offsets = identification.assessments[0].model.operating_point.decision
    read_as = decided(records, offsets)
    if json:
        _document(stored, identification, followed, read_as, apart)
    else:
        page = _page(store, stored[0], identification)
        said = [s for known in apart.values() for s in known.sentences]
        show(stored, identification, read_as, {"Page": page}, notes, said)
        if full:
            render.reading(notes)
            for name, known in apart.items():
                render.say(f"Before the fit, {name}: {known.words}")
            show_model(stored[0])


def _stored(
    store: Workspace, identification: "Identification", judges: list[Path]
) -> list[StoredModel]:
    """The models of a fit, kept in the workspace, the winner first."""
    judged = {"judged_on": judged_on(identification.validation, judges)}
    stored = [
        store.save(a.model, a.to_json() | judged) for a in reversed(identification.assessments)
    ][::-1]
    store.remember("latest", [s.id for s in stored])
    return stored


def _page(store: Workspace, best: StoredModel, identification: "Identification") -> Path:
    """Write the page of the best model; what is slow is left to ``sysid report``."""
    from sysid.data.files import write_atomic
    from sysid.report.model_page import model_page

    records = identification.validation or identification.estimation
    tests = identification.assessments[0].residuals
    line, found = command_of(best), identification.findings
    page = model_page(
        best.id, best.model, best.report, records, found, tests, command=line, quick=True
    )
    path = store.root / "fit.html"
    write_atomic(path, page.html())
    return path


def _identify(
    logs: list[Path],
    val: list[Path],
    read: "ReadOptions",
    steps: "Preparation",
    request: "Request",
) -> "tuple[Identification, tuple[str, ...], tuple[Record, ...], Mapping[str, Identifiability]]":
    """The fitted models, notes on how the logs were read, the records of all, and what each grey
    box could distinguish, which is said before time is spent.

    Notes are only shown; a finding that needs an action is a warning, which the models store.
    """
    from sysid.data.facts import LogFacts
    from sysid.data.finding import notes
    from sysid.data.inspection import require_usable
    from sysid.data.preparation import Preparation, read_prepared
    from sysid.data.reading.blocks import large_log
    from sysid.data.same_kind import with_validation
    from sysid.estimation.all_rows import on_all_rows
    from sysid.estimation.identify import identify
    from sysid.estimation.information.before_fit import before_request

    records, findings = read_prepared(logs, read, steps)
    validation, validation_findings = read_prepared(val, read, steps) if val else ((), ())
    records, validation, resampled = with_validation(records, validation)
    findings += resampled
    require_usable(records)
    apart = before_request(records, request)
    for known in apart.values():
        render.cautions(known.sentences)
    facts = LogFacts(records, findings)
    with render.stages("Fitting") as shown:
        identification = identify(
            facts, validation, request, lambda share, _: shown("Fitting", share), inspect=True
        )
        large = large_log(logs[0], read) if len(logs) == 1 and steps == Preparation() else None
        if large is not None:
            identification = on_all_rows(identification, facts, request, large)
    said = notes((*findings, *validation_findings))
    return identification, said, (*records, *validation), apart


def _document(
    stored: list[StoredModel],
    identification: "Identification",
    followed: Followed | None,
    read_as: list[dict[str, str]],
    apart: "Mapping[str, Identifiability]",
) -> None:
    models = [{"model": s.id, "path": str(s.path), **s.report} for s in stored]
    document: dict[str, Any] = dict(models[0])
    document["reason"] = identification.reason
    document["failed"] = dict(identification.failed)
    document["models"] = models
    document["read_as"] = read_as
    if apart:
        document["before_fit"] = {name: known.to_json() for name, known in apart.items()}
    if followed is not None:
        document["live"] = followed.state.to_json() | {"log": str(followed.log)}
    render.document(document)
