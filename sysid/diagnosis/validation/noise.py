"""Measurement noise of each output, from every log and in several ways, with an interval.

Measurements between changes of the command show it best. Where a log never settles, the rough part
of a model's errors does: each can only be too large, so a clearly smaller one replaces the first.
The noise is never below the resolution of the measurements.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.facts import LogFacts
from sysid.data.record import Array, Record
from sysid.diagnosis.gap import REFUTED, floor_of_errors
from sysid.fitting.profile import NORMAL

RESOLVED = 1e-6
"""Share of the measurements' size that is not resolved: rounding of files and computations."""

SPREAD = 1.8
"""Standard error of a noise from n third differences, in units of it over √n: they are correlated,
and the median of their size is less accurate than their mean square."""


@dataclass(frozen=True, eq=False)
class NoiseFloor:
    """Noise of each output.

    Attributes:
        value: what is used, (ny,).
        low, high: its 95 % interval, (ny,); low is what the measurements resolve where no way saw
            the noise apart from the signal.
    """

    value: Array
    low: Array
    high: Array

    def or_less(self, other: "NoiseFloor") -> "NoiseFloor":
        """Of each output the lower of two estimates."""
        lower = other.value < self.value
        ends = ((other.value, self.value), (other.low, self.low), (other.high, self.high))
        return NoiseFloor(*(np.where(lower, theirs, own) for theirs, own in ends))

    def at_least(self, rounding: Array) -> "NoiseFloor":
        """No lower than what the steps of a coarse sensor leave, whatever noise hides them, (ny,).

        A level between two steps reads alike for long: no difference of measurements shows that
        error.
        """
        value = np.maximum(self.value, rounding)
        return NoiseFloor(value, np.maximum(self.low, rounding), np.maximum(self.high, value))


def floor_of(data: Sequence[Record] | LogFacts, errors: Sequence[Array]) -> NoiseFloor:
    """Noise of the measurements of all logs.

    Args:
        errors: those of a model there, (N, ny) a record; NaN where a sample does not count.
    """
    facts = LogFacts.of(data)
    records, value, calm = facts.records, facts.noise, facts.settles
    rough = floor_of_errors(errors)
    value = np.where(rough < REFUTED * value, rough, value)
    y = np.concatenate([r.y for r in records])
    least = RESOLVED * np.sqrt(np.nanmean(np.where(np.isfinite(y), y, np.nan) ** 2, axis=0))
    least = np.maximum(least, 1e-300)
    value = np.maximum(value, least)
    n = np.maximum(np.isfinite(np.concatenate(errors)).sum(axis=0), 1)
    share = np.minimum(NORMAL * SPREAD / np.sqrt(n), 0.5)
    low = np.where(calm, value * (1.0 - share), least)
    return NoiseFloor(value, np.maximum(low, least), value * (1.0 + share))
