"""Outliers: single samples of an output that neither their neighbours nor the inputs explain."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.noise import ROBUST
from sysid.data.record import Array, Record

PASSES = 8
"""Searches of one record: the largest outliers hide the others, because they spoil the regression
that gives the innovations. Each pass finds those that stand out of what is left."""

THRESHOLD, HALF_WIDTH = 8.0, 4
"""Distances from the median of so many neighbours on either side, in typical ones, from which on a
sample stands out."""

LAGS = 4
"""Of the regression that gives the innovations."""

TYPICAL = 20_000
"""Samples at most, evenly spread, that say how far a typical one lies from its neighbours."""


@dataclass(frozen=True, eq=False)
class Bridged:
    """Records whose outliers are replaced, and which ones these were.

    Attributes:
        records: with the line between their neighbours in place of outliers.
        flags: of each record, the samples that were replaced, (N, ny).
    """

    records: tuple[Record, ...]
    flags: tuple[NDArray[np.bool_], ...]

    @property
    def words(self) -> str:
        """``12 measurements of rpm``, or nothing where none was replaced."""
        counts = np.sum([f.sum(axis=0) for f in self.flags], axis=0)
        parts = [
            f"{n} {'measurement' if n == 1 else 'measurements'} of {name}"
            for n, name in zip(counts.tolist(), self.records[0].output_names, strict=True)
            if n
        ]
        return " and ".join(parts)


def bridged(records: Sequence[Record]) -> Bridged:
    """The records with the line between their neighbours in place of every outlier.

    One measurement a hundred times too large outweighs all others in any correlation or least
    squares: what is asked of dynamics before a model is there has to be asked of these records.

    Args:
        records: experiments with the same channels.
    """
    flags = tuple(outlier_flags(r) for r in records)
    lines = (
        replace(r, y=_lines(r.y, f)) if f.any() else r for r, f in zip(records, flags, strict=True)
    )
    return Bridged(tuple(lines), flags)


def outlier_flags(record: Record) -> NDArray[np.bool_]:
    """Single samples of the outputs that stand out of their neighbourhood, shape (N, ny).

    The samples that one search finds are replaced by the line between their neighbours, and what
    is left is searched again until nothing more is found.
    """
    flags = np.zeros(record.y.shape, dtype=bool)
    if not np.all(np.isfinite(record.y)):
        return _one_search(record)
    remaining = record
    for _ in range(PASSES):
        more = _one_search(remaining) & ~flags
        if not more.any():
            break
        flags |= more
        remaining = replace(record, y=_lines(record.y, flags))
    return flags


def _lines(y: Array, flags: NDArray[np.bool_]) -> Array:
    """The line between the neighbours in place of flagged samples, (N, ny)."""
    y = y.copy()
    at = np.arange(len(y))
    for j in range(y.shape[1]):
        good = ~flags[:, j]
        if good.any():
            y[~good, j] = np.interp(at[~good], at[good], y[good, j])
    return y


def _one_search(record: Record) -> NDArray[np.bool_]:
    """One search of :func:`outlier_flags`, shape (N, ny).

    A Hampel filter: r = y − median of 2·HALF_WIDTH + 1 neighbours, flagged where |r| >
    THRESHOLD · s, with s = 1.4826 · median|r| taken in a window ten times as wide and over the
    whole record, whichever is larger, and not below the signal's resolution. A flagged sample must
    also leave both neighbours in the same direction, and the larger part of it must be an
    innovation of a short regression on past outputs and the inputs, so that a fast response to a
    short command is none. (Hampel 1974; Pearson 2002, IEEE Trans. Control Syst. Technol. 10(1).)
    """
    width = 2 * HALF_WIDTH + 1
    flags = np.zeros(record.y.shape, dtype=bool)
    if len(record) < 2 * width:
        return flags
    for j in range(record.ny):
        y = record.y[:, j]
        steps = np.diff(y)
        some = np.arange(0, len(y), -(-len(y) // TYPICAL))
        moves = np.abs(steps[some[:-1]])
        moves = moves[moves > 0.0]
        if not len(moves):
            continue
        typical_distance = ROBUST * float(np.median(_distance(y, some)))
        limit = THRESHOLD * max(typical_distance, float(np.percentile(moves, 10)))
        far = np.flatnonzero(np.abs(steps) > limit)
        back = (np.diff(far) == 1) & (steps[far[:-1]] * steps[far[1:]] < 0.0)
        candidates = far[:-1][back] + 1
        left, r, right = (_distance(y, candidates + k) for k in (-1, 0, 1))
        # beside a wild measurement a good one stands out too; the next pass tests it again
        kept = (r > limit) & (r >= left) & (r >= right)
        candidates, r = candidates[kept], r[kept]
        if not len(candidates):
            continue
        innovations = np.abs(_innovations(record, j))
        typical = ROBUST * float(np.median(innovations))
        unexplained = innovations[candidates] > np.maximum(0.5 * r, THRESHOLD * typical)
        for k, size in zip(candidates[unexplained], r[unexplained], strict=True):
            near = np.arange(max(k - 5 * width, 0), min(k + 5 * width + 1, len(y)))
            local = ROBUST * float(np.median(_distance(y, near)))
            flags[k, j] = size > THRESHOLD * local
    return flags


def _distance(y: Array, at: NDArray[np.int64]) -> Array:
    """|y − median of 2·HALF_WIDTH + 1 neighbours| at some samples, (n,)."""
    around = at[:, None] + np.arange(-HALF_WIDTH, HALF_WIDTH + 1)
    window = y[np.clip(around, 0, len(y) - 1)]
    return np.asarray(np.abs(y[at] - np.median(window, axis=1)))


def _innovations(record: Record, j: int) -> Array:
    """Errors of a short regression of output j on past outputs and inputs, shape (N,)."""
    y, u = record.y - record.y.mean(axis=0), record.u - record.u.mean(axis=0)
    delayed = [np.vstack([np.zeros((k, record.ny)), y[:-k]]) for k in range(1, LAGS + 1)]
    driven = [np.vstack([np.zeros((k, record.nu)), u[: len(u) - k]]) for k in range(LAGS + 1)]
    X = np.hstack([*delayed, *driven])
    # The normal equations are accurate enough for a verdict, and a tenth of the time.
    gram = X.T @ X
    theta = np.linalg.lstsq(gram, X.T @ y[:, j], rcond=1e-10)[0]
    return np.asarray(y[:, j] - X @ theta)
