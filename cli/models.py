"""``sysid models``: list, show or remove the models of the workspace."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError
from sysid.workspace.store import Workspace

from . import reading, render
from .options import argument, command

if TYPE_CHECKING:
    from sysid.workspace.store import StoredModel


BEST = "best"
"""Name of the model that a command takes by default."""


class Action(StrEnum):
    """What to do with the models."""

    LIST = "list"
    SHOW = "show"
    REMOVE = "remove"


@command
def models(
    action: Action = argument("[list|show|remove]", "What to do.", default=Action.LIST),
    id: str | None = argument(
        "[ID]",
        "Id of the model, its beginning, or best (the default of export).",
        default=None,
        autocompletion=reading.stored_models,
    ),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """List, show or remove the models of the workspace."""
    if (id is None) != (action is Action.LIST):
        complaint = "takes no ID" if id else "needs the ID of a model"
        raise UsageError(f"sysid models {action.value} {complaint}; `sysid models` lists them")
    store = Workspace(workspace)
    if action is Action.LIST or id is None:
        (_list_document if json else _list)(*store.readable(), store.root)
    elif action is Action.SHOW:
        (_document if json else _show)(store.chosen(None if id == BEST else id))
    else:
        removed = store.remove(id)
        if json:
            render.document({"removed": removed})
        else:
            render.say(f"Removed {removed}.")


def _summary(stored: "StoredModel") -> dict[str, Any]:
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
        "fit_percent": _fit_percent(stored.report),
        "data": [s.name for s in model.provenance.data],
    }


def _fit_percent(report: dict[str, Any]) -> dict[str, float | None]:
    """Free-run fits on validation data, else on estimation data."""
    for part in ("validation", "estimation"):
        figures = report.get(part)
        if isinstance(figures, dict) and isinstance(figures.get("fit_percent"), dict):
            return dict(figures["fit_percent"])
    return {}


def _list_document(stored: "list[StoredModel]", unreadable: dict[str, str], _root: Path) -> None:
    left_out = [{"model": id, "reason": reason} for id, reason in unreadable.items()]
    render.document({"models": [_summary(s) for s in stored], "unreadable": left_out})


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
        for s in map(_summary, stored)
    ]
    render.table(("model", "orders", "channels", "fit [%]", "stable", "data"), rows)
    render.cautions(unreadable.values())


def _document(stored: "StoredModel") -> None:
    model = stored.model
    content = {
        "parameters": model.parameter_table(),
        "poles": model.structure.properties(model.theta, model.dt).get("poles", []),
        "report": stored.report,
    }
    render.document(_summary(stored) | content)


def _show(stored: "StoredModel") -> None:
    model = stored.model
    render.say(f"{stored.id}: {model.structure.traits.title}", "bold")
    level = model.operating_point_sentence()
    if level:
        render.say(level)
    for line in model.equations():
        render.say(f"  {line}")
    for sentence in _steps(stored):
        render.say(f"  {sentence}")
    for name, fit in _fit_percent(stored.report).items():
        render.say(f"  Fit of {name} in free run: {render.number(fit, 4)} %.")
    poles = model.structure.properties(model.theta, model.dt).get("poles", [])
    if poles:
        render.say(f"  Poles at {', '.join(_pole(p) for p in poles)}.")
    render.parameters(model)
    if model.termination.value not in model.warnings:
        render.say(model.termination.value)
    for warning in model.warnings:
        render.say(f"Warning: {warning}", "yellow")
    render.say(f"Stored in {stored.path}", "dim")


def _steps(stored: "StoredModel") -> "tuple[str, ...]":
    """Step responses of the model in words; computed again for models of older versions."""
    from sysid.data.schema import checked
    from sysid.estimation.assessment.own_motion import own_modes
    from sysid.estimation.assessment.step_response import StepResponse, step_responses
    from sysid.report.step_words import mode_sentences, step_sentences

    if not stored.model.inputs:
        return mode_sentences(own_modes(stored.model))

    kept = stored.report.get("step_response")
    if kept is None:
        return step_sentences(step_responses(stored.model))
    return step_sentences(checked(tuple[StepResponse, ...], kept))


def _pole(pole: dict[str, float]) -> str:
    place = render.number(pole["re"], 4)
    return place if not pole["im"] else f"{place} {pole['im']:+.4g}i"
