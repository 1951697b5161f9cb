"""Intervals of two lags in series, which the output cannot assign to motor and sensor.

A first-order motor with a first-order lag has the transfer function K / ((τ s + 1)(λ s + 1)), which
is the same when τ and λ are exchanged. Gradients at one solution ignore the other. So the exchanged
solution is fitted as well, and where the log does not contradict it the interval holds both.

Where τ ≈ λ the gradient along τ − λ vanishes and standard errors diverge, but the sum s and product
p of the lags stay regular: the interval is limited to the roots of x² − s·x + p for s and p in
their own 95 % intervals.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnosis.augment import covariance_of, std_errors
from sysid.diagnosis.base_model import Base
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.search.evidence import effective_samples
from sysid.diagnosis.search.lags import exchanged, lags_of
from sysid.diagnosis.search.selection import CandidateModel, Interval, Selection
from sysid.fitting.profile import LEVEL, NORMAL


def with_exchanged_lags(base: Base, selection: Selection) -> Selection:
    """The selection with intervals that hold a lag's other place where the log allows it.

    Of both places the likelier one is the estimate.
    """
    for n in selection.selected:
        lags = lags_of(base.search.model, selection.final)
        selection = _with_both(
            base, selection, [k for k in lags if base.search.model.parameters[k].owner == n.id]
        )
    return selection


def _with_both(base: Base, selection: Selection, lags: Sequence[int]) -> Selection:
    here = selection.final
    there = _other_place(base, here, lags)
    if there is None:
        return selection
    samples = effective_samples(here.errors.estimation)
    (v, _), (w, _) = here.errors.mean_squares(), there.errors.mean_squares()
    beyond = samples * np.log(w / v)
    if base.search.model.joined(here.q, here.free):
        beyond = np.full_like(beyond, float(np.sum(beyond)))
    if float(np.sum(beyond)) < 0.0:
        here, there, beyond = there, here, -beyond
        v, w = w, v
    alike = (beyond < LEVEL) | (np.sqrt(w / v) < RULE.known_tie)
    intervals = dict(selection.intervals)
    errors_here, errors_there = std_errors(base, here), std_errors(base, there)
    for k in lags:
        if alike[base.search.model.parameters[k].track]:
            ends = [
                candidate.q[k] + side * NORMAL * errors[k]
                for candidate, errors in ((here, errors_here), (there, errors_there))
                for side in (-1.0, 1.0)
            ]
            least, most = _roots(base, here, k)
            intervals[k] = Interval(float(max(min(ends), least)), float(min(max(ends), most)))
    return replace(selection, final=here, intervals=intervals)


def _roots(base: Base, candidate: CandidateModel, lag: int) -> tuple[float, float]:
    """The least and the greatest of two lags in a row by 95 % of their sum and their product."""
    model = base.search.model
    pole = model.index["core", "f1", model.parameters[lag].track]
    at = [candidate.free.index(k) for k in (pole, lag)]
    covariance = covariance_of(base, candidate)[np.ix_(at, at)]
    logarithm = np.log(-candidate.q[pole])
    a, b = -model.dt / logarithm, candidate.q[lag]
    slope = model.dt / (logarithm**2 * candidate.q[pole])  # of the time constant by f1
    rows = np.array([[slope, 1.0], [slope * b, a]])
    total, product = a + b, a * b
    d_total, d_product = NORMAL * np.sqrt(np.diag(rows @ covariance @ rows.T))
    apart = np.sqrt(max((total + d_total) ** 2 - 4.0 * max(product - d_product, 0.0), 0.0))
    return float(max(total + d_total - apart, 0.0) / 2.0), float(total + d_total + apart) / 2.0


def _other_place(
    base: Base, candidate: CandidateModel, lags: Sequence[int]
) -> CandidateModel | None:
    """The model searched from where lags and the core's time constants change places.

    None without lags, and where that model's run has no end.
    """
    if not lags:
        return None
    there = base.search.fitted(candidate, exchanged(base.search.model, candidate.q, lags))
    return there if np.all(np.isfinite(there.errors.mean_squares())) else None
