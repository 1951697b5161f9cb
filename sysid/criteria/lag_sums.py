"""Sums behind a residual test of a long record, without its instruments.

The instruments z_k(t) = z(t − k), a ≤ t < b, are shifts of one another but for their ends,

    z_{k+1} = S z_k + z(a−1−k) e_a − z(b−1−k) e_b,

and SᵀΣS = Σ for any Toeplitz Σ. So of G[k, l] = z_kᵀΣz_l only the row of the first lag needs a pass
over the data; all others follow along the diagonals with what happens at a and b (the covariance
method of ``normal_equations``, Morf, Dickinson, Kailath & Vieira 1977, with a weight). Σ is that of
an autoregression whose memory is short against the record, applied by fast convolution.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from sysid.criteria.coloured import AutoRegression
from sysid.criteria.fit import Array
from sysid.data.filtering import lfilter

LONG = 20_000
"""Samples from which the sums cost less than the instruments themselves."""

LONGEST_MEMORY = 4096
"""Samples of memory up to which Σ is applied by convolution: its condition is then harmless."""

FORGOTTEN = 1e-18
"""Share of a response that is lost in rounding."""

ROWS = 2048
"""Rows of which all lags are laid out at a time: they stay in the cache."""


@dataclass(frozen=True, eq=False)
class LagSums:
    """Products of U = [Z, V], Z the lags of all signals (signal-major) and V other columns.

    Attributes:
        plain: UᵀU.
        coloured: UᵀΣU; UᵀU for white noise of unit variance.
        against: UᵀW of further columns W.
    """

    plain: Array
    coloured: Array
    against: Array


def autocovariance(noise: AutoRegression | None) -> Array | None:
    """R(0), R(1), … until it is forgotten; None where that takes too long."""
    if noise is None or not noise.order:
        return np.array([1.0 if noise is None else noise.variance])
    radius = float(np.max(np.abs(np.roots(noise.alpha)), initial=0.0))
    memory = int(np.log(FORGOTTEN) / np.log(radius)) + 2 if 0.0 < radius < 1.0 else 2
    if memory > LONGEST_MEMORY:
        return None
    h = lfilter([1.0], noise.alpha, np.eye(1, memory + noise.order)[0])
    return np.asarray(noise.variance * np.correlate(h, h, "full")[len(h) - 1 :])


def lag_sums(
    signals: Array,
    lags: range,
    window: tuple[int, int],
    R: Array,
    V: Sequence[Array],
    W: Sequence[Array],
) -> LagSums:
    """All products of one record.

    Args:
        signals: (N, m); zero before and after the record.
        lags: consecutive.
        window: a, b; instruments are zero outside.
        R: autocovariance of the noise, short against b − a.
        V: columns that Σ weighs too, (N,) each.
        W: columns that it does not, (N,) each.
    """
    (a, b), v = window, len(V)
    before, after = max(lags[-1], 0) + 1, max(-lags[0], 0)
    z = np.pad(signals.T, ((0, 0), (before, after)))
    columns = np.zeros((v + len(z), len(signals)))
    for row, column in zip(columns, V, strict=False):
        row[:] = column
    columns[v:, a:b] = z[:, before + a - lags[0] : before + b - lags[0]]
    weighed = columns[:0]
    if len(R) > 1:
        from scipy.signal import oaconvolve  # the tests of a short record do without

        both = np.concatenate([R[:0:-1], R])[None, :]
        weighed = oaconvolve(columns, both, axes=1)[:, len(R) - 1 : len(R) - 1 + len(signals)]
    shared = _against_lags((columns, weighed, *(w[None, :] for w in W)), z, before, lags, window)
    flat = shared.reshape(len(shared), -1)
    plain = _all_lags(z, before, lags, window, np.ones(1), shared[v : len(columns)])
    plain = _bordered(plain, flat[:v], columns[:v] @ columns[:v].T)
    coloured = R[0] * plain
    if len(R) > 1:
        first = len(columns)
        coloured = _all_lags(z, before, lags, window, R, shared[first + v : 2 * first])
        side = flat[first : first + v]
        coloured = _bordered(coloured, side, weighed[:v] @ columns[:v].T)
    further = np.array([columns[:v] @ w for w in W]).T
    return LagSums(plain, coloured, np.vstack([flat[len(flat) - len(W) :].T, further]))


def _bordered(inner: Array, side: Array, corner: Array) -> Array:
    return np.block([[inner, side.T], [side, corner]])


def _against_lags(
    parts: Sequence[Array], z: Array, before: int, lags: range, window: tuple[int, int]
) -> Array:
    """Σ_t row(t) z(t − k) over the window for all rows of all parts, (rows, m, lags)."""
    a, b = window
    total = np.zeros((sum(map(len, parts)), len(z), len(lags)))
    for low in range(a, b, ROWS):
        high = min(low + ROWS, b)
        block = np.vstack([part[:, low:high] for part in parts])
        for j, s in enumerate(z):
            reach = s[before + low - lags[-1] : before + high - lags[0]]
            late_first = np.ascontiguousarray(sliding_window_view(reach, high - low))
            total[:, j] += (block @ late_first.T)[:, ::-1]
    return total


def _all_lags(
    z: Array, before: int, lags: range, window: tuple[int, int], R: Array, first: Array
) -> Array:
    """zᵀΣz of all signals and lags from its rows of the first lag (m, m, lags)."""
    (a, b), m, n = window, len(z), len(lags)
    k = np.array(lags)
    ends = np.stack([z[:, before + a - 1 - k], -z[:, before + b - 1 - k]], axis=2).reshape(-1, 2)
    felt = np.zeros((m, n, 2))  # Σz_k just before a and b
    for end, at, memory in ((0, before + a, R[1:]), (1, before + b - len(R), R[::-1])):
        for i, s in enumerate(z if len(memory) else ()):
            reach = s[at - lags[-1] : at + len(memory) - lags[0]]
            felt[i, :, end] = np.correlate(reach, memory, "valid")[::-1]
    half = felt.reshape(-1, 2) @ ends.T
    change = (half + half.T + R[0] * ends @ ends.T).reshape(m, n, m, n)
    out = np.zeros((m, n, m, n))
    out[:, 0] = first
    out[:, :, :, 0] = first.transpose(1, 2, 0)
    for i in range(n - 1):
        out[:, i + 1, :, 1:] = out[:, i, :, :-1] + change[:, i, :, :-1]
    return out.reshape(m * n, m * n)
