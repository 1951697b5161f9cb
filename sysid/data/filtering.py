"""Digital filters, of short signals by LAPACK.

Importing scipy.signal costs half a second, more than most commands need for all they do. A filter
is a triangular banded system, A(q) y = B(q) x with the coefficients of A down its diagonals, and
LAPACK comes with what every command needs.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from sysid.data.record import Array

MANY = 8000
"""Samples from which the loop of scipy.signal, twice as fast, is worth its import."""


def lfilter(b: Any, a: Any, x: Any, axis: int = -1, zi: Any = None) -> Any:
    """Filter along an axis by B(q)/A(q); see ``scipy.signal.lfilter``.

    Args:
        b, a: coefficients of numerator and denominator.
        zi: initial states; with them the final ones are returned too.
    """
    if zi is None and len(a) == 1 and np.ndim(x) == 1:
        # as SciPy does it, which takes five times as long to find out
        return np.convolve(np.divide(b, a[0]), x)[: len(x)]
    if np.shape(x)[axis] > MANY:
        from scipy import signal

        return signal.lfilter(b, a, x, axis, zi)
    whole = np.moveaxis(np.asarray(x), axis, -1)
    each = math.prod(whole.shape[:-1])
    rows = np.ascontiguousarray(whole).reshape(each, whole.shape[-1])
    b, a = np.divide(b, a[0]), np.divide(a, a[0])
    drive = _moved(b, rows)
    if zi is None:
        return np.moveaxis(_solved(a[None], drive).reshape(whole.shape), -1, axis)
    states = np.moveaxis(np.asarray(zi), axis, -1)
    ends = (*whole.shape[:-1], states.shape[-1])
    states = np.broadcast_to(states, ends).reshape(each, ends[-1])
    drive[:, : states.shape[1]] += states[:, : rows.shape[1]]
    y = _solved(a[None], drive)
    left = _left(b, a, rows, y, states).reshape(ends)
    return np.moveaxis(y.reshape(whole.shape), -1, axis), np.moveaxis(left, -1, axis)


def filtered_by_record(b: Array, a: Array, x: Array, starts: Sequence[int]) -> Array:
    """Records one after the other, each from rest through B/A, (N, k).

    Args:
        b, a: coefficients, (n,); or one filter a row, (V, n), that one signal goes through.
        x: signals, (N, k); of several filters (N, 1), and k is V.
        starts: first row of each record, and N.
    """
    a, rows = np.atleast_2d(a), np.ascontiguousarray(x.T)
    drive = np.zeros((max(len(rows), len(a)), len(x)))
    for low, high in pairwise(starts):
        for k, tap in enumerate(np.atleast_2d(b).T[: high - low]):
            if tap.any():
                drive[:, low + k : high] += tap[:, None] * rows[:, low : high - k]
    if len(a) == 1:
        return _solved(a, drive, starts).T
    ends = np.arange(len(a))[:, None] * len(x) + np.array(starts[1:])
    return _solved(a, drive.reshape(1, -1), (0, *ends.ravel())).reshape(drive.shape).T


def _moved(b: Array, x: Array) -> Array:
    """B(q) x, (k, N)."""
    if len(x) == 1 and x.size:
        return np.convolve(b, x[0])[None, : x.shape[1]]
    n = x.shape[1]
    first = next((k for k, tap in enumerate(b[:n]) if tap), 0)
    out = np.empty(x.shape, np.result_type(b, x))
    out[:, :first] = 0.0
    np.multiply(x[:, : n - first], b[first], out=out[:, first:])
    for k in range(first + 1, min(len(b), n)):
        out[:, k:] += b[k] * x[:, : n - k]
    return out


def _solved(a: Array, drive: Array, starts: Sequence[int] = ()) -> Array:
    """y of A(q) y = drive, (k, N), whose place it takes.

    Args:
        a: coefficients, monic; one filter a row, each of as long a part of the rows as the others.
        starts: rows that no earlier one acts on.
    """
    if a.shape[1] == 1 or not drive.size:
        return drive
    from scipy.linalg.lapack import dtbtrs, ztbtrs

    banded = np.empty((len(a), drive.shape[1] // len(a), a.shape[1]), drive.dtype)
    banded[:] = a[:, None]
    banded = banded.reshape(-1, a.shape[1])
    at = np.array(starts[1:-1], dtype=np.intp)
    for k in range(1, a.shape[1]):
        banded[at[at >= k] - k, k:] = 0.0
    solve = ztbtrs if np.iscomplexobj(drive) else dtbtrs
    return np.asarray(solve(banded.T, drive.T, uplo="L", diag="U", overwrite_b=True)[0].T)


def _left(b: Array, a: Array, x: Array, y: Array, states: Array) -> Array:
    """What inputs, outputs and initial states still add to outputs after the last, (k, n)."""
    n, length = states.shape[1], x.shape[1]
    out = np.zeros(states.shape, y.dtype)
    out[:, : max(n - length, 0)] = states[:, length:]
    for sign, taps, values in ((1.0, b, x), (-1.0, a, y)):
        for k in range(1, len(taps)):
            last = values[:, max(length - k, 0) :]
            out[:, k - last.shape[1] : k] += sign * taps[k] * last
    return out


def lfilter_zi(b: Any, a: Any) -> Any:
    """States in which a constant input of 1 has settled; see ``scipy.signal.lfilter_zi``."""
    from scipy import signal

    return signal.lfilter_zi(b, a)
