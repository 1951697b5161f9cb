"""``sysid models``: list or remove the models of the workspace."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError
from sysid.workspace.store import Workspace

from . import reading, render
from .options import argument, command

if TYPE_CHECKING:
    from sysid.workspace.store import StoredModel


class Action(StrEnum):
    """What to do with the models."""

    LIST = "list"
    REMOVE = "remove"


@command
def models(
    action: Action = argument("[list|remove]", "What to do.", default=Action.LIST),
    id: str | None = reading.ids("[ID]", "Id of the model to remove, or its beginning."),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """List the models of the workspace, or remove one."""
    if (id is None) != (action is Action.LIST):
        complaint = "takes no ID" if id else "needs the ID of a model"
        raise UsageError(f"sysid models {action.value} {complaint}; `sysid models` lists them")
    store = Workspace(workspace)
    if action is Action.LIST or id is None:
        stored, unreadable = store.readable()
        if json:
            left_out = [{"model": id, "reason": reason} for id, reason in unreadable.items()]
            render.document({"models": [*map(summary, stored)], "unreadable": left_out})
        else:
            _list(stored, unreadable, store.root)
    else:
        removed = store.remove(id)
        if json:
            render.document({"removed": removed})
        else:
            render.say(f"Removed {removed}.")


def summary(stored: "StoredModel") -> dict[str, Any]:
    """What a list says of a model."""
    model = stored.model
    return {
        "model": stored.id,
        "path": stored.path,
        "structure": model.structure.name,
        "orders": model.structure.order_values(),
        "inputs": [c.name for c in model.inputs],
        "outputs": [c.name for c in model.outputs],
        "sample_time_s": model.dt,
        "stable": model.stable,
        "fit_percent": fit_percent(stored.report),
        "data": [s.name for s in model.provenance.data],
    }


def fit_percent(report: dict[str, Any]) -> dict[str, float | None]:
    """Free-run fits on validation data, else on estimation data."""
    for part in ("validation", "estimation"):
        figures = report.get(part)
        if isinstance(figures, dict) and isinstance(figures.get("fit_percent"), dict):
            return dict(figures["fit_percent"])
    return {}


def _list(stored: "list[StoredModel]", unreadable: dict[str, str], root: Path) -> None:
    if not stored:
        render.say(f"The workspace {root} holds no model; run `sysid fit` first.")
        return
    from sysid.structures.orders import orders_text

    rows = [
        (
            s["model"],
            orders_text(s["orders"]),
            f"{', '.join(s['inputs'])} -> {', '.join(s['outputs'])}",
            ", ".join(render.number(f, 4) for f in s["fit_percent"].values()) or None,
            s["stable"],
            ", ".join(s["data"]),
        )
        for s in map(summary, stored)
    ]
    render.table(("model", "orders", "channels", "fit [%]", "stable", "data"), rows)
    render.cautions(unreadable.values())
