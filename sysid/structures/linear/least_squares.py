"""ARX by linear algebra, of one order or of many at once: no iteration, no regressor matrix."""

import operator
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, reduce

import numpy as np

from sysid.criteria.coloured import coloured_gram
from sysid.data.record import Array, Record
from sysid.fitting import normal_equations as ne
from sysid.fitting.holdout import HoldOut
from sysid.fitting.uncertainty import (
    AR_ORDER,
    PART,
    half_of,
    portmanteau_white,
    sandwich,
    with_infinite,
)
from sysid.structures.linear.families import ARX
from sysid.structures.linear.predictor import RowLayout

SANDWICH_SAMPLES = 100_000
"""The sandwich form needs the regressors in memory: it is measured on at most this many samples."""


def solved_row(gram: ne.LagGram, lay: RowLayout, records: Iterable[Record]) -> ne.LeastSquares:
    """Least squares of one row: from the Gram matrix, or by QR where that is ill-conditioned."""
    columns = [gram.column(s, k) for s, k in lay.terms]
    solved = ne.solve(gram, gram.column(lay.output, 0), columns)
    return solved or ne.solve_by_blocks(records, gram.start, lay.output, lay.terms)


def solve(
    structure: ARX, records: Sequence[Record], along: Array | None = None
) -> tuple[Array, Array, Array]:
    """θ, its covariance, and the directions without information (n, n_null).

    Args:
        structure, records: what is fitted to what.
        along: combinations of θ, (n, m), whose covariance (m, m) is wanted instead; where errors
            are coloured, few of them cost a fraction of all.
    """
    layouts = [structure.layout(i) for i in range(structure.ny)]
    n = sum(lay.n for lay in layouts)
    m = n if along is None else along.shape[1]
    theta, covariance = np.zeros(n), np.zeros((m, m))
    null: list[Array] = []

    @cache
    def gram(start: int) -> ne.LagGram:
        return ne.lag_gram(records, start)

    for i, lay in enumerate(layouts):
        index, sign = structure.row_index(i), lay.signs
        solved = solved_row(gram(lay.start), lay, records)
        theta[index] = sign * solved.theta
        weighed = lay.weighed(theta[index])
        errors = [ne.residual_row((*r.y.T, *r.u.T), lay.start, i, weighed) for r in records]
        if along is None:
            block = _covariance(records, errors, lay, solved)
            covariance[np.ix_(index, index)] = np.outer(sign, sign) * block
        else:
            covariance += _covariance(records, errors, lay, solved, sign[:, None] * along[index])
        for direction in solved.null.T:
            spread = np.zeros(n)
            spread[index] = sign * direction
            null.append(spread)
    unseen = np.array(null).T if null else np.zeros((n, 0))
    touched = unseen if along is None else (along != 0.0).T @ (np.abs(unseen) > PART)
    return theta, with_infinite(covariance, touched), unseen


def solve_in_blocks(
    structure: ARX, blocks: Callable[[int], Iterable[Record]], some: Sequence[Record]
) -> tuple[Array, Array, Array]:
    """As ``solve``, over records that need not be in memory together.

    The covariance is that of the errors in ``some`` of them, scaled to as many samples.

    Args:
        structure: what is fitted.
        blocks: lead → records; each continues the last one and begins with its ``lead`` last rows.
        some: a few of these records.
    """
    theta, covariance, null = solve(structure, some)

    @cache
    def gram(start: int) -> ne.LagGram:
        return reduce(operator.add, (ne.lag_gram([r], start) for r in blocks(start)))

    for i in range(structure.ny):
        lay, index = structure.layout(i), structure.row_index(i)
        solved = solved_row(gram(lay.start), lay, blocks(lay.start))
        theta[index] = lay.signs * solved.theta
        share = sum(max(len(r) - lay.start, 0) for r in some) / gram(lay.start).samples
        covariance[np.ix_(index, index)] *= share
    return theta, covariance, null


def _covariance(
    records: Sequence[Record],
    errors: Sequence[Array],
    lay: RowLayout,
    solved: ne.LeastSquares,
    along: Array | None = None,
) -> Array:
    """σ²(ΦᵀΦ)⁻¹, or the sandwich form when the errors are not white; of combinations if asked."""
    samples, start = sum(len(e) for e in errors), lay.start
    dof = max(samples - (len(lay.terms) - solved.null.shape[1]), 1)
    variance = sum(float(e @ e) for e in errors) / dof
    inverse = solved.inverse if along is None else along.T @ solved.inverse @ along
    covariance = variance * inverse
    if not portmanteau_white(errors) and samples > 5 * AR_ORDER:
        phis, kept, room = [], [], SANDWICH_SAMPLES
        for r, e in zip(records, errors, strict=True):
            m = min(len(e), room)
            if m > 0:
                signals = (*r.y.T, *r.u.T)
                phis.append(
                    np.column_stack([signals[s][start - k : start - k + m] for s, k in lay.terms])
                )
                kept.append(e[:m])
                room -= m
        used = sum(len(e) for e in kept)
        if along is None:
            covariance = sandwich(half_of(solved.inverse), phis, kept)
        else:
            columns = solved.inverse @ along
            covariance = coloured_gram([phi @ columns for phi in phis], kept, AR_ORDER)
        covariance *= (samples / used) * (samples / dof)
    return np.asarray(covariance)


# ----------------------------------------------------------------------------- many orders at once

SIMULATED = 16
"""Candidates, best one-step first, whose free run is looked at."""


@dataclass(frozen=True, eq=False)
class Solved:
    """Least squares of one set of orders.

    Attributes:
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
    return ne.scaled_solution(H, gram.matrix[list(columns), target])


def _log_det(covariance: Array) -> float:
    sign, value = np.linalg.slogdet(covariance)
    return float(value) if sign > 0 else float("-inf")
