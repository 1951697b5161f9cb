"""Consecutive lags of a signal as rows, and what a filter makes of them."""

from collections.abc import Sequence

import numpy as np

from sysid.data.filtering import lfilter
from sysid.data.record import Array


def through(D: Array, C: Array, h: Array | None, pairs: Sequence[tuple[Array, Array]]) -> None:
    """(D/C) of rows that are consecutive lags of a signal; h is the impulse response of D/C.

    Each row is the one before it a sample later, but for its first value: so is its response, but
    for that value times h, which may be longer. One filter run serves all lags. Without h the rows
    are copied.

    Args:
        D, C, h: the filter.
        pairs: of each signal its rows, and where their responses go.
    """
    pairs = [(rows, out) for rows, out in pairs if rows.size]
    if h is None or not pairs:
        for rows, out in pairs:
            out[:] = rows
        return
    firsts = lfilter(D, C, np.array([rows[0] for rows, _ in pairs]))
    h = h[: firsts.shape[1]]
    for first, (rows, out) in zip(firsts, pairs, strict=True):
        out[0] = first
        for k in range(1, len(rows)):
            np.multiply(h, rows[k, 0], out=out[k])
            out[k, 1:] += out[k - 1, :-1]


def lags(first: int, count: int) -> range:
    """``count`` lags from ``first`` on."""
    return range(first, first + count)


def monic(tail: Array) -> Array:
    """1 + Σ tail_k q⁻ᵏ as coefficients."""
    return np.concatenate([[1.0], tail])


def impulse(n: int) -> Array:
    """A unit impulse at the first of ``n`` samples."""
    out = np.zeros(n)
    out[:1] = 1.0
    return out


def shifted(x: Array, lags: range, start: int, out: Array | None = None) -> Array:
    """Rows x(t − k) for t ≥ ``start``, zero before the first sample, (len(lags), N − start).

    ``out``, if given, holds zeros and is filled.
    """
    m = len(x) - start
    if out is None:
        out = np.zeros((len(lags), max(m, 0)))
    for row, k in enumerate(lags):
        if k <= start:
            out[row] = x[start - k : len(x) - k]
        elif k - start < m:
            out[row, k - start :] = x[: len(x) - k]
    return out
