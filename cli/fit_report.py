"""Text output of ``sysid fit``."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import render

if TYPE_CHECKING:
    from sysid.data.record import Channel
    from sysid.estimation.assessment.findings import Assessment
    from sysid.estimation.identify import Identification
    from sysid.workspace.store import StoredModel

MANY = 24
"""Parameters from which only the file lists them all."""


def show(
    stored: "Sequence[StoredModel]",
    identification: "Identification",
    plot: Path | None,
    reading: Sequence[str] = (),
) -> None:
    """Print how the logs were read, the ranking, the winner, and what to do next."""
    from sysid.estimation.assessment.own_motion import own_modes
    from sysid.report.step_words import mode_sentences, step_sentences
    from sysid.structures.orders import orders_text

    render.reading(reading)
    best = identification.assessments[0]
    names = list(best.estimation.free_run.fit_percent)
    judged = "validation" if best.validation else "estimation"
    if len(identification.assessments) > 1:
        rows = [
            [
                s.id,
                orders_text(a.model.structure.order_values()),
                a.model.n_estimated,
                ", ".join(render.number(a.judged.free_run.fit_percent[n], 4) for n in names),
                ", ".join(render.number(a.judged.one_step.fit_percent[n], 4) for n in names),
                render.number(a.model.criteria["aic"], 6),
                residual_words(a.residuals.as_dict()),
            ]
            for s, a in zip(stored, identification.assessments, strict=True)
        ]
        render.table(
            ["model", "orders", "n", "free run %", "one step %", "AIC", "residuals"],
            rows,
            title=f"Models on {judged} data: {best.judged.free_run.data}",
            caption=f"fits of {', '.join(names)}; n: estimated parameters, with initial states",
        )
    render.say(identification.reason, "bold")
    for name, reason in identification.failed.items():
        render.warn(f"{name} could not be fitted: {reason}")
    modes = mode_sentences(own_modes(best.model))
    for line in (*step_sentences(best.steps), *modes):
        render.say(f"  {line}")
    count = len(best.model.parameters)
    if count > MANY:
        render.say(f"{count} parameters; `sysid models show` lists them.")
    else:
        render.parameters(best.model)
    _figures(best)
    residuals = residual_words(best.residuals.as_dict(), [c.name for c in best.model.inputs])
    render.say(f"Residuals (measured less predicted): {residuals}.")
    level = best.model.operating_point_sentence()
    if level:
        render.say(level)
    for line in best.model.equations():
        render.say(f"  {line}")
    ending = best.model.termination.value
    if ending not in best.warnings:
        render.say(ending, "dim")
    render.cautions(best.warnings)
    render.files({"plot": plot}, plot="Picture")
    render.say(f"Stored as {stored[0].id} in {stored[0].path}. Next: {_next(best)}.")


def _next(best: "Assessment") -> str:
    """The next commands for the model; a time series without inputs makes no plant."""
    return "sysid compare, sysid export" if best.model.inputs else "sysid compare"


def residual_words(residuals: Mapping[str, Any], inputs: Sequence[str] = ()) -> str:
    """Results of the residual tests in words, for a fit and a comparison; inputs by name."""
    if not residuals:
        return "–"
    words = []
    if any(t["dof"] for t in residuals["independence"]["outputs"]):
        of, named = ("", "the inputs")
        if inputs:
            of, named = f" of {', '.join(inputs)}", ", ".join(inputs)
        free = residuals["independence"]["passed"]
        words.append(f"no linear effect{of} left" if free else f"correlated with {named}")
    if residuals["whiteness"]["judged"]:
        words.append("white" if residuals["whiteness"]["passed"] else "not white")
    for kind, test in (residuals.get("nonlinear") or {}).items():
        if test["judged"] and not test["passed"]:
            words.append(_NONLINEAR[kind])
    nonlinear = [f for f in (residuals.get("nonlinear") or {}).values() if f["judged"]]
    if residuals.get("nonlinear") and all(f["passed"] for f in nonlinear):
        words.append("nothing nonlinear left")
    contradicted = [t["output"] for t in residuals.get("held_parameters") or () if not t["passed"]]
    if contradicted:
        words.append(f"fixed {', '.join(contradicted)} contradicted")
    return ", ".join(words) or "not tested"


_NONLINEAR = {
    "error products": "products of errors and inputs left",
    "input squares": "squares of inputs left",
    "error size": "larger errors at large inputs",
}
"""Results of Billings & Voon's tests of a nonlinear model's residuals, in words."""


def in_both_units(value: float, channel: "Channel") -> str:
    """An error of a channel in the file's unit, and in SI where that is another one."""
    return channel.worded(lambda factor: render.number(factor * value, 4))


def _figures(a: "Assessment") -> None:
    rows = []
    channels = {c.name: c for c in a.model.outputs}
    for part in (a.estimation, a.validation):
        if part is None:
            continue
        driven = [part.free_run] if part.free_run.horizon is None else []
        for f in (*driven, *part.k_step[::-1], part.one_step):
            horizon = "free run" if f.horizon is None else f"{f.horizon} step"
            rows += [
                [
                    f.data,
                    horizon,
                    name,
                    render.number(fit, 5),
                    in_both_units(f.rmse[name], channels[name]),
                    f.initial_state,
                ]
                for name, fit in f.fit_percent.items()
            ]
    render.table(["data", "horizon", "output", "fit %", "RMSE", "initial state"], rows)
