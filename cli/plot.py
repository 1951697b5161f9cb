"""``sysid plot``: responses, frequency responses, poles, residuals, as pictures or numbers."""

from pathlib import Path
from typing import TYPE_CHECKING

from sysid.errors import UsageError
from sysid.workspace.logs import StoredData, as_fitted
from sysid.workspace.store import StoredModel, Workspace

from . import reading, render, targets
from .options import argument, command, group

if TYPE_CHECKING:
    from sysid.data.reading.read_options import ReadOptions
    from sysid.data.record import Record


@command
def plot(
    what: str = argument(
        "WHAT",
        "log, look, step, impulse, bode, nyquist, poles, residuals, fit, curve (statics), horizon, "
        "surface, singular (order of ss) or ranking.",
    ),
    which: list[str] | None = reading.ids(
        "[MODEL|LOG]...", "Models by id, and logs [the best model; its validation log]."
    ),
    output: Path | None = targets.picture_target(
        "Picture: .svg, .png or .pdf [WORKSPACE/WHAT.svg].", "-o"
    ),
    save: Path | None = targets.data_target("--save", "Also write the numbers, with 95 % bands."),
    read: "ReadOptions" = group(reading.Reading, hidden=True),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Draw responses, poles, residuals of models, with 95 % bands."""
    from sysid.data.files import write_atomic
    from sysid.report.model_panels import NEEDS_LOG, OF_LOG, panels_of
    from sysid.report.panels import Shown, draw_panels, table

    store = Workspace(workspace)
    logs = [Path(w) for w in which or [] if Path(w).is_file()]
    ids = [w for w in which or [] if not Path(w).is_file()]
    if missing := [i for i in ids if Path(i).suffix or "/" in i]:
        raise UsageError(f"{missing[0]}: file not found")
    models: list[StoredModel] = [store.load(i) for i in dict.fromkeys(ids)]
    if not models and not (what in OF_LOG and logs):
        best = _best(store, what)
        models = [best]
        if what == "ranking":  # of the same channels
            models = [m for m in store.readable()[0] if m.model.outputs == best.model.outputs]
    records: tuple[Record, ...] = ()
    if logs or what in NEEDS_LOG or what == "bode":
        records = _records(models, logs, read)
    panels = panels_of(what, [Shown(m.id, m.model) for m in models], records)
    path = output or store.root / f"{what}.svg"
    data = ", ".join(dict.fromkeys(r.name for r in records))
    called = ", ".join(m.id for m in models) if len(models) < 4 else f"{len(models)} models"
    title = f"{what}: {called or data}"
    draw_panels(path, title, data and f"data: {data}; bands: 95 %", panels)
    if save is not None:
        write_atomic(save, table(panels))
    if json:
        render.document({"picture": path, "data": save, "panels": [p.name for p in panels]})
        return
    render.files({"picture": path, "data": save}, picture="Picture", data="Numbers")


def _best(store: Workspace, what: str) -> StoredModel:
    """The best model; where that has nothing of the kind, the newest linear one."""
    from sysid.report.model_panels import OF_LINEAR

    best = store.chosen(None)
    if what not in OF_LINEAR or best.model.structure.traits.linear:
        return best
    linear = [m for m in store.all() if m.model.structure.traits.linear]
    return linear[-1] if linear else best


def _records(
    models: list[StoredModel], logs: list[Path], read: "ReadOptions"
) -> "tuple[Record, ...]":
    """The logs named, read as the first model's were; else its validation log, or what it was
    fitted to."""
    from sysid.data.preparation import Preparation, read_prepared

    if not logs:
        return StoredData().judging(models[0])
    read, steps = as_fitted(models[0] if models else None, read, Preparation())
    records, _ = read_prepared(logs, read, steps, models[0].model.dt if models else None)
    for m in models:
        for r in records:
            m.model.check(r)
    return tuple(records)
