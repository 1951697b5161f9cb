"""Intervals by profile likelihood, for parameters whose gradient does not give their error.

A run changes by jumps or kinks with some parameters: the breakaway level of dry friction decides
whether a command moves the motor at all. The slope at the estimate knows nothing of the next jump,
so neither does the covariance that follows from slopes. The profile does: hold the parameter at a
value, fit all others, and see how far the cost rises (Venzon & Moolgavkar 1988, Appl. Stat.
37, 87).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array

LEVEL = 3.84
"""Twice the fall of the log likelihood at the ends of a 95 % interval: χ² with one degree of
freedom."""

NORMAL = 1.96
"""Standard errors from the estimate to the ends of a 95 % interval."""

LOWER = -1.0
"""A fall by more than this, in the same units, is a better minimum; less is the search's own
precision."""

TRIALS = 6
"""Values tried on a side."""

Rise = Callable[[float, Array], tuple[float, Array]]
"""(value, where the others begin) → twice the fall of the log likelihood, where they ended."""


@dataclass(frozen=True)
class End:
    """One end of an interval in the making: where the profile is asked next, told what it is there.

    Whoever fits the others may so look for many ends side by side.

    Attributes:
        distance: from the estimate, where the profile is asked next; None where the end is known.
        room: distance of the bound.
        level: rise at the end.
        close: ends bracketed within this ratio are known well enough: two digits of an error.
        growth: largest step outwards, as a multiple of the last one.
        inside, low: largest distance with less rise, and that rise.
        outside, high: smallest distance with more; infinite where none was met.
    """

    distance: float | None
    room: float
    level: float = LEVEL
    close: float = 1.2
    growth: float = 3.0
    inside: float = 0.0
    low: float = 0.0
    outside: float = np.inf
    high: float = np.inf

    @staticmethod
    def beginning(
        first: float, room: float, level: float = LEVEL, close: float = 1.2, growth: float = 3.0
    ) -> "End":
        """Nothing known, ``first`` asked; there is no end to look for where there is no room."""
        first = min(first, room)
        return End(first if first > 0.0 else None, room, level, close, growth)

    def with_rise(self, rise: float) -> "End":
        """What is known once the profile's rise at ``distance`` is."""
        assert self.distance is not None
        if rise <= self.level:
            known = replace(self, inside=self.distance, low=max(rise, 0.0))
        else:
            known = replace(self, outside=self.distance, high=rise)
        done = known.inside >= known.room or known.outside <= known.close * known.inside
        return replace(known, distance=None if done else min(known._next(), known.room))

    def _next(self) -> float:
        """Where a parabola through the ends known so far crosses the level; safely within them."""
        if not np.isfinite(self.outside):
            reach = self.inside * np.sqrt(self.level / self.low) if self.low > 0.0 else np.inf
            return float(min(1.05 * reach, self.growth * self.inside))
        a, b = np.sqrt(self.low), np.sqrt(self.high)
        gap = self.outside - self.inside
        guess = self.inside + gap * (np.sqrt(self.level) - a) / (b - a)
        return float(np.clip(1.05 * guess, self.inside + 0.2 * gap, self.outside - 0.2 * gap))


@dataclass(frozen=True, eq=False)
class Profile:
    """How far a parameter may move.

    Attributes:
        below, above: distance from the estimate to the ends of the 95 % interval.
        better: a place of lower cost that was met on the way; None where there was none.
    """

    below: float
    above: float
    better: Array | None

    @property
    def error(self) -> float:
        """Standard error that gives the wider of the two sides."""
        return max(self.below, self.above) / NORMAL


def profiled(rise: Rise, p: Array, k: int, error: float, lower: float, upper: float) -> Profile:
    """The profile of entry k of p on both sides, until a better minimum is met.

    Args:
        rise: fits the others with entry k held.
        p: the estimate, shape (n,).
        error: its standard error by slopes, where the ends are looked for first.
        lower, upper: its bounds; a side ends there.
    """
    ends = []
    for side, room in ((-1.0, p[k] - lower), (1.0, upper - p[k])):
        end, better = _end(rise, p, k, side, error, room)
        if better is not None:
            return Profile(0.0, 0.0, better)
        ends.append(end)
    return Profile(ends[0], ends[1], None)


def _end(
    rise: Rise, p: Array, k: int, side: float, error: float, room: float
) -> tuple[float, Array | None]:
    """Distance at which the profile crosses the level, its outer bracket where it jumps there."""
    end, start = End.beginning(NORMAL * error, room), p
    for _ in range(TRIALS):
        if end.distance is None:
            break
        value, fitted = rise(float(p[k] + side * end.distance), start)
        if value < LOWER:
            return 0.0, fitted
        start = fitted if value <= LEVEL else start
        end = end.with_rise(value)
    return (end.outside if np.isfinite(end.outside) else end.inside), None
