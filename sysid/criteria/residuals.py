"""Residual tests: whiteness, independence from the inputs, feedback.

All three ask whether the residuals ε correlate with instruments Z (lagged residuals, past inputs,
future inputs) and decide by one portmanteau number, not by one lag outside its band:

    c = Z̃ᵀε,   Z̃ = Z − J(JᵀJ)⁻¹JᵀZ,   C = Z̃ᵀΣ̂Z̃,   cᵀC⁺c ~ χ²(rank C)  when the model is right.

J is the Jacobian ∂ŷ/∂θ of the parameters that were estimated from these very data (either sign).
Estimation makes ε̂ = v + J(θ₀ − θ̂) to first order, so projecting J out of Z removes exactly what
the fitted parameters took from the correlations, where "degrees of freedom = lags − parameters" is
only right for pure AR models. A parameter that was fixed, or stopped by a bound, took nothing: its
column does not belong into J, or a wrong value of it would pass unseen. On data the model was not
fitted to nothing at all is projected out; there θ₀ − θ̂ is as uncertain as the estimate was, which
adds ZᵀG P GᵀZ to C (``uncertain`` = G√P). Σ̂ is σ²I for
whiteness; for the input tests, which must not mistake coloured noise for dependence, it is the
covariance of an AR(20) fit of ε (see ``coloured.py``). Measured alarm rates and power stand in
``reports/residual_tests.md``.

Sources: Ljung (1999) §16.6; Ljung & Box (1978); Breusch (1978) and Godfrey (1978) for the
projection; Sims (1972) for future inputs; Söderström & Stoica (1990) for Σ.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.criteria.coloured import AutoRegression, ar_fit
from sysid.criteria.correlation import (
    Correlation,
    autocorrelation,
    centred,
    cross_correlation,
    inputs_of,
    one_output,
)
from sysid.criteria.fit import Array, Signals, as_records
from sysid.criteria.portmanteau import Mask, Trial, orthonormal, score
from sysid.criteria.verdicts import ResidualReport, ResidualTest, ScoredTest
from sysid.errors import DataError

__all__ = [
    "Correlation",
    "autocorrelation",
    "cross_correlation",
    "feedback_test",
    "independence_test",
    "residual_report",
    "whiteness_test",
]


LAGS = 25
"""Largest lag tested, each way: the choice of Ljung (1999) §16.6; lowered on short records."""


def whiteness_test(
    errors: Signals,
    jacobian: Signals | None = None,
    *,
    output: int = 0,
    n_parameters: int = 0,
    level: float = 0.99,
    judged: bool = True,
    output_names: Sequence[str] = (),
    uncertain: Signals | None = None,
) -> ResidualTest:
    """Whether one output's residuals are unpredictable from the past residuals of all outputs.

    Ljung–Box's portmanteau in its score form: Z holds ε(t−1)…ε(t−25) of every output (fewer where
    a record has fewer than 10 samples a correlation), C =
    σ̂²Z̃ᵀZ̃. With the Jacobian the estimated parameters count for exactly what they absorb;
    without it ``n_parameters`` (those of the noise model) are taken off the degrees of freedom.
    The mean is not removed: residuals with an offset are not white.

    Args:
        errors: residuals of all outputs, (N, ny), or one such array a record; rows with NaN
            are left out.
        jacobian: ∂ŷ/∂θ of the tested output by what was estimated from these data, (N, n), or one
            such array a record.
        output: index of the tested output.
        n_parameters: parameters to discount when there is no Jacobian.
        judged: False for a structure without noise model.
        uncertain: G√P of parameters estimated from other data, (N, k), or one such array a record.

    Raises:
        DataError: shapes do not fit, or fewer than 20 complete rows.
    """
    es = as_records(errors, "errors")
    ny = es[0].shape[1]
    names = tuple(output_names) or tuple(f"output {i + 1}" for i in range(ny))
    js = _jacobian_records(jacobian, es)
    gs = _uncertain_records(uncertain, es)
    keep = _complete(es, js)
    filled = [np.where(k[:, None], e, 0.0) for k, e in zip(keep, es, strict=True)]
    one_output([e[:, output] for e in filled])
    lags = _affordable(LAGS, keep, ny)
    trial = Trial(
        errors=[e[:, output] for e in filled],
        signals=filled,
        jacobian=js,
        keep=keep,
        rows=keep,
        tested=range(1, lags + 1),
        nuisance=range(0),
        centred=False,
        noise=None,
        uncertain=gs,
    )
    outcome = score(trial)
    dof = outcome.dof if jacobian is not None else max(outcome.dof - n_parameters, 1)
    result = ScoredTest(outcome, min(dof, outcome.dof), level, names, trial.tested)
    who = names[output]
    if result.dof == 0:
        sentence = f"The residuals of {who} are zero: nothing to test."
    elif result.passed:
        sentence = f"The residuals of {who} are white up to lag {lags} ({result.says})."
    else:
        advice = (
            "raise the orders of the noise model (nc, nd) or of the dynamics."
            if judged
            else "acceptable for a structure without noise model."
        )
        sentence = (
            f"The residuals of {who} are not white ({result.says}), {result.signal} "
            f"{result.lag} samples earlier is the best predictor: {advice}"
        )
    return result.test("whiteness", who, judged, sentence)


def independence_test(
    errors: Signals,
    inputs: Signals,
    jacobian: Signals | None = None,
    *,
    lags: int = LAGS,
    level: float = 0.99,
    output_name: str = "the output",
    input_names: Sequence[str] = (),
    uncertain: Signals | None = None,
) -> ResidualTest:
    """Whether one output's residuals are independent of present and past inputs, lags 0…lags.

    Args:
        errors: residuals of one output, (N,), or one such array a record; NaN are left out.
        inputs: all inputs, (N, nu), or one such array a record.
        jacobian: ∂ŷ/∂θ of that output by what was estimated from these data, (N, n), or one such
            array a record. Without it a model fitted to these data passes too easily.
        lags: largest lag; lowered where there are fewer than 10 samples a correlation.
        uncertain: G√P of parameters estimated from other data, (N, k), or one such array a record.

    Means are removed: an offset is no dependence (whiteness shows it). The first ``lags`` samples
    of each record, whose past inputs are unknown, serve the projection only.

    Raises:
        DataError: shapes do not fit, an input is not finite, or fewer than 20 usable samples.
    """
    given = _OnInputs.of(errors, inputs, jacobian, uncertain)
    return _independence(given, lags, level, output_name, input_names)


def _independence(
    given: "_OnInputs", lags: int, level: float, output_name: str, input_names: Sequence[str]
) -> ResidualTest:
    result = _input_trial(given, lags, level, input_names, future=False)
    if result.dof == 0:
        sentence = f"No input direction can be tested on {output_name}: excite the input more."
    elif result.passed:
        sentence = f"The residuals of {output_name} do not depend on past inputs ({result.says})."
    else:
        sentence = (
            f"The residuals of {output_name} are correlated with the inputs ({result.says}), "
            "mostly with "
            f"{result.signal} {result.lag} samples earlier: dynamics are missing; raise nb and "
            "nf (or na), check the delay nk, or try a nonlinear structure."
        )
    return result.test("independence", output_name, True, sentence)


def feedback_test(
    errors: Signals,
    inputs: Signals,
    jacobian: Signals | None = None,
    *,
    lags: int = LAGS,
    level: float = 0.99,
    output_name: str = "the output",
    input_names: Sequence[str] = (),
    uncertain: Signals | None = None,
) -> ResidualTest:
    """Whether one output's residuals are followed by reactions of the inputs, lags −lags…−1.

    Future inputs count only for what present and past inputs do not predict of them (Sims 1972):
    otherwise a model that is too small would look like feedback wherever the input is slow.
    Arguments and errors as in :func:`independence_test`. Never judged: feedback is a property of
    the data, with which models that carry a noise model (ARX, ARMAX, BJ) can live.
    """
    given = _OnInputs.of(errors, inputs, jacobian, uncertain)
    return _feedback(given, lags, level, output_name, input_names)


def _feedback(
    given: "_OnInputs", lags: int, level: float, output_name: str, input_names: Sequence[str]
) -> ResidualTest:
    result = _input_trial(given, lags, level, input_names, future=True)
    if result.dof == 0:
        sentence = f"The inputs are predictable: feedback from {output_name} cannot be tested."
    elif result.passed:
        sentence = f"No sign of feedback from {output_name} to the inputs ({result.says})."
    else:
        sentence = (
            f"{result.signal} responds to {output_name} ({result.says}): the log is of a closed "
            "loop; prefer structures with a noise model and check OE and delays."
        )
    return result.test("feedback", output_name, False, sentence)


def residual_report(
    errors: Signals,
    inputs: Signals,
    jacobians: Sequence[Signals] | None = None,
    *,
    noise_model: bool = True,
    level: float = 0.99,
    output_names: Sequence[str] = (),
    input_names: Sequence[str] = (),
    uncertain: Sequence[Signals] | None = None,
) -> ResidualReport:
    """All residual tests of a model with ny outputs and nu inputs.

    Args:
        errors: one-step residuals, (N, ny), or one such array a record.
        inputs: (N, nu), or one such array a record.
        jacobians: for each output ∂ŷ/∂θ as (N, n), or one such array a record, by what was
            estimated from these data.
        noise_model: False for OE and other noise-free structures: whiteness is then reported
            but not judged.
        level: confidence level of each kind of test over all outputs.
        uncertain: for each output G√P of what was estimated from other data, as ``jacobians``.

    Raises:
        DataError: shapes do not fit, or too few samples.
    """
    es = as_records(errors, "errors")
    ny = es[0].shape[1]
    if jacobians is not None and len(jacobians) != ny:
        raise DataError(f"{ny} outputs but {len(jacobians)} Jacobians; give one for each output")
    names = tuple(output_names) or tuple(f"output {i + 1}" for i in range(ny))
    each = 1.0 - (1.0 - level) / ny
    white: list[ResidualTest] = []
    independent: list[ResidualTest] = []
    feedback: list[ResidualTest] = []
    for i, name in enumerate(names):
        jacobian = None if jacobians is None else jacobians[i]
        unsure = None if uncertain is None else uncertain[i]
        column = [e[:, i] for e in es]
        white.append(
            whiteness_test(
                es,
                jacobian,
                output=i,
                level=each,
                judged=noise_model,
                output_names=names,
                uncertain=unsure,
            )
        )
        given = _OnInputs.of(column, inputs, jacobian, unsure)
        independent.append(_independence(given, LAGS, each, name, input_names))
        feedback.append(_feedback(given, LAGS, each, name, input_names))
    return ResidualReport(tuple(white), tuple(independent), tuple(feedback), level)


@dataclass(frozen=True, eq=False)
class _OnInputs:
    """What the tests against inputs share, one array a record: see ``Trial``."""

    errors: Sequence[Array]
    inputs: Sequence[Array]
    jacobian: Sequence[Array]
    keep: Sequence[Mask]
    uncertain: Sequence[Array]
    noise: AutoRegression
    basis: Sequence[Array]

    @staticmethod
    def of(
        errors: Signals, inputs: Signals, jacobian: Signals | None, uncertain: Signals | None
    ) -> "_OnInputs":
        """One output's residuals without their means, their colour, what the fit absorbed."""
        es = one_output(errors)
        us = [centred(u) for u in inputs_of(inputs, [len(e) for e in es])]
        js = _jacobian_records(jacobian, es)
        keep = _complete([e[:, None] for e in es], js)
        _affordable(LAGS, keep, us[0].shape[1])  # refuses too few samples
        noise = ar_fit([np.where(k, centred(e), np.nan) for e, k in zip(es, keep, strict=True)])
        filled = [np.where(k, centred(e), 0.0) for e, k in zip(es, keep, strict=True)]
        unsure = _uncertain_records(uncertain, es)
        return _OnInputs(filled, us, js, keep, unsure, noise, orthonormal(js, keep, True))


def _input_trial(
    given: _OnInputs, lags: int, level: float, input_names: Sequence[str], *, future: bool
) -> ScoredTest:
    nu = given.inputs[0].shape[1]
    names = tuple(input_names) or tuple(f"input {i + 1}" for i in range(nu))
    lags = _affordable(lags, given.keep, nu * (2 if future else 1))
    past = range(lags + 1)
    trial = Trial(
        errors=given.errors,
        signals=given.inputs,
        jacobian=given.jacobian,
        keep=given.keep,
        rows=[k & _inside(len(k), lags, lags if future else 0) for k in given.keep],
        tested=range(-lags, 0) if future else past,
        nuisance=past if future else range(0),
        centred=True,
        noise=given.noise,
        uncertain=given.uncertain,
        basis=given.basis,
    )
    outcome = score(trial)
    return ScoredTest(outcome, outcome.dof, level, names, trial.tested)


def _complete(es: Sequence[Array], js: Sequence[Array]) -> list[Mask]:
    """Rows in which neither a residual nor its Jacobian is missing."""
    return [
        # column by column: NumPy's reductions along the short axis are ten times slower
        ~np.any([np.isnan(c) for c in (*e.T, *j.T)], axis=0)
        for e, j in zip(es, js, strict=True)
    ]


def _inside(samples: int, before: int, after: int) -> Mask:
    """Rows that have ``before`` samples before them and ``after`` behind them in the record."""
    t = np.arange(samples)
    return np.asarray((t >= before) & (t < samples - after))


def _affordable(lags: int, keep: Sequence[Mask], signals: int) -> int:
    """At most ``lags``, with 10 samples for every correlation, and at least 1.

    Raises:
        DataError: fewer than 20 samples.
    """
    samples = sum(int(k.sum()) for k in keep)
    if samples < 20:
        raise DataError(
            f"{samples} one-step errors are too few to judge a model: at least 20 are needed; "
            "record longer, or lower the orders"
        )
    return max(min(lags, samples // (10 * max(signals, 1))), 1)


def _uncertain_records(uncertain: Signals | None, es: Sequence[Array]) -> tuple[Array, ...]:
    """G√P by record, 0 where it is missing; no column where nothing was estimated elsewhere."""
    return tuple(np.nan_to_num(g) for g in _jacobian_records(uncertain, es))


def _jacobian_records(jacobian: Signals | None, es: Sequence[Array]) -> tuple[Array, ...]:
    if jacobian is None:
        return tuple(np.zeros((len(e), 0)) for e in es)
    records = as_records(jacobian, "jacobian")
    if [len(j) for j in records] != [len(e) for e in es]:
        raise DataError(
            f"{[len(e) for e in es]} residuals but Jacobians of {[len(j) for j in records]} rows"
        )
    return records
