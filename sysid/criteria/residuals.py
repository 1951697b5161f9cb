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
from functools import cached_property

import numpy as np

from sysid.criteria.coloured import AutoRegression, ar_fit
from sysid.criteria.fit import Array, Signals, as_records, centred, inputs_of, one_output
from sysid.criteria.portmanteau import Mask, Trial, orthonormal, score
from sysid.criteria.verdicts import ResidualReport, ResidualTest, ScoredTest
from sysid.errors import DataError

LAGS = 25
"""Largest lag tested, each way: the choice of Ljung (1999) §16.6; lowered on short records."""

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
_INDEPENDENCE = (
    "The residuals of {output} do not depend on past inputs ({p}).",
    "The residuals of {output} are correlated with the inputs ({p}), mostly with {signal} {lag} "
    "samples earlier: dynamics are missing; raise nb and nf (or na), check the delay nk, or try a "
    "nonlinear structure.",
    "No input direction can be tested on {output}: excite the input more.",
)
_FEEDBACK = (
    "No sign of feedback from {output} to the inputs ({p}).",
    "{signal} responds to {output} ({p}): the log is of a closed loop; prefer structures with a "
    "noise model and check OE and delays.",
    "The inputs are predictable: feedback from {output} cannot be tested.",
)


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
    js = _jacobian_records(jacobian, es)
    keep = _complete(es, js)
    filled = [np.where(k[:, None], e, 0.0) for k, e in zip(keep, es, strict=True)]
    trial = Trial(
        errors=one_output([e[:, output] for e in filled]),
        signals=filled,
        jacobian=js,
        keep=keep,
        rows=keep,
        tested=range(1, _affordable(keep, len(names)) + 1),
        uncertain=_uncertain_records(uncertain, es),
    )
    result = ScoredTest(score(trial), level, names, trial.tested)
    return result.test("whiteness", names[output], _WHITENESS[judged], judged=judged)


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
    given = OnInputs.of(errors, inputs, jacobian, uncertain, input_names)
    return _independence(given, level, output_name, lags)


def feedback_test(
    errors: Signals,
    inputs: Signals,
    jacobian: Signals | None = None,
    *,
    level: float = 0.99,
    output_name: str = "the output",
    input_names: Sequence[str] = (),
    uncertain: Signals | None = None,
) -> ResidualTest:
    """Whether one output's residuals are followed by reactions of the inputs, lags −25…−1.

    Future inputs count only for what present and past inputs do not predict of them (Sims 1972):
    otherwise a model that is too small would look like feedback wherever the input is slow.
    Arguments and errors as in :func:`independence_test`. Never judged: feedback is a property of
    the data, with which models that carry a noise model (ARX, ARMAX, BJ) can live.
    """
    given = OnInputs.of(errors, inputs, jacobian, uncertain, input_names)
    return _feedback(given, level, output_name)


def _independence(
    given: "OnInputs", level: float, output: str, lags: int = LAGS, first: int = 0
) -> ResidualTest:
    past = range(first, given.affordable(lags) + 1)
    trial = given.trial(given.inputs, past, noise=given.noise)
    result = ScoredTest(score(trial), level, given.names, past)
    return result.test("independence", output, _INDEPENDENCE)


def _feedback(given: "OnInputs", level: float, output: str) -> ResidualTest:
    lags = given.affordable(LAGS, 2)
    future = range(-lags, 0)
    trial = given.trial(given.inputs, future, range(lags + 1), noise=given.noise)
    result = ScoredTest(score(trial), level, given.names, future)
    return result.test("feedback", output, _FEEDBACK, judged=False)


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
        level: confidence level of each kind of test over all outputs.
        uncertain: for each output G√P of what was estimated from other data, as ``jacobians``.
    """
    es = as_records(errors, "errors")
    ny = es[0].shape[1]
    if jacobians is not None and len(jacobians) != ny:
        raise DataError(f"{ny} outputs but {len(jacobians)} Jacobians; give one for each output")
    names = named(output_names, "output", es)
    each = 1.0 - (1.0 - level) / ny
    tests: list[tuple[ResidualTest, ...]] = []
    for i, name in enumerate(names):
        jacobian = None if jacobians is None else jacobians[i]
        unsure = None if uncertain is None else uncertain[i]
        white = whiteness_test(
            es, jacobian, output=i, level=each, judged=noise_model, output_names=names,
            uncertain=unsure,
        )  # fmt: skip
        given = OnInputs.of([e[:, i] for e in es], inputs, jacobian, unsure, input_names)
        feedback = _feedback(given, each, name)
        first = 0 if feedback.passed else 1
        tests.append((white, _independence(given, each, name, first=first), feedback))
    whiteness, independence, answers = zip(*tests, strict=True)
    return ResidualReport(whiteness, independence, answers, level)


@dataclass(frozen=True, eq=False)
class OnInputs:
    """What the tests of one output against inputs share, one array a record: see ``Trial``.

    Attributes:
        known: residuals without their means, (N,), NaN where missing.
        inputs: without their means, (N, nu).
        jacobian, uncertain, keep: as a ``Trial`` has them.
    """

    known: Sequence[Array]
    inputs: Sequence[Array]
    names: tuple[str, ...]
    jacobian: Sequence[Array]
    uncertain: Sequence[Array]
    keep: Sequence[Mask]

    @staticmethod
    def of(
        errors: Signals,
        inputs: Signals,
        jacobian: Signals | None,
        uncertain: Signals | None,
        input_names: Sequence[str],
    ) -> "OnInputs":
        """One output's residuals, and what the fit absorbed.

        Raises:
            DataError: shapes do not fit, an input is not finite, or fewer than 20 usable samples.
        """
        es = one_output(errors)
        us = [centred(u) for u in inputs_of(inputs, [len(e) for e in es])]
        js = _jacobian_records(jacobian, es)
        keep = _complete([e[:, None] for e in es], js)
        _affordable(keep, us[0].shape[1])  # refuses too few samples
        known = [np.where(k, centred(e), np.nan) for k, e in zip(keep, es, strict=True)]
        names = named(input_names, "input", us)
        return OnInputs(known, us, names, js, _uncertain_records(uncertain, es), keep)

    @cached_property
    def filled(self) -> list[Array]:
        """Residuals with 0 where they are missing."""
        return [np.nan_to_num(e) for e in self.known]

    @cached_property
    def noise(self) -> AutoRegression:
        """The colour of the residuals."""
        return ar_fit(self.known)

    @cached_property
    def basis(self) -> Sequence[Array]:
        """``orthonormal`` of the Jacobian."""
        return orthonormal(self.jacobian, self.keep, True)

    def affordable(self, lags: int = LAGS, ways: int = 1) -> int:
        """At most ``lags`` of all inputs, tested in so many ways, see ``_affordable``."""
        return _affordable(self.keep, ways * len(self.names), lags)

    def trial(
        self,
        signals: Sequence[Array],
        tested: range,
        nuisance: range = range(0),
        *,
        noise: AutoRegression | None,
    ) -> Trial:
        """A test of the residuals against lags of signals, (N, nu)."""
        before, after = max(*tested, *nuisance), max(-tested[0], 0)
        return Trial(
            errors=self.filled,
            signals=signals,
            jacobian=self.jacobian,
            keep=self.keep,
            rows=[k & _inside(len(k), before, after) for k in self.keep],
            tested=tested,
            nuisance=nuisance,
            centred=True,
            noise=noise,
            uncertain=self.uncertain,
            basis=self.basis,
        )


def named(given: Sequence[str], kind: str, records: Sequence[Array]) -> tuple[str, ...]:
    """The names of the columns of records; ``input 1`` … where none are given."""
    return tuple(given) or tuple(f"{kind} {i + 1}" for i in range(records[0].shape[1]))


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


def _affordable(keep: Sequence[Mask], signals: int, lags: int = LAGS) -> int:
    """At most ``lags``, with 10 samples for every correlation, and at least 1."""
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
