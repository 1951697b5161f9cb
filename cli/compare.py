"""``sysid compare``: the workspace's models side by side, ranked by one criterion."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import reading, render
from .workspace import StoredModel, Workspace

if TYPE_CHECKING:
    from sysid.data.record import Record
    from sysid.estimation.comparison import Contender, Ranked, Ranking


def compare(
    models: Annotated[
        list[str] | None,
        typer.Argument(metavar="[MODEL]...", help="Ids; all of the workspace unless given."),
    ] = None,
    criteria: Annotated[
        str,
        typer.Option(
            "--criteria", metavar="NAME", help="fit, rmse, aic, aicc, naic, bic, mdl, fpe or loss."
        ),
    ] = "fit",
    val: Annotated[
        list[Path] | None,
        typer.Option("--val", metavar="LOG", help="Log to judge on. Again for more."),
    ] = None,
    skip: Annotated[
        int, typer.Option("--skip", metavar="N", min=0, help="Leave the first N samples out.")
    ] = 0,
    initial_state: Annotated[
        str,
        typer.Option(
            "--initial-state",
            metavar="HOW",
            help="Start of the free run: estimated, measured or zero.",
        ),
    ] = "estimated",
    horizon: Annotated[
        list[int] | None,
        typer.Option("--horizon", metavar="K", min=2, help="Also show the K-step prediction."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE", help="Draw the ranking: .svg or .png.")
    ] = None,
    workspace: reading.WorkspaceRoot = reading.DEFAULT_WORKSPACE,
    json: reading.Json = False,
) -> None:
    """Rank the models of the workspace by one criterion, on equal terms."""
    from sysid.estimation.assessment import Policy
    from sysid.estimation.comparison import compare as rank
    from sysid.estimation.figures import Start
    from sysid.estimation.orders import check_criterion
    from sysid.report.plots import picture_format

    check_criterion(criteria)
    if plot is not None:
        picture_format(plot)
    place = Workspace(workspace)
    stored = [place.load(i) for i in dict.fromkeys(models)] if models else place.all()
    start = Start(reading.choice(initial_state, [s.value for s in Start], "--initial-state"))
    policy = Policy(start, skip, tuple(sorted(set(horizon or []))))
    with render.progress("Comparing"):
        ranking = rank([_contender(s) for s in stored], criteria, _validation(stored, val), policy)
    place.remember("best", ranking.best.contender.id)
    if plot is not None:
        from .pictures import draw_ranking

        draw_ranking(plot, ranking)
    _document(ranking) if json else _show(ranking, plot)


def _contender(stored: StoredModel) -> "Contender":
    from sysid.estimation.comparison import Contender

    return Contender(stored.id, stored.model, _estimation_data(stored), stored.report)


def _estimation_data(stored: StoredModel) -> "tuple[Record, ...] | None":
    """The model's estimation data read again, or None when they are not the same any more."""
    from sysid.data.io import read_logs
    from sysid.data.read_options import ReadOptions
    from sysid.errors import SysidError

    options = stored.model.provenance.options
    try:
        records = read_logs(options.get("files", []), ReadOptions.from_json(options["read"]))
    except (SysidError, KeyError, TypeError):
        return None
    split = options.get("split")
    if split is not None:
        records = tuple(r.split(float(split))[0] for r in records)
    found = [(r.sha256, r.t0, len(r)) for r in records]
    wanted = [(s.sha256, s.first, s.samples) for s in stored.model.provenance.data]
    return records if found == wanted else None


def _validation(
    stored: list[StoredModel], val: list[Path] | None
) -> "tuple[tuple[Record, ...], str] | None":
    """The validation logs, read as the newest model's data were."""
    if not val:
        return None
    from sysid.data.io import read_logs
    from sysid.data.read_options import ReadOptions

    options = stored[-1].model.provenance.options if stored else {}
    records = read_logs(val, ReadOptions.from_json(options.get("read", {})))
    return records, ", ".join(dict.fromkeys(r.name for r in records))


def _document(ranking: "Ranking") -> None:
    render.document(
        {
            "ranking": [line.to_json() for line in ranking.lines],
            "criterion": ranking.criterion,
            "best": ranking.best.contender.id,
            "data": ranking.data,
            "excluded": [
                {"model": id, "reason": reason} for id, reason in ranking.excluded.items()
            ],
            "notes": list(ranking.notes),
        }
    )


def _show(ranking: "Ranking", plot: Path | None) -> None:
    from sysid.criteria.information import CRITERIA

    first = ranking.best
    names = list(first.figures["fit_percent"])
    ks = [f["horizon"] for f in first.figures.get("k_step", [])]
    heads = [
        f"{what} {n} %"
        for what in ("free run", *(f"{k} step" for k in ks), "one step")
        for n in names
    ]
    render.table(
        ["model", "orders", "n", *heads, "AIC", "BIC", "FPE", "residuals"],
        [_row(line, names) for line in ranking.lines],
        title=f"Ranked by {ranking.criterion}, judged on {ranking.data}",
        caption=f"initial state: {first.figures['initial_state']}",
    )
    render.say(CRITERIA[ranking.criterion].sentence)
    for sentence in (*ranking.notes, *ranking.excluded.values()):
        render.warn(f"! {sentence}")
    if plot is not None:
        render.say(f"Picture: {plot}")
    render.say(f"Best: {first.contender.id}. Next: sysid export.", "bold")


def _row(line: "Ranked", names: list[str]) -> list[object]:
    from sysid.estimation.orders import orders_text

    figures = line.figures
    parts = [figures, *figures.get("k_step", []), figures["one_step"]]
    residuals = line.contender.report.get("residuals") or {}
    passed = residuals.get("passed")
    return [
        line.contender.id,
        orders_text(line.contender.model.structure.order_values()),
        line.contender.model.n_estimated,
        *(render.number(p["fit_percent"][n], 4) for p in parts for n in names),
        render.number(line.criteria["aic"], 6),
        render.number(line.criteria["bic"], 6),
        render.number(line.criteria["fpe"], 4),
        "–" if passed is None else ("pass" if passed else "fail"),
    ]
