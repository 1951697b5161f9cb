"""``sysid show``: everything that is known of one model."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.workspace.store import Workspace

from . import reading, render
from .fit_report import in_both_units, residual_words
from .models import summary
from .options import command

if TYPE_CHECKING:
    from sysid.workspace.store import StoredModel

BEST = "best"
"""Name of the model that a command takes by default."""


@command
def show(
    model: str | None = reading.ids(
        "[MODEL]",
        "Id of the model, or its beginning [best: that of the last diagnosis, comparison or fit].",
    ),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Show one model: equations, parameters, figures and warnings."""
    stored = Workspace(workspace).chosen(None if model == BEST else model)
    if json:
        render.document(_document(stored))
    else:
        show_model(stored)


def _document(stored: "StoredModel") -> dict[str, Any]:
    model = stored.model
    content = {
        "parameters": model.parameter_table(),
        "poles": model.structure.properties(model.theta, model.dt).get("poles", []),
        "report": stored.report,
    }
    return summary(stored) | content


def show_model(stored: "StoredModel") -> None:
    """Print everything that is known of a stored model."""
    model, report = stored.model, stored.report
    render.say(f"{stored.id}: {model.structure.traits.title}", "bold")
    data = ", ".join(s.name for s in model.provenance.data)
    render.say(f"Fitted to {data}, one sample every {render.number(model.dt)} s")
    level = model.operating_point_sentence()
    if level:
        render.say(level)
    for line in model.equations():
        render.say(f"  {line}")
    for sentence in _steps(stored):
        render.say(f"  {sentence}")
    _figures(stored)
    residuals = residual_words(report.get("residuals") or {}, [c.name for c in model.inputs])
    render.say(f"Residuals (measured less predicted): {residuals}.")
    criteria = report.get("criteria") or model.criteria
    if criteria:
        shown = ", ".join(f"{k.upper()} {render.number(v, 6)}" for k, v in criteria.items())
        render.say(f"Criteria: {shown}.")
    poles = model.structure.properties(model.theta, model.dt).get("poles", [])
    if poles:
        turning = (f" {p['im']:+.4g}i" if p["im"] else "" for p in poles)
        places = (render.number(p["re"], 4) + i for p, i in zip(poles, turning, strict=True))
        render.say(f"Poles at {', '.join(places)}.")
    render.parameters(model)
    warnings: Sequence[str] = report.get("warnings") or model.warnings
    if model.termination.value not in warnings:
        render.say(model.termination.value)
    render.cautions(warnings)
    render.say(f"Stored in {stored.path}", "dim")


def _figures(stored: "StoredModel") -> None:
    """Fits and errors on every set of data and over every horizon."""
    channels = {c.name: c for c in stored.model.outputs}
    rows = []
    for role in ("estimation", "validation"):
        part = stored.report.get(role)
        if not isinstance(part, Mapping):
            continue
        every = (part, *(part.get("k_step") or ())[::-1], part.get("one_step"))
        for f in {id(f): f for f in every if f and "rmse" in f}.values():
            horizon = f["horizon"]
            rows += [
                [
                    f["data"],
                    "free run" if horizon == "free-run" else f"{horizon} step",
                    name,
                    render.number(fit, 5),
                    in_both_units(f["rmse"][name], channels[name]),
                    f["initial_state"],
                ]
                for name, fit in f["fit_percent"].items()
                if name in channels and f["rmse"][name] is not None
            ]
    if rows:
        render.table(["data", "horizon", "output", "fit %", "RMSE", "initial state"], rows)


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
