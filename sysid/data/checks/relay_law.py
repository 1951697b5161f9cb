"""Test whether an output switches an input of two levels, as a thermostat or a float switch does.

Switching n comes D_n samples after the last one, in which the output has moved by z_n. Regressed
for each of both ways apart,

    z_n = a + b D_n + rest.

In open loop the time of a switching knows nothing of the output: a longer interval takes the output
further, b is the rate r at which it still moves when the input is switched. Where a threshold
switches, the output has come as far however long that took: b = 0. Both ways together are b/r with
their standard errors (weights 1/σ²). Intervals that are all alike, as a timer's, and outputs that
rest when they are switched say nothing (b/r has an infinite error). Where short intervals take the
output less far than long ones, in which it comes to rest, no threshold does the switching.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import stdtr

from sysid.data.impulse import least_squares
from sysid.data.record import Array, Record

MIN_SWITCHINGS = 5
"""Switchings of each way."""

NEAR = 0.1
"""Share of the output's range within which it lies about a threshold when it switches (one standard
deviation): where set points move, or a timer switches as well, it is not this test's to say."""

TOGETHER, FURTHER = 0.4, 0.05
"""Correlation of the ranks of z and D, and share of the way by which the longer half of the
intervals takes the output further than the shorter half, where no threshold ends them. Noise and
what an output passes a threshold by within a sample make some of either, but not both."""

LAST = 0.2
"""Last part of an interval over which the rate is taken."""

MOVING = 0.3
"""Share of its mean rate between two switchings at which the output still moves at the second."""

MOST = 0.5
"""Upper end of the 95 % interval of b/r for a threshold: halfway to open loop."""


@dataclass(frozen=True)
class RelayLaw:
    """A threshold for each way of an input of two levels.

    Attributes:
        up, down: the output at which the input goes to its higher and to its lower level, in the
            unit of the record.
        switchings: their number.
        p_value: of "the intervals are as long as they are whatever the output does".
    """

    up: float
    down: float
    switchings: int
    p_value: float


class _Ways(NamedTuple):
    """Switchings of one way: the output there, what it moved by since the last one, the samples
    between, and the rate at the end [1/sample], (n,) each."""

    at: Array
    moved: Array
    lasted: Array
    rate: Array


def relay_law(records: Sequence[Record], i: int, j: int) -> RelayLaw | None:
    """The thresholds of output i that switch input j; None where it is not seen to do so."""
    levels = np.unique(np.concatenate([r.u[:, j] for r in records]))
    if len(levels) != 2:
        return None
    ways = [_switchings(records, i, j, level) for level in levels[::-1]]
    if min(len(w.at) for w in ways) < MIN_SWITCHINGS:
        return None
    width = float(np.ptp(np.concatenate([r.y[:, i] for r in records])))
    if any(float(np.std(w.at)) > NEAR * width for w in ways):
        return None
    if any(_comes_to_rest(w) for w in ways):
        return None
    ratios = [r for w in ways if (r := _slope_by_rate(w)) is not None]
    if not ratios:
        return None
    weights = np.array([1.0 / error**2 for _, error in ratios])
    ratio = float(weights @ [value for value, _ in ratios] / weights.sum())
    error = float(weights.sum() ** -0.5)
    count = sum(len(w.at) for w in ways)
    p = 2.0 * float(stdtr(count - 4, -abs(1.0 - ratio) / error))
    if ratio + 2.0 * error > MOST:
        return None
    up, down = (float(np.median(w.at)) for w in ways)
    return RelayLaw(up, down, count, p)


def _switchings(records: Sequence[Record], i: int, j: int, level: float) -> _Ways:
    """Switchings to a level that have one before them in their record."""
    rows = []
    for r in records:
        u, y = r.u[:, j], r.y[:, i]
        for last, k in pairwise(np.flatnonzero(np.diff(u)) + 1):
            m = max(int(LAST * (k - last)), 1)
            if u[k] == level:
                rows.append((y[k], y[k] - y[last], k - last, (y[k] - y[k - m]) / m))
    return _Ways(*np.array(rows, dtype=np.float64).reshape(len(rows), 4).T)


def _slope_by_rate(way: _Ways) -> tuple[float, float] | None:
    """(b/r, its standard error); None where the output rests or all intervals are alike.

    The rate's own error counts as well: it is what b is measured by.
    """
    n, rate = len(way.at), float(np.mean(way.rate))
    rate_error = float(np.std(way.rate, ddof=1)) / np.sqrt(n)
    spread = float(np.sum((way.lasted - way.lasted.mean()) ** 2))
    usual = abs(float(np.mean(way.moved) / np.mean(way.lasted)))
    if spread == 0.0 or abs(rate) < max(MOVING * usual, 3.0 * rate_error):
        return None
    theta, rest = least_squares(np.column_stack([way.lasted, np.ones(n)]), way.moved)
    slope = float(theta[0]) / rate
    of_slope = float(rest @ rest) / max(n - 2, 1) / spread / rate**2
    error = float(np.sqrt(of_slope + (slope * rate_error / rate) ** 2))
    return slope, max(error, 1e-6)


def _comes_to_rest(way: _Ways) -> bool:
    """Whether the output comes further the longer an interval lasts."""
    far = way.moved * np.sign(np.mean(way.moved))
    ranks = [np.argsort(np.argsort(x, kind="stable")).astype(np.float64) for x in (far, way.lasted)]
    together = float(np.corrcoef(ranks[0], ranks[1])[0, 1])
    shorter, longer = np.array_split(far[np.argsort(way.lasted, kind="stable")], 2)
    further = float((longer.mean() - shorter.mean()) / far.mean())
    return together > TOGETHER and further > FURTHER
