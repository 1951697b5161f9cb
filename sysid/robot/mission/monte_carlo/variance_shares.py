"""Which varied quantity matters: shares of the variance of a figure, from the runs themselves.

The quantities are independent of each other, and so are the standard normal numbers z behind them.
A figure is regressed on z, and on z² − 1 of a quantity with few numbers (its polynomial chaos of
second order without products). The first-order share of a quantity (Sobol's) is what the residual
sum grows by when its columns are left out, less what columns without any meaning would take.
The remainder is listed separately: sensor noise, interactions, and curves beyond the second order.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array, Index

FEW = 8
"""Numbers of a quantity up to which their squares are regressors as well."""

ROWS_A_COLUMN = 4
"""Runs for each regressor, at least: with fewer a share is mostly chance."""

Varying = Sequence[tuple[str, tuple[int, ...]]]
"""Names of what varies, with the indices of their numbers, see ``Sampler.varying``."""


@dataclass(frozen=True)
class VarianceShare:
    """How much of a figure's variance one varied quantity makes alone."""

    name: str
    share_of_variance: float


@dataclass(frozen=True)
class Shares:
    """Shares of the variance of one figure.

    Attributes:
        ranked: the quantities, the largest share first.
        remainder: what none of them explains alone.
    """

    ranked: tuple[VarianceShare, ...]
    remainder: float


def moments(inputs: Array, varying: Varying, figure: Array, counts: Array) -> Array:
    """Sums over some runs that a regression needs: [1, X, y]ᵀ[1, X, y]; those of two sets add.

    Args:
        inputs: numbers behind the quantities, (K, m).
        figure: (K,).
        counts: which runs have the figure, (K,) of bool.
    """
    used = inputs[counts]
    columns = [np.ones(len(used)), *used.T]
    columns += [used[:, k] ** 2 - 1.0 for k in _squared(varying)]
    # sums in one order whatever library multiplies matrices
    X = np.stack([*columns, figure[counts]], axis=1)
    gram = np.array([[np.add.reduce(a * b) for b in X.T] for a in X.T])
    return gram.reshape(X.shape[1], X.shape[1])


def shares(G: Array, varying: Varying) -> Shares | None:
    """Shares of a figure's variance by the sums of all runs; None for too few, or equal ones."""
    n, p = G[0, 0], len(G) - 1
    if n < ROWS_A_COLUMN * p or n < 2:
        return None
    centred = G[1:, 1:] - np.outer(G[1:, 0], G[0, 1:]) / n
    total = float(centred[-1, -1])
    if total <= 1e-18 * G[-1, -1]:  # rounding of equal figures
        return None
    A, b = centred[:-1, :-1], centred[:-1, -1]
    unexplained = _residual(A, b, total, np.arange(len(b)))
    chance = unexplained / (n - p)  # what one column without meaning takes
    single = []
    for name, columns in _columns(varying):
        others = np.setdiff1d(np.arange(len(b)), columns)
        gained = _residual(A, b, total, others) - unexplained - len(columns) * chance
        single.append(VarianceShare(name, float(np.clip(gained / total, 0.0, 1.0))))
    ranked = tuple(sorted(single, key=lambda d: -d.share_of_variance))
    explained = sum(d.share_of_variance for d in ranked)
    return Shares(ranked, max(0.0, 1.0 - explained))


def _squared(varying: Varying) -> list[int]:
    """Places, among the inputs that are used, whose squares are regressors."""
    squared: list[int] = []
    at = 0
    for _, indices in varying:
        if len(indices) <= FEW:
            squared += range(at, at + len(indices))
        at += len(indices)
    return squared


def _columns(varying: Varying) -> list[tuple[str, Index]]:
    """Regressors of each quantity: its numbers, then their squares."""
    squared = _squared(varying)
    width, at = sum(len(indices) for _, indices in varying), 0
    regressors: list[tuple[str, Index]] = []
    for name, indices in varying:
        columns = list(range(at, at + len(indices)))
        columns += [width + squared.index(k) for k in columns if k in squared]
        regressors.append((name, np.array(columns, dtype=np.intp)))
        at += len(indices)
    return regressors


def _residual(A: Array, b: Array, total: float, kept: Index) -> float:
    if not len(kept):
        return total
    beta = np.linalg.lstsq(A[np.ix_(kept, kept)], b[kept], rcond=1e-12)[0]
    return max(total - float(beta @ b[kept]), 0.0)
