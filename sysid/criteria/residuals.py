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

import numpy as np

from sysid.criteria.fit import Signals, as_records, one_output
from sysid.criteria.nonlinear import further_tests
from sysid.criteria.output_residuals import (
    OutputResiduals,
    affordable,
    complete,
    jacobian_records,
    named,
    uncertain_records,
)
from sysid.criteria.portmanteau import Trial, score
from sysid.criteria.verdicts import ResidualReport, ResidualTest, verdict
from sysid.errors import DataError

LEVEL = 0.99
"""Confidence level of each kind of test over all outputs."""

_NOT_WHITE = (
    "The residuals of {output} are not white ({p}), {signal} {lag} samples earlier is the best "
    "predictor: "
)
_WHITENESS = {
    judged: (
        "The residuals of {output} are white up to lag {last} ({p}).",
        _NOT_WHITE + advice,
        "The residuals of {output} are zero: nothing to test.",
    )
    for judged, advice in (
        (True, "raise the orders of the noise model (nc, nd) or of the dynamics."),
        (False, "acceptable for a structure without noise model."),
    )
}


def whiteness_test(
    errors: Signals,
    jacobian: Signals | None = None,
    *,
    output: int = 0,
    level: float = 0.99,
    judged: bool = True,
    output_names: Sequence[str] = (),
    uncertain: Signals | None = None,
) -> ResidualTest:
    """Whether one output's residuals are unpredictable from the past residuals of all outputs.

    Ljung–Box's portmanteau in its score form: Z holds ε(t−1)…ε(t−25) of every output (fewer where
    a record has fewer than 10 samples a correlation), C = σ̂²Z̃ᵀZ̃. The estimated parameters count
    for exactly what they absorb. The mean is not removed: residuals with an offset are not white.

    Args:
        errors: residuals of all outputs, (N, ny), or one such array a record; rows with NaN
            are left out.
        jacobian: ∂ŷ/∂θ of the tested output by what was estimated from these data, (N, n), or one
            such array a record.
        judged: False for a structure without noise model.
        uncertain: G√P of parameters estimated from other data, (N, k), or one such array a record.

    Raises:
        DataError: shapes do not fit, or fewer than 20 complete rows.
    """
    es = as_records(errors, "errors")
    names = named(output_names, "output", es)
    js = jacobian_records(jacobian, es)
    keep = complete(es, js)
    filled = [np.where(k[:, None], e, 0.0) for k, e in zip(keep, es, strict=True)]
    trial = Trial(
        errors=one_output([e[:, output] for e in filled]),
        signals=filled,
        jacobian=js,
        keep=keep,
        rows=keep,
        tested=range(1, affordable(keep, len(names)) + 1),
        uncertain=uncertain_records(uncertain, es),
    )
    return verdict(
        score(trial), "whiteness", names[output], names, trial.tested, _WHITENESS[judged], level,
        judged,
    )  # fmt: skip


def residual_report(
    errors: Signals,
    inputs: Signals,
    jacobians: Sequence[Signals] | None = None,
    *,
    noise_model: bool = True,
    output_names: Sequence[str] = (),
    input_names: Sequence[str] = (),
    uncertain: Sequence[Signals] | None = None,
    nonlinear: bool = False,
) -> ResidualReport:
    """All residual tests of a model with ny outputs and nu inputs.

    Where the inputs respond to an output they do so in the same sample, too: its residuals are then
    tested against past inputs only, lags 1…25 (Ljung 1999, §16.6: correlation with inputs that
    are not past shows feedback, and no wrong model).

    Args:
        errors: one-step residuals, (N, ny), or one such array a record.
        inputs: (N, nu), or one such array a record.
        jacobians: for each output ∂ŷ/∂θ as (N, n), or one such array a record, by what was
            estimated from these data.
        noise_model: False for OE and other noise-free structures: whiteness is then reported
            but not judged.
        uncertain: for each output G√P of what was estimated from other data, as ``jacobians``.
        nonlinear: whether the model has to stand the further tests of ``nonlinear.py``.
    """
    es = as_records(errors, "errors")
    ny = es[0].shape[1]
    if jacobians is not None and len(jacobians) != ny:
        raise DataError(f"{ny} outputs but {len(jacobians)} Jacobians; give one for each output")
    names = named(output_names, "output", es)
    each = 1.0 - (1.0 - LEVEL) / ny
    tests: list[tuple[ResidualTest, ...]] = []
    for i, name in enumerate(names):
        jacobian = None if jacobians is None else jacobians[i]
        unsure = None if uncertain is None else uncertain[i]
        white = whiteness_test(
            es, jacobian, output=i, level=each, judged=noise_model, output_names=names,
            uncertain=unsure,
        )  # fmt: skip
        given = OutputResiduals.of(
            [e[:, i] for e in es], inputs, jacobian, unsure,
            input_names=input_names, output=name, level=each,
        )  # fmt: skip
        feedback = given.feedback()
        independence = given.independence(first=0 if feedback.passed else 1)
        further = further_tests(given, noise_model=noise_model) if nonlinear else ()
        tests.append((white, independence, feedback, *further))
    # one kind after the other
    whiteness, independent, answers, *more = zip(*tests, strict=True)
    further = tuple(t for kind in more for t in kind)
    return ResidualReport(whiteness, independent, answers, LEVEL, further)
