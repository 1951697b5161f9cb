"""ARX by linear algebra: no iteration, no regressor matrix in memory."""

import operator
from collections.abc import Callable, Iterable, Sequence
from functools import reduce

import numpy as np

from sysid.criteria.coloured import coloured_gram
from sysid.data.record import Array, Record
from sysid.fitting import normal_equations as ne
from sysid.fitting.uncertainty import (
    AR_ORDER,
    PART,
    half_of,
    portmanteau_white,
    sandwich,
    with_infinite,
)
from sysid.structures.linear.families import ARX

SANDWICH_SAMPLES = 100_000
"""The sandwich form needs the regressors in memory: it is measured on at most this many samples."""


def solve(
    structure: ARX, records: Sequence[Record], along: Array | None = None
) -> tuple[Array, Array, Array]:
    """θ, its covariance, and the directions without information (n, n_null).

    Args:
        structure, records: what is fitted to what.
        along: combinations of θ, (n, m), whose covariance (m, m) is wanted instead; where errors
            are coloured, few of them cost a fraction of all.
    """
    ny = structure.ny
    layouts = [structure.layout(i) for i in range(ny)]
    n = sum(lay.n for lay in layouts)
    m = n if along is None else along.shape[1]
    theta, covariance = np.zeros(n), np.zeros((m, m))
    null: list[Array] = []
    grams: dict[int, ne.LagGram] = {}
    for i, lay in enumerate(layouts):
        index = structure.row_index(i)
        terms = lay.terms
        start = lay.start
        if start not in grams:
            grams[start] = ne.lag_gram(records, start)
        gram = grams[start]
        solved = ne.solve(gram, gram.column(i, 0), [gram.column(s, k) for s, k in terms])
        if solved is None:
            solved = ne.solve_by_blocks(records, start, i, terms)
        sign = lay.signs
        theta[index] = sign * solved.theta
        weighed = [(s, k, float(c)) for (s, k), c in zip(terms, solved.theta, strict=True)]
        errors = [ne.residual_row((*r.y.T, *r.u.T), start, i, weighed) for r in records]
        if along is None:
            block = _covariance(records, errors, start, terms, solved)
            covariance[np.ix_(index, index)] = np.outer(sign, sign) * block
        else:
            weights = sign[:, None] * along[index]
            covariance += _covariance(records, errors, start, terms, solved, weights)
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
    solutions: dict[int, ne.LagGram] = {}
    for i in range(structure.ny):
        lay = structure.layout(i)
        terms, start = lay.terms, lay.start
        if start not in solutions:
            grams = (ne.lag_gram([r], start) for r in blocks(start))
            solutions[start] = reduce(operator.add, grams)
        gram = solutions[start]
        solved = ne.solve(gram, gram.column(i, 0), [gram.column(s, k) for s, k in terms])
        if solved is None:
            solved = ne.solve_by_blocks(blocks(start), start, i, terms)
        index = structure.row_index(i)
        theta[index] = lay.signs * solved.theta
        share = sum(max(len(r) - start, 0) for r in some) / gram.samples
        covariance[np.ix_(index, index)] *= share
    return theta, covariance, null


def _covariance(
    records: Sequence[Record],
    errors: Sequence[Array],
    start: int,
    terms: Sequence[tuple[int, int]],
    solved: ne.LeastSquares,
    along: Array | None = None,
) -> Array:
    """σ²(ΦᵀΦ)⁻¹, or the sandwich form when the errors are not white; of combinations if asked."""
    samples = sum(len(e) for e in errors)
    dof = max(samples - (len(terms) - solved.null.shape[1]), 1)
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
                    np.column_stack([signals[s][start - k : start - k + m] for s, k in terms])
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
