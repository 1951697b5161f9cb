"""``sysid reduce``: a model of fewer states, and what that changes."""

from pathlib import Path

from sysid.workspace.store import Workspace

from . import reading, render
from .options import command, option


@command
def reduce(
    model: str | None = reading.ids("[MODEL]", "Id of a linear model [the best]."),
    states: int = option("N", "States that are kept.", "--states", min=1),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Reduce a linear model to fewer states, with its error bound."""
    from sysid.estimation.reduction import reduced

    store = Workspace(workspace)
    stored = store.chosen(model)
    found = reduced(stored.model, states)
    kept = store.save(found.model, {"reduced_from": stored.id})
    if json:
        render.document(
            {
                "model": kept.id,
                "reduced_from": stored.id,
                "singular_values": found.singular,
                "bound": found.bound,
                "reached": found.reached,
            }
        )
        return
    values = ", ".join(f"{v:.3g}" for v in found.singular)
    render.say(f"{stored.id}: {len(found.singular)} states; Hankel singular values {values}.")
    render.say(
        f"With {states} of them the frequency response changes by {found.reached:.3g} at most "
        f"(bound {found.bound:.3g})."
    )
    render.say(f"Saved {kept.id}. Details: sysid show {kept.id}")
