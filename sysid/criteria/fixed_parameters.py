"""Lagrange multiplier tests of parameters that were fixed, or that stopped at a bound.

A parameter that is fixed at θ_h takes no part in the fit; if its value is right, the residuals do
not correlate with its gradient g = ∂ŷ/∂θ_h, once what the estimated parameters took is projected
out of g. That is the Lagrange multiplier (score) test of the constraint, the portmanteau of
``portmanteau.py`` with the one instrument g; the sign of g̃ᵀε says where a better value lies.

Sources: Silvey (1959); Engle (1984), Handbook of Econometrics II, ch. 13.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.criteria.coloured import ar_fit
from sysid.criteria.fit import Array
from sysid.criteria.portmanteau import Mask, Score, Trial, score
from sysid.criteria.verdicts import ResidualTest, in_words

MIN_RESIDUALS = 20
"""Residuals below which nothing is tested, as in ``residuals.py``."""


@dataclass(frozen=True)
class FixedParameter:
    """A parameter that was not estimated.

    Attributes:
        value: the value it was held at.
        lower, upper: its bounds; one of them is the value where it stopped at a bound.
        stuck: whether a bound stopped it; False for a value that was given.
    """

    name: str
    value: float
    lower: float
    upper: float
    stuck: bool


def fixed_parameter_tests(
    errors: Sequence[Array],
    free: Sequence[Array],
    fixed: Sequence[Array],
    parameters: Sequence[FixedParameter],
    *,
    noise_model: bool = True,
    level: float = 0.99,
) -> tuple[ResidualTest, ...]:
    """One test a held parameter, over all outputs and records at once.

    Outputs are weighted by the size of their residuals. For a structure without noise model the
    residuals' colour comes from an AR(20) fit.

    Args:
        errors: residuals (N, ny) of each record; rows with NaN are left out.
        free: ∂ŷ/∂θ by the estimated parameters, (N, ny, n) each record.
        fixed: ∂ŷ/∂θ by the held ones, (N, ny, k) each record.
        parameters: the k held ones.
        noise_model: whether the structure has one.
        level: confidence level, shared among the parameters (Bonferroni).
    """
    known: list[Mask] = [np.asarray(~np.isnan(e).any(axis=1)) for e in errors]
    if sum(int(k.sum()) for k in known) < MIN_RESIDUALS or not parameters:
        return ()
    pooled = np.concatenate([e[k] for e, k in zip(errors, known, strict=True)])
    sizes = np.sqrt(np.mean(pooled**2, axis=0))
    es: list[Array] = []
    js: list[Array] = []
    hs: list[Array] = []
    keep: list[Mask] = []
    for e, j, h, rows in zip(errors, free, fixed, known, strict=True):
        for i, size in enumerate(sizes):
            if size > 0.0:
                es.append(np.where(rows, e[:, i], 0.0) / size)
                js.append(np.where(rows[:, None], j[:, i], 0.0) / size)
                hs.append(np.where(rows[:, None], h[:, i], 0.0) / size)
                keep.append(rows)
    if not es:
        return ()
    noise = None if noise_model else ar_fit(es)
    share = 1.0 - (1.0 - level) / len(parameters)
    tests = []
    for k, parameter in enumerate(parameters):
        signals = [h[:, [k]] for h in hs]
        trial = Trial(es, signals, js, keep, tested=range(1), rows=keep, noise=noise)
        tests.append(_verdict(parameter, score(trial), share))
    return tuple(tests)


def _verdict(parameter: FixedParameter, scored: Score, level: float) -> ResidualTest:
    larger = bool(scored.parts[0, 0] > 0.0)
    where, at = "larger" if larger else "smaller", f"{parameter.value:.6g}"
    agrees = f"The data agree with {parameter.name} fixed at {at}"
    contradicts = f"The data contradict {parameter.name} fixed at {at}"
    advice = f"a {where} value fits better; estimate this parameter, or check the structure."
    p_value = scored.p_value
    if parameter.stuck:
        agrees = f"{parameter.name} ended at its bound {at}, and the data agree with that value"
        contradicts = (
            f"{parameter.name} ended at its bound {at}, but a {where} value fits the data better"
        )
        advice = "widen the bound or check the structure."
        # a bound contradicts the data only where a better value lies beyond it
        above = parameter.upper - parameter.value < parameter.value - parameter.lower
        p_value = p_value if larger == above else 1.0
    passed = p_value >= 1.0 - level
    p = in_words(p_value)
    return ResidualTest(
        name="held parameter",
        output=parameter.name,
        statistic=scored.statistic,
        dof=scored.dof,
        p_value=p_value,
        passed=passed,
        level=level,
        worst_lag=None,
        worst_signal=parameter.name,
        judged=True,
        sentence=f"{agrees} ({p})." if passed else f"{contradicts} ({p}): {advice}",
    )
