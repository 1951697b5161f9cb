"""``sysid resample``: a linear model at another sample time."""

from pathlib import Path

from sysid.workspace.store import Workspace

from . import reading, render
from .options import command, option


@command
def resample(
    model: str | None = reading.ids("[MODEL]", "Id of a linear model [the best]."),
    ts: float = option("SECONDS", "Sample time.", "--ts"),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Give a linear model another sample time."""
    from sysid.estimation.resampling import resampled

    store = Workspace(workspace)
    stored = store.chosen(model)
    found = resampled(stored.model, ts)
    kept = store.save(found, {"resampled_from": stored.id})
    if json:
        render.document({"model": kept.id, "resampled_from": stored.id, "sample_time": ts})
        return
    render.say(f"{stored.id}: sample time {stored.model.dt:g} s, now {ts:g} s.")
    render.say(f"Saved {kept.id}. Details: sysid show {kept.id}")
