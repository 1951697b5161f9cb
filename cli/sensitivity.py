"""``sysid sensitivity``: which parameters a log would show, before any fit to it."""

from pathlib import Path
from typing import TYPE_CHECKING

from sysid.errors import UsageError

from . import reading, render, targets
from .options import command, group, option

if TYPE_CHECKING:
    from sysid.data.preparation import Preparation
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.record import Record
    from sysid.estimation.information.experiments import Mending
    from sysid.estimation.information.sensitivity import Sensitivity
    from sysid.estimation.information.subject import Subject

MOST_PROFILES = 3


@command
def sensitivity(
    logs: list[Path] = reading.LOGS,
    model: str | None = reading.model("Whose parameters [the best model]."),
    structure: str | None = option(
        "NAME",
        "Those of a grey box before any fit: its name, or a file of equations.",
        "-s",
        "--structure",
    ),
    plot: Path | None = targets.picture("Draw when the log shows which parameter."),
    steps: "Preparation" = group(reading.Preparing),
    read: "ReadOptions" = group(reading.Reading),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Show which parameters a log would show, how well, and when.

    The errors are those of the best possible estimate under white noise. For what stays doubtful
    other experiments are tried on the plant as it is, and the best one is named; of a grey box the
    profile says how far it may move.
    """
    from sysid.estimation.information.experiments import mendings
    from sysid.estimation.information.sensitivity import sensitivity as computed

    subject, records = _subject(logs, model, structure, read, steps, workspace)
    found = computed(subject, records)
    errors = [p.std_error for p in found.parameters]
    mended = mendings(subject, found.doubtful, errors)
    ends = _profiles(subject, records, found)
    if plot is not None:
        from sysid.report.data_panels import sensitivity_panels
        from sysid.report.panels import draw_panels

        panels = sensitivity_panels(found, records[0])
        title = "When the log shows which parameter"
        draw_panels(plot, title, records[0].name, panels, 1)
    if json:
        more = {"experiments": [vars(m) for m in mended], "profiles": ends, "picture": plot}
        render.document({**found.to_json(), **more})
        return
    _show(found, mended, ends)
    if plot is not None:
        render.files({"picture": plot}, picture="Picture")


def _subject(
    logs: list[Path],
    model: str | None,
    structure: str | None,
    read: "ReadOptions",
    steps: "Preparation",
    workspace: Path,
) -> "tuple[Subject, tuple[Record, ...]]":
    """The plant, and the records as it takes them."""
    from sysid.data.facts import LogFacts
    from sysid.data.inspection import require_usable
    from sysid.data.preparation import read_prepared
    from sysid.estimation.information.subject import subject_of_box, subject_of_model
    from sysid.structures.grey_box.structure import GreyBox
    from sysid.structures.registry import structure_class
    from sysid.workspace.logs import as_fitted
    from sysid.workspace.store import Workspace

    if structure is not None:
        if model is not None:
            raise UsageError("--model and --structure exclude each other; give one of them")
        cls = structure_class(structure)
        if not issubclass(cls, GreyBox):
            raise UsageError(f"{structure} has no parameters before a fit; fit it and give --model")
        records, findings = read_prepared(logs, read, steps)
        require_usable(records)
        box = cls.from_orders({}, records[0].nu, records[0].ny)
        return subject_of_box(box, LogFacts(records, findings)), tuple(records)
    store = Workspace(workspace)
    stored = store.chosen(model)
    read, steps = as_fitted(stored, read, steps)
    records, _ = read_prepared(logs, read, steps, stored.model.dt)
    for r in records:
        stored.model.check(r)
    plain = tuple(stored.model.detrend.remove(r) for r in records)
    return subject_of_model(stored.model), plain


def _profiles(
    subject: "Subject", records: "tuple[Record, ...]", found: "Sensitivity"
) -> dict[str, tuple[float | None, float | None]]:
    """Ends of the profile of the first doubtful parameters, where the plant is a grey box."""
    from sysid.estimation.information.profiles import profile
    from sysid.structures.grey_box.structure import GreyBox

    if not isinstance(subject.structure, GreyBox):
        return {}
    errors = {p.name: p.std_error for p in found.parameters}
    names = [p.name for p in found.parameters if p.verdict == "doubtful"][:MOST_PROFILES]
    return {name: profile(subject, records[0], name, errors[name]) for name in names}


def _show(
    found: "Sensitivity",
    mended: "tuple[Mending, ...]",
    ends: dict[str, tuple[float | None, float | None]],
) -> None:
    from sysid.estimation.information.profiles import interval_words
    from sysid.estimation.information.sensitivity import hidden_words

    rows = []
    for p in found.parameters:
        when = "–" if p.when is None else f"{p.when[0]:.4g} … {p.when[1]:.4g} s"
        shown = p.std_error < float("inf")
        relative = f"{196 * p.relative:.2g} %" if shown and p.value else "–"
        error = f"{1.96 * p.std_error:.2g}" if shown else "–"
        linked = f"{p.verdict}; like {p.partner}" if p.partner else p.verdict
        rows.append((p.name, f"{p.value:.5g}", error, relative, p.unit, when, linked))
    heads = ("parameter", "value", "± 95 %", "relative", "unit", "80 % of it within", "verdict")
    render.table(heads, rows)
    render.say(found.words)
    for direction in found.null:
        render.warn(hidden_words(direction))
    for name, e in ends.items():
        render.say(f"Profile of {name}: {interval_words(e)}.")
    for sentence in dict.fromkeys(m.sentence for m in mended):
        render.say(sentence)
