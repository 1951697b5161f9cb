"""Automatic warnings about a fit, as sentences with advice."""

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.criteria.verdicts import ResidualReport, ResidualTest
from sysid.data.finding import Finding, Severity
from sysid.data.record import Record
from sysid.errors import Termination
from sysid.estimation.assessment.figures import Figures
from sysid.estimation.information.experiments import with_mending
from sysid.estimation.information.subject import subject_of_model
from sysid.estimation.soundness import INTEGRATING, largest_radius, motion_doubts
from sysid.fitting.marquardt import Method
from sysid.fitting.uncertainty import unvisited
from sysid.structures import motion
from sysid.structures.base import Structure
from sysid.structures.grey_box.structure import GreyBox
from sysid.structures.linear.base import LinearStructure
from sysid.structures.model import Model

GOOD_PREDICTION = 80.0
"""One-step fit [%] from which a poor free run deserves a warning."""

FALL = 25.0
"""Percentage points between one-step and free-run fit that deserve one."""

WORSE = 1.05
"""Errors over those of the mean from which their ratio is worth a number."""

CANCELLING = 0.02
"""Distance below which a pole and a zero cancel for all practical purposes."""

UNSETTLED = (
    "Refined instrumental variables did not settle within the iteration limit, as with more orders "
    "than the log shows: lower the orders, or omit `method`."
)

MAX_SENTENCES = 12


def advice(
    model: Model,
    free_run: Figures,
    one_step: Figures,
    validation: Figures | None,
    residuals: ResidualReport,
) -> tuple[str, ...]:
    """All warnings about one fit, the gravest first.

    Args:
        free_run, one_step: figures on the estimation data.
        validation: free-run figures on held-out data, if there are any.
        residuals: residual tests on the estimation data.
    """
    sentences = [
        *_not_usable(free_run, validation),
        *_ending(model, residuals),
        *_stability(model),
        *_information(model),
        *_simulation(free_run, one_step),
        *_held_out(free_run, validation),
        *_cancellation(model),
        *_residuals(model, residuals),
    ]
    return tuple(sentences[:MAX_SENTENCES])


def _not_usable(free_run: Figures, validation: Figures | None) -> list[str]:
    """Outputs that a constant predicts better than the model does."""
    sentences = []
    for name, inside in free_run.fit_percent.items():
        outside = inside if validation is None else validation.fit_percent.get(name, inside)
        fit, where = min((inside, "its own data"), (outside, "the validation data"))
        if not fit < 0.0:
            continue
        times = 1.0 - fit / 100.0
        worse = f"errs {times:.3g} times as much as" if times >= WORSE else "does no better than"
        sentences.append(
            f"{name}: this model is not usable in free run: on {where} it {worse} the constant "
            f"mean of {name} (fit {fit:.5g} %). Look for wrong columns, signs, units and jumps "
            "with `sysid inspect`, then for another structure."
        )
    return sentences


def _ending(model: Model, residuals: ResidualReport) -> list[str]:
    sentences = []
    if model.termination is Termination.MAX_ITERATIONS:
        by_instruments = model.provenance.options.get("method") == Method.SRIV.value
        sentences.append(UNSETTLED if by_instruments else model.termination.value)
    tested = {t.output: t for t in residuals.fixed}
    for name in model.at_bound:
        test = tested.pop(name, None)
        sentences.append(
            f"Parameter {name} ended at its bound: widen the bound or check the structure."
            if test is None
            else test.sentence
        )
    return sentences + [t.sentence for t in tested.values() if not t.passed]


def _stability(model: Model) -> list[str]:
    if model.stable:
        longest = max((x.samples for x in model.provenance.data), default=0)
        slow = motion_doubts(model.structure, model.theta, longest, model.dt)
        return [
            f"{clause[0].upper()}{clause[1:]}: over these data it cannot be distinguished from "
            "an offset or a drift; lower the orders or record longer."
            for clause in slow
        ]
    worst = largest_radius(model.structure, model.theta)
    if worst < INTEGRATING:
        return [
            f"The model integrates (largest pole at radius {worst:.5f}): its free run drifts "
            "with any error; differentiate the output or fit its rate."
        ]
    size = f" (largest pole at radius {worst:.4f})" if np.isfinite(worst) else ""
    return [
        f"The free run of this model is unstable{size}: lower "
        "the orders, or fit it with `stable=True` or `focus='simulation'`."
    ]


def _information(model: Model) -> list[str]:
    sentences = []
    alone = [name for d in model.null_directions if (name := unvisited(d))]
    if alone:
        shown = ", ".join(alone[:6]) + (" …" if len(alone) > 6 else "")
        why = (
            "the input does not excite it"
            if model.structure.traits.linear
            else "no sample reaches it"
        )
        sentences.append(
            f"The data hold no information about {shown}: {why}. Record such data, or remove it "
            "from the model."
        )
    together = "their inputs move together" if len(model.inputs) > 1 else "only their sum counts"
    for direction in model.null_directions:
        if unvisited(direction):
            continue
        if isinstance(model.structure, GreyBox):
            sentences.append(_told_apart(model, direction))
            continue
        names = sorted(direction, key=lambda n: -round(abs(direction[n]), 6))  # ties by order
        shown = ", ".join(names[:6]) + (" …" if len(names) > 6 else "")
        why = f"{together}, or too little is excited. The smallest such values were taken; a "
        why += "richer input (sysid excite) distinguishes them."
        sentences.append(f"The data hold no information about a combination of {shown}: {why}")
    table = [p for p in model.parameter_table() if not p.fixed]
    vague = [p.name for p in table if np.isfinite(p.std_error) and p.std_error > abs(p.value)]
    if len(vague) > len(table) // 2 and table:
        shown = ", ".join(vague[:6]) + (" …" if len(vague) > 6 else "")
        sentences.append(
            f"{len(vague)} of {len(table)} parameters are smaller than their standard error "
            f"({shown}): lower the orders or record more."
        )
    return sentences


def _told_apart(model: Model, direction: Mapping[str, float]) -> str:
    """Physical parameters that only show together, as ``before_fit`` says it."""
    subject = subject_of_model(model)
    return with_mending(subject, [n for n in subject.names if n in direction])


def _simulation(free_run: Figures, one_step: Figures) -> list[str]:
    sentences = []
    for name, predicted in one_step.fit_percent.items():
        simulated = free_run.fit_percent[name]
        if predicted >= GOOD_PREDICTION and not predicted - simulated <= FALL:
            sentences.append(
                f"{name}: one step ahead the fit is {predicted:.1f} % but in free run only "
                f"{simulated:.1f} %: a good predictor, not a good simulator. Try oe, "
                "`focus='simulation'` or a nonlinear structure."
            )
    return sentences


def _held_out(free_run: Figures, validation: Figures | None) -> list[str]:
    if validation is None:
        return []
    sentences = []
    for name, inside in free_run.fit_percent.items():
        outside = validation.fit_percent.get(name, float("nan"))
        if np.isfinite(inside) and np.isfinite(outside) and inside - outside > FALL:
            sentences.append(
                f"{name}: the free-run fit falls from {inside:.1f} % on the estimation data to "
                f"{outside:.1f} % on the validation data: too many parameters, or the two logs "
                "cover different operating ranges."
            )
    return sentences


def _cancellation(model: Model) -> list[str]:
    s = model.structure
    # only a ratio of polynomials has factors that cancel
    if not isinstance(s, LinearStructure) or (s.nu, s.ny) != (1, 1):
        return []
    zeros = s.transfer(model.theta).zeros(0, 0)
    poles = [complex(p) for p in motion.poles(s, model.theta)]
    pairs = [p for p in poles if any(abs(p - z) < CANCELLING for z in zeros)]
    if not pairs:
        return []
    at = ", ".join(f"{p.real:.3f}{p.imag:+.3f}j" if p.imag else f"{p.real:.3f}" for p in pairs[:2])
    return [f"A pole and a zero nearly cancel (at {at}): one order lower will do as well."]


def _residuals(model: Model, report: ResidualReport) -> list[str]:
    failed: Sequence[str] = [t.output for t in report.independence if not t.passed]
    sentences = []
    if failed:
        sentences.append(
            f"The residuals of {', '.join(failed)} are correlated with the inputs: dynamics, "
            "delay or a nonlinearity is missing."
        )
    white = [t.output for t in report.whiteness if t.judged and not t.passed]
    if white and model.structure.traits.has_noise_model:
        sentences.append(
            f"The residuals of {', '.join(white)} are not white: the noise model is too simple "
            "(standard errors use the sandwich form)."
        )
    return sentences + _nonlinear(report)


def _nonlinear(report: ResidualReport) -> list[str]:
    alarms: dict[str, ResidualTest] = {}
    for t in report.nonlinear:
        if t.judged and not t.passed:
            before = alarms.setdefault(t.output, t)
            if t.p_value < before.p_value:
                alarms[t.output] = t
    return [t.sentence for t in alarms.values()]


# What the data say ---------------------------------------------------------------------------

FOR_LINEAR = ("nonlinearity", "integrates")
"""Findings that are no fault of the log but say what the numbers of a linear structure hide."""

FOR_NONLINEAR = ("levels",)
"""Findings that say what no nonlinear structure can learn from this log."""


def notes_for(structure: Structure, findings: Sequence[Finding]) -> tuple[str, ...]:
    """The sentences of warnings, and of the notes that matter to such a structure.

    Args:
        findings: verdicts on the data, of any severity.
    """
    codes = FOR_LINEAR if structure.traits.linear else FOR_NONLINEAR
    return tuple(
        f.text
        for f in findings
        if f.severity >= Severity.WARNING or (f.severity >= Severity.NOTE and f.code in codes)
    )


BEYOND = 0.05
"""Share of the range of the estimation data by which other data may exceed it unsaid."""


def beyond_range(model: Model, records: Sequence[Record]) -> tuple[str, ...]:
    """One sentence for each input that leaves the range the model has seen.

    Linear models are left out: what they do at one level they do at every level.
    """
    if model.structure.traits.linear or len(model.ranges) < len(model.inputs):
        return ()
    warnings = []
    for k, channel in enumerate(model.inputs):
        low, high = model.ranges[k]
        values = np.concatenate([r.u[:, k] for r in records])
        if not len(values) or not high > low:
            continue
        least, most = float(values.min()), float(values.max())
        slack = BEYOND * (high - low)
        if least < low - slack or most > high + slack:
            share = 100.0 * float(np.mean((values < low) | (values > high)))
            unit = f" {channel.unit}" if channel.unit else ""
            warnings.append(
                f"{channel.name} runs from {least:.4g} to {most:.4g}{unit} in the validation data "
                f"but only from {low:.4g} to {high:.4g}{unit} in the estimation data "
                f"({share:.0f} % of the samples lie outside): a nonlinear model extrapolates "
                "there; fit to data of that amplitude."
            )
    return tuple(warnings)
