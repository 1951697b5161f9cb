"""Sums behind a residual test of a long record, without its instruments.

The instruments z_k(t) = z(t − k), a ≤ t < b, are shifts of one another but for their ends,

    z_{k+1} = S z_k + z(a−1−k) e_a − z(b−1−k) e_b,

and SᵀΣS = Σ for any Toeplitz Σ. So of G[k, l] = z_kᵀΣz_l only the row of the first lag needs a pass
over the data; all others follow along the diagonals with what happens at a and b (the covariance
method of ``normal_equations``, Morf, Dickinson, Kailath & Vieira 1977, with a weight). Σ is that of
an autoregression whose memory is short against the record, applied by fast convolution.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import irfft, next_fast_len, rfft

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
    v, w, m, n = len(V), len(W), signals.shape[1], len(lags)
    before, after = max(lags[-1], 0) + 1, max(-lags[0], 0)
    z = np.pad(signals.T, ((0, 0), (before, after)))
    c = v + m  # V and the first lag of each signal
    shared = np.zeros((2 * c + w, m, n))
    plain, coloured, further = np.zeros((v, v)), np.zeros((v, v)), np.zeros((v, w))
    for low, columns, weighed in _weighed_blocks((*V, *z), before - lags[0], window, R, m):
        high = low + columns.shape[1]
        others = np.array([x[low:high] for x in W])
        plain += columns[:v] @ columns[:v].T
        coloured += weighed[:v] @ columns[:v].T
        further += columns[:v] @ others.T
        first, last = max(low, window[0]), min(high, window[1])
        if first < last:
            block = np.vstack([columns, weighed, others])[:, first - low : last - low]
            for k, s in enumerate(z):
                reach = s[before + first - lags[-1] : before + last - lags[0]]
                late_first = np.ascontiguousarray(sliding_window_view(reach, last - first))
                shared[:, k] += (block @ late_first.T)[:, ::-1]
    flat = shared.reshape(len(shared), -1)
    lagged = _all_lags(z, before, lags, window, np.ones(1), shared[v:c])
    under_noise = _all_lags(z, before, lags, window, R, shared[c + v : 2 * c])
    return LagSums(
        _bordered(lagged, flat[:v], plain),
        _bordered(under_noise, flat[c : c + v], coloured),
        np.vstack([flat[2 * c :].T, further]),
    )


def _weighed_blocks(
    rows: Sequence[Array], ahead: int, window: tuple[int, int], R: Array, m: int
) -> Iterator[tuple[int, Array, Array]]:
    """(first row, columns, Σ columns) block by block, by overlapping transforms.

    Args:
        rows: columns (N,) each; the last m are padded signals whose first lag is meant.
        ahead: where in a padded signal the first lag of sample 0 stands.
        window: outside of which the lags are zero.
        R: autocovariance.
        m: number of signals.
    """
    a, b = window
    whole, reach = len(rows[0]), len(R) - 1
    size = max(ROWS, 4 * reach)
    length = next_fast_len(size + 2 * reach, real=True)
    spectrum = rfft(np.concatenate([R[:0:-1], R]), length)
    for low in range(0, whole, size):
        high = min(low + size, whole)
        first, last = max(low - reach, 0), min(high + reach, whole)
        held = np.zeros((len(rows), high - low + 2 * reach))
        at = first - (low - reach)
        for row, values in zip(held[: len(rows) - m], rows, strict=False):
            row[at : at + last - first] = values[first:last]
        inside = slice(max(first, a), min(last, b))
        if inside.start < inside.stop:
            place = at + inside.start - first
            for row, s in zip(held[len(rows) - m :], rows[len(rows) - m :], strict=True):
                taken = s[ahead + inside.start : ahead + inside.stop]
                row[place : place + len(taken)] = taken
        columns = held[:, reach : reach + high - low]
        if not reach:
            yield low, columns, R[0] * columns
            continue
        weighed = irfft(rfft(held, length) * spectrum, length)
        yield low, columns, weighed[:, 2 * reach : 2 * reach + high - low]


def _bordered(inner: Array, side: Array, corner: Array) -> Array:
    return np.block([[inner, side.T], [side, corner]])


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
