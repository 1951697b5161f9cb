"""``sysid compare``: rank the models of the workspace by one criterion."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.criteria.table import BUILT_IN
from sysid.errors import UsageError
from sysid.workspace.logs import StoredData, as_fitted
from sysid.workspace.store import StoredModel, Workspace

from . import fit_options, reading, render
from .answer import Answer
from .fit_report import fits, residual_marks
from .options import command, group, option
from .read_as import decided, decisions_in_words

if TYPE_CHECKING:
    from sysid.data.finding import Finding
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.record import Record
    from sysid.estimation.assessment.findings import Policy
    from sysid.estimation.selection.comparison import Contender, Ranked, Ranking
    from sysid.estimation.selection.cross_validation import CrossValidation


PAGE = 6
"""Most models on a page: of more lines over each other none can be followed."""


@command
def compare(
    models: list[str] | None = reading.ids("[MODEL]...", "Model ids [all of the workspace]."),
    criterion: str = fit_options.criterion(
        f"Ranks the models: {', '.join(BUILT_IN)}, or one of another package."
    ),
    validation: list[Path] | None = fit_options.validation("Validation log; repeatable."),
    folds: int | None = option(
        "K", "Also cross-validate with K folds: each model is refitted without one block.", min=2
    ),
    policy: "Policy" = group(fit_options.Judging),
    read: "ReadOptions" = group(reading.Reading, hidden=True),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Rank the models of the workspace by one criterion.

    Without --val they are ranked on what the newest of them was validated on, where they were not
    all validated alike.
    """
    from sysid.criteria.table import criterion as criterion_named
    from sysid.criteria.table import known_name
    from sysid.data.finding import notes, warned
    from sysid.estimation.selection.comparison import common_validation
    from sysid.estimation.selection.comparison import compare as rank

    criterion = known_name(criterion)
    store = Workspace(workspace)
    unreadable: dict[str, str] = {}
    if models:
        stored = [store.load(i) for i in dict.fromkeys(models)]
    else:
        stored, unreadable = store.readable()
    with render.progress("Comparing", total=len(stored)) as advance:
        data = StoredData()
        contenders = [data.contender(s) for s in stored]
        judged_on, findings = _validation(stored, validation, read)
        if judged_on is None and criterion_named(criterion).of_free_run:
            judged_on = common_validation(contenders)
        ranking = rank(contenders, criterion, judged_on, policy, advance)
    best, before = ranking.best.contender.id, store.chosen(None).id
    # a fit may rank by its own data, a comparison not
    instead = f"Commands take {best} from now on; before this comparison they took {before}."
    ranking = replace(
        ranking,
        notes=(*ranking.notes, *[instead] * (best != before), *warned(findings)),
        excluded={**ranking.excluded, **unreadable},
    )
    crossed = _cross_validated(ranking, folds)
    read_as = decided(judged_on[0] if judged_on else ())
    store.remember("best", best)
    if json:
        _document(ranking, crossed, read_as)
        return
    page = _page(store, ranking, judged_on, contenders)
    _show(ranking, crossed, {"Page": page}, read_as, notes(findings))


def _page(
    store: Workspace,
    ranking: "Ranking",
    judged_on: "tuple[Sequence[Record], str] | None",
    contenders: "Sequence[Contender]",
) -> Path | None:
    """Write the page of the models on the log that judged them; none where that is gone."""
    from sysid.data.files import write_atomic
    from sysid.report.model_page import comparison_page
    from sysid.report.panels import Shown

    own = next(c.validation or c.records for c in contenders if c.id == ranking.best.contender.id)
    records = judged_on[0] if judged_on else own
    if not records:
        return None
    order = records[0].input_names, records[0].output_names  # a picture has one order of channels
    alike = [
        Shown(c.id, c.model, line.step_time)
        for line in ranking.lines
        for c in (line.contender,)
        if (tuple(u.name for u in c.model.inputs), tuple(y.name for y in c.model.outputs)) == order
    ]
    shown = alike[:PAGE]
    page = comparison_page(shown, records, ranking.best.contender.id, ranking.notes)
    path = store.root / "compare.html"
    write_atomic(path, page.html())
    return path


def _validation(
    stored: list[StoredModel], val: list[Path] | None, read: "ReadOptions"
) -> "tuple[tuple[tuple[Record, ...], str] | None, tuple[Finding, ...]]":
    """The validation logs and the findings of reading them.

    They are read as the newest model's data were unless the line says how.
    """
    from sysid.data.reading.read_options import ReadOptions

    if not val:
        if read != ReadOptions():
            raise UsageError("options for reading a log apply to --val only; give --val LOG")
        return None, ()
    from sysid.data.preparation import Preparation, read_prepared
    from sysid.data.record import names_of

    read, steps = as_fitted(stored[-1] if stored else None, read, Preparation())
    step = stored[-1].model.dt if stored else None
    records, findings = read_prepared(val, read, steps, step)
    return (records, names_of(records)), findings


def _document(
    ranking: "Ranking", folds: "Mapping[str, CrossValidation]", read_as: list[dict[str, str]]
) -> None:
    render.document(
        {
            "ranking": [
                line.to_json() | {"cross_validation": folds.get(line.contender.id)}
                for line in ranking.lines
            ],
            "criterion": ranking.criterion,
            "best": ranking.best.contender.id,
            "data": ranking.data,
            "excluded": [
                {"model": id, "reason": reason} for id, reason in ranking.excluded.items()
            ],
            "notes": list(ranking.notes),
            "read_as": read_as,
        }
    )


def _show(
    ranking: "Ranking",
    folds: "Mapping[str, CrossValidation]",
    pictures: Mapping[str, Path | None],
    read_as: Sequence[dict[str, str]],
    reading_notes: Sequence[str],
) -> None:
    from sysid.criteria.table import criterion
    from sysid.estimation.selection.comparison import reasons

    first = ranking.best
    names = list(first.figures["fit_percent"])
    ks = [f["horizon"] for f in first.figures.get("k_step", [])]
    about = criterion(ranking.criterion)
    shown = "" if about.of_free_run else ranking.criterion
    heads = ["free run, %", *(f"{k} step" for k in ks)]
    heads += [f"{next(iter(folds.values())).folds} folds"] if folds else []
    kinds = _kinds(ranking)
    cost = ["µs a step"] if kinds else []
    answer = Answer.with_files(1, pictures)
    answer.say(decisions_in_words(read_as), "dim", 2)
    for note in reading_notes[:2]:
        answer.say(note, "dim", 1)
    judged = "validated on" if first.figures["held_out"] else "on the estimation data"
    answer.say(f"Ranked by {ranking.criterion}, {judged} {ranking.data}", "bold", 1)
    rows = [_row(line, line is first, names, folds, shown, bool(kinds)) for line in ranking.lines]
    value = [shown.upper()] if shown else []
    columns = ["  model", "orders", "par.", *cost, *heads, *value, "residuals"]
    kept = answer.table(columns, rows, spare=5)
    if kept < len(rows):
        answer.say(f"  {len(rows) - kept} more: --json", "dim", 1)
    answer.say(about.sentence, "", 1)
    if kinds:
        parts = (f"{', '.join(structures)}: {tells}" for tells, structures in kinds.items())
        answer.say(f"What the models reveal: {'; '.join(parts)}.", "", 2)
    answer.cautions([*ranking.notes, *reasons(ranking.excluded)], "--json")
    answer.print(f"Best: {first.contender.id}. Next: sysid show | sysid export")


def _kinds(ranking: "Ranking") -> dict[str, list[str]]:
    """What models reveal → the structures of that kind; empty where all are of one kind."""
    kinds: dict[str, list[str]] = {}
    for line in ranking.lines:
        structure = line.contender.model.structure
        names = kinds.setdefault(structure.traits.tells, [])
        if structure.name not in names:
            names.append(structure.name)
    return kinds if len(kinds) > 1 else {}


def _row(
    line: "Ranked",
    first: bool,
    names: list[str],
    folds: "Mapping[str, CrossValidation]",
    shown: str,
    cost: bool,
) -> list[object]:
    from sysid.estimation.selection.ranking import free_parameters
    from sysid.structures.orders import orders_text

    figures, c = line.figures, line.contender
    parts = [p["fit_percent"] for p in (figures, *figures.get("k_step", []))]
    if folds:
        parts.append(folds[c.id].fit_percent if c.id in folds else {})
    return [
        f"{'*' if first else ' '} {c.id}",
        orders_text(c.model.structure.order_values()),
        free_parameters(c.model),
        *([None if line.step_time is None else float(f"{1e6 * line.step_time:.2g}")] * cost),
        *(fits(p, names) for p in parts),
        *([render.number(line.criteria[shown], 6)] if shown else []),
        residual_marks(line.residuals or {}),
    ]


def _cross_validated(ranking: "Ranking", folds: int | None) -> "dict[str, CrossValidation]":
    """Cross-validation of every ranked model whose estimation data are at hand."""
    if folds is None:
        return {}
    from sysid.estimation.selection.cross_validation import cross_validate

    by_model = {}
    with render.progress("Cross-validating", total=len(ranking.lines)) as tick:
        for line in ranking.lines:
            c = line.contender
            if c.records is not None:
                by_model[c.id] = cross_validate(c.model, c.records, folds)
            tick(1)
    return by_model
