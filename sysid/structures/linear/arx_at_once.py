"""ARX of many orders at once, from two Gram matrices of lagged signals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.fitting import normal_equations as ne
from sysid.fitting.holdout import HoldOut
from sysid.structures.linear.families import ARX

SIMULATED = 16
"""Candidates, best one-step first, whose free run is looked at."""


@dataclass(frozen=True, eq=False)
class Solved:
    """Least squares of one set of orders.

    Attributes:
        structure: with these orders.
        theta: estimates, (n,).
        log_det: log determinant of the one-step errors' covariance on the records to fit on.
        holdout_log_det: the same on the held-out records.
        samples: equations on the records to fit on.
    """

    structure: ARX
    theta: Array
    log_det: float
    holdout_log_det: float
    samples: int


def solved_at_once(structures: Sequence[ARX], data: HoldOut) -> list[Solved]:
    """Least squares for every structure: sub-matrices of the Gram matrix of the largest one.

    Args:
        structures: of the same channels.
        data: what to fit and what to choose on, offsets removed.

    Returns:
        One entry a structure; none where a part is shorter than the largest lag.
    """
    layouts = [[s.layout(i) for i in range(s.ny)] for s in structures]
    lags = max(lay.start for rows in layouts for lay in rows)
    inside, outside = ne.lag_gram(data.train, lags), ne.lag_gram(data.holdout, lags)
    if inside.samples == 0 or outside.samples == 0:
        return []
    solved = []
    for s, rows in zip(structures, layouts, strict=True):
        weights = np.zeros((s.ny, len(inside.matrix)))
        theta = []
        for i, lay in enumerate(rows):
            columns = [inside.column(*term) for term in lay.terms]
            row = _row(inside, inside.column(i, 0), columns)
            weights[i, inside.column(i, 0)] = 1.0
            weights[i, columns] -= row
            theta.append(lay.signs * row)
        covariance = weights @ inside.matrix @ weights.T / inside.samples
        holdout = weights @ outside.matrix @ weights.T / outside.samples
        solved.append(
            Solved(
                s, np.concatenate(theta), _log_det(covariance), _log_det(holdout), inside.samples
            )
        )
    return solved


def promising(solved: Sequence[Solved]) -> list[Solved]:
    """The best held-out one-step models, and the best of each size: a free run has other tastes."""
    ordered = sorted(solved, key=lambda a: a.holdout_log_det)
    sizes = {len(a.theta): k for k, a in reversed(list(enumerate(ordered)))}
    shown = sorted(set(range(min(SIMULATED, len(ordered)))) | set(sizes.values()))
    return [ordered[k] for k in shown]


def _row(gram: ne.LagGram, target: int, columns: Sequence[int]) -> Array:
    """Coefficients of one output's equation, by a pseudo-inverse where it is ill-conditioned."""
    solved = ne.solve(gram, target, columns)
    if solved is not None:
        return solved.theta
    H = gram.matrix[np.ix_(columns, columns)]
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    right = gram.matrix[list(columns), target] / scale
    return np.asarray(np.linalg.lstsq(H / np.outer(scale, scale), right, rcond=1e-12)[0] / scale)


def _log_det(covariance: Array) -> float:
    sign, value = np.linalg.slogdet(covariance)
    return float(value) if sign > 0 else float("-inf")
