"""Text output of ``sysid fit``: which model, can it be trusted, what to do next."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import render
from .answer import Answer
from .read_as import decisions_in_words

if TYPE_CHECKING:
    from sysid.data.record import Channel
    from sysid.estimation.assessment.findings import Assessment
    from sysid.estimation.identify import Identification
    from sysid.workspace.store import StoredModel

DIVERGES = -1e5
"""Fit [%] from which on a free run is said to diverge: it errs by a thousand spreads."""

MODELS = 6
"""Most models that are shown; `sysid compare` has them all."""


def show(
    stored: "Sequence[StoredModel]",
    identification: "Identification",
    read_as: Sequence[dict[str, str]],
    pictures: Mapping[str, Path | None],
    reading: Sequence[str] = (),
    said: Sequence[str] = (),
) -> None:
    """Print how the logs were read, the ranking, what the best model does, and what to do next.

    Args:
        said: warnings that were shown before the fit.
    """
    best, id = identification.assessments[0], stored[0].id
    answer = Answer.with_files(2, pictures)
    answer.note(decisions_in_words(read_as), 2)
    for note in reading[:2]:
        answer.say(note, "dim", 2)
    _ranking(answer, stored, identification)
    answer.say(f"* {identification.reason}", "bold", 2)
    _responses(answer, best)
    if answer.room > 3:
        answer.say(best.model.operating_point_sentence(), "", 1)
    failed = [f"{n} could not be fitted: {why}" for n, why in identification.failed.items()]
    answer.cautions([*failed, *(w for w in best.warnings if w not in said)], "sysid show")
    answer.say(f"Saved {id}. Details: sysid show", "", 1)
    # a time series without inputs makes no plant
    answer.print(
        "Next: sysid export | sysid diagnose OTHER.csv"
        if best.model.inputs
        else "Next: sysid compare"
    )


def _ranking(
    answer: Answer, stored: "Sequence[StoredModel]", identification: "Identification"
) -> None:
    from sysid.estimation.selection.ranking import free_parameters
    from sysid.structures.orders import orders_text

    assessments = identification.assessments
    best = assessments[0]
    names = list(best.judged.free_run.fit_percent)
    role = "Validation" if best.validation else "Estimation"
    rows = [
        [
            f"{'*' if k == 0 else ' '} {a.model.structure.name}",
            orders_text(a.model.structure.order_values()),
            free_parameters(a.model),
            fits(a.judged.free_run.fit_percent, names),
            residual_marks(a.residuals.as_dict()),
        ]
        for k, a in enumerate(assessments[:MODELS])
    ]
    horizon = "free run" if best.model.inputs else "one step"
    data = best.judged.free_run.data
    answer.say(f"{role}: {data}", "bold", 1)
    answer.table(["  model", "orders", "par.", f"fit %, {horizon}", "residuals"], rows)
    if len(assessments) > MODELS:
        answer.say(f"  {len(assessments) - MODELS} more: sysid compare", "", 1)


def fits(percent: Mapping[str, float | None], names: Sequence[str]) -> str:
    """Fits of the outputs in their order, in per cent: those of four outputs, then the least."""
    values = [percent.get(n) for n in names]
    shown = "  ".join(fit_word(v) for v in values[:4])
    known = [v for v in values if v is not None]
    return shown if len(values) <= 4 else f"{shown} …, least {fit_word(min(known, default=None))}"


def fit_word(value: float | None) -> str:
    """A fit with two decimals."""
    if value is None or value != value:
        return "–"
    return f"{value:.2f}" if value > DIVERGES else "diverges"


def _responses(answer: Answer, best: "Assessment") -> None:
    """A row for each path that matters: gain, time constants, settling time, with intervals."""
    from sysid.estimation.assessment.own_motion import own_modes
    from sysid.report.step_words import UNSURE, mode_sentences, response_table, strong_paths

    paths, small = strong_paths(best.steps)
    if paths:
        heads, rows = response_table(paths)
        shown = answer.table([best.model.structure.name, *heads], rows, spare=4)
        more = ["± 95 %"]
        if any(UNSURE in cell for row in rows[:shown] for cell in row):
            more.append(f"{UNSURE} interval holds zero")
        if shown < len(paths):
            left = len(paths) - shown
            more.append(f"{left} more row{'s' * (left > 1)}: sysid show")
        answer.say("; ".join([*more, small] if small else more), "dim", 1)
    for line in mode_sentences(own_modes(best.model)):
        answer.say(line, "", 1)


def residual_marks(residuals: Mapping[str, Any]) -> str:
    """The tests that failed, by a word each; ``pass`` where none did."""
    if not residuals:
        return "–"
    tests = _verdicts(residuals)
    failed = dict.fromkeys(mark for mark, passed, _ in tests if not passed)
    return f"{', '.join(failed)} FAIL" if failed else "pass" if tests else "not tested"


def residual_words(residuals: Mapping[str, Any], inputs: Sequence[str] = ()) -> str:
    """Results of the residual tests in words; inputs by name."""
    if not residuals:
        return "–"
    return ", ".join(words for *_, words in _verdicts(residuals, inputs)) or "not tested"


def _verdicts(
    residuals: Mapping[str, Any], inputs: Sequence[str] = ()
) -> list[tuple[str, bool, str]]:
    """The tests that were judged: a word, whether it passed, and its result in words."""
    tests = []
    if any(t["dof"] for t in residuals["independence"]["outputs"]):
        free, names = residuals["independence"]["passed"], ", ".join(inputs)
        of = f" of {names}" if names else ""
        words = f"no linear effect{of} left" if free else f"correlated with {names or 'the inputs'}"
        tests.append(("input", free, words))
    if residuals["whiteness"]["judged"]:
        white = residuals["whiteness"]["passed"]
        tests.append(("white", white, "white" if white else "not white"))
    judged = {k: t for k, t in (residuals.get("nonlinear") or {}).items() if t["judged"]}
    tests += [("nonlinear", False, _NONLINEAR[k]) for k, t in judged.items() if not t["passed"]]
    if judged and all(t["passed"] for t in judged.values()):
        tests.append(("nonlinear", True, "nothing nonlinear left"))
    held = [t["output"] for t in residuals.get("held_parameters") or () if not t["passed"]]
    return [*tests, *([("fixed", False, f"fixed {', '.join(held)} contradicted")] if held else [])]


_NONLINEAR = {
    "error products": "products of errors and inputs left",
    "input squares": "squares of inputs left",
    "error size": "larger errors at large inputs",
}
"""Results of Billings & Voon's tests of a nonlinear model's residuals, in words."""


def in_both_units(value: float, channel: "Channel") -> str:
    """An error of a channel in the file's unit, and in SI where that is another one."""
    return channel.worded(lambda factor: render.number(factor * value, 4))
