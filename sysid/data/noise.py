"""Measurement noise of signals, from the signals alone."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.reading.stale import Refresh, fresh_only
from sysid.data.record import Array, Record
from sysid.data.resolution import finest_step

MIN_SETTLED_DIFFERENCES = 200
"""Third differences on which no command changes, at least, to read the noise from them alone."""

WITHIN_THREE = 0.98658
"""Standard deviation of a normal law cut off at three of its own."""

ROBUST = 1.4826
"""Standard deviation of a normal law over the median of its absolute deviations."""


def white_noise(signals: Sequence[Array]) -> Array:
    """Standard deviation of white noise on each column of signals (N, k), (k,).

    1.4826 median |Δ³y| / √20: third differences of a smooth signal vanish, those of white noise
    have 20 times its variance, and the median passes over transients. NaN do not count.
    """
    return np.asarray(ROBUST * np.nanmedian(np.abs(_third(signals)), axis=0) / np.sqrt(20.0))


def measurement_noise(records: Sequence[Record], slow: Sequence[Refresh | None]) -> Array:
    """Measurement noise of each output from the data alone, (ny,), at least q/√12 of resolution q.

    As ``white_noise``; where commands rest often enough, only samples without a recent change
    count, by their root mean square without outliers. Of a sensor slower than the log only fresh
    measurements count.

    Args:
        records: experiments with the same channels.
        slow: by output, how often it is measured where that is less often than logged.
    """
    if any(slow):
        each = [_floor(fresh_only(records, i, s)) for i, s in enumerate(slow)]
        return np.concatenate(each)
    return _floor(records)


def settles(records: Sequence[Record]) -> NDArray[np.bool_]:
    """Outputs whose commands rest often enough to read the noise between their changes, (ny,)."""
    calm = [_calm(r) for r in records if len(r) > 3]
    return np.asarray(np.concatenate(calm).sum(axis=0) >= MIN_SETTLED_DIFFERENCES)


def _floor(records: Sequence[Record]) -> Array:
    """``measurement_noise`` of measurements that are all fresh."""
    third = _third([r.y for r in records])
    calm = np.concatenate([_calm(r) for r in records if len(r) > 3])
    rough = ROBUST * np.median(np.abs(third), axis=0)
    spreads = [
        trimmed_rms(third[calm[:, i], i], rough[i])
        if calm[:, i].sum() >= MIN_SETTLED_DIFFERENCES
        else rough[i]
        for i in range(third.shape[1])
    ]
    y = np.concatenate([r.y for r in records])
    rounding = np.array([finest_step(column) for column in y.T]) / np.sqrt(12.0)
    return np.asarray(np.maximum(np.array(spreads) / np.sqrt(20.0), rounding))


def _third(signals: Sequence[Array]) -> Array:
    """Third differences of all signals, (M, k)."""
    long = [np.diff(y, n=3, axis=0) for y in signals if len(y) > 3]
    return np.concatenate(long or [np.zeros((1, signals[0].shape[1]))])


def _calm(record: Record) -> NDArray[np.bool_]:
    """Third differences (N − 3, ny) on which no command changes, nor in the two samples before.

    Measurements that rest on zero or on their largest size (a clip) do not show the noise.
    """
    u, y = record.u, record.y
    changes = np.any(np.abs(np.diff(u, axis=0)) > 1e-3 * np.max(np.abs(u), axis=0), axis=1)
    before = np.concatenate([[0], np.cumsum(changes)])
    first = np.arange(len(u) - 3)
    calm = before[first + 3] == before[np.maximum(first - 2, 0)]
    size = np.abs(y[:-3])
    same = np.all([y[k : len(y) - 3 + k] == y[:-3] for k in (1, 2, 3)], axis=0)
    stuck = same & ((size == 0.0) | (size == np.max(np.abs(y), axis=0)))
    return np.asarray(calm[:, None] & ~stuck)


def trimmed_rms(x: Array, start: float) -> float:
    """Root mean square within three times itself, for a normal law.

    Args:
        start: the least that it is begun from: of rounded measurements most differences may be
            zero, and their median with them.
    """
    size = max(start, ROBUST * float(np.median(np.abs(x))))
    for _ in range(5):
        inside = x[np.abs(x) <= 3.0 * size]
        size = float(np.sqrt(np.mean(inside**2))) / WITHIN_THREE if len(inside) else size
    return size
