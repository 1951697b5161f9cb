"""Intervals by profile likelihood, for parameters whose slopes do not tell what they are worth.

A run changes by jumps or kinks with some parameters: the breakaway level of dry friction decides
whether a command moves the motor at all. The slope at the estimate knows nothing of the next jump,
so neither does the covariance that follows from slopes. The profile does: hold the parameter at a
value, fit all others, and see how far the cost rises (Venzon & Moolgavkar 1988, Appl. Stat.
37, 87).
"""

from collections.abc import Callable
from dataclasses import dataclass

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

CLOSE = 1.2
"""Ends bracketed within this ratio are known well enough for two digits of an error."""

GROWTH = 3.0
"""Largest step outwards, as a multiple of the last one."""

Rise = Callable[[float, Array], tuple[float, Array]]
"""(value, where the others begin) → twice the fall of the log likelihood, where they ended."""


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
        k: entry.
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
    inside, low, outside, high = 0.0, 0.0, np.inf, np.inf
    start, distance = p, min(NORMAL * error, room)
    for _ in range(TRIALS):
        if not 0.0 < distance <= room:
            break
        value, fitted = rise(float(p[k] + side * distance), start)
        if value < LOWER:
            return 0.0, fitted
        if value <= LEVEL:
            inside, low, start = distance, max(value, 0.0), fitted
            if inside >= room:
                break
        else:
            outside, high = distance, value
        if outside <= CLOSE * inside:
            break
        distance = min(_next(inside, low, outside, high), room)
    if not np.isfinite(outside):
        return inside, None
    return outside, None


def _next(inside: float, low: float, outside: float, high: float) -> float:
    """Where a parabola through the ends known so far crosses the level; safely within them."""
    if not np.isfinite(outside):
        reach = inside * np.sqrt(LEVEL / low) if low > 0.0 else np.inf
        return float(min(1.05 * reach, GROWTH * inside))
    a, b = np.sqrt(low), np.sqrt(high)
    guess = inside + (outside - inside) * (np.sqrt(LEVEL) - a) / (b - a)
    gap = outside - inside
    return float(np.clip(1.05 * guess, inside + 0.2 * gap, outside - 0.2 * gap))
