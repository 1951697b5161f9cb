"""Measurement noise of each output, from every log and in several ways, with an interval.

Measurements between changes of the command show it best. Where a log never settles, two other
estimates are used: the rough part of a model's errors, and the scatter of these errors where the
same commands recur. Each can only be too large, so a clearly smaller one replaces the first. The
noise is never below the resolution of the measurements.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.facts import LogFacts
from sysid.data.noise import trimmed_rms
from sysid.data.record import Array, Record
from sysid.data.resolution import finest_step
from sysid.diagnosis.gap import REFUTED, floor_of_errors

MIN_PAIRS = 60
"""Pairs of rows with the same commands before, that a noise is read off."""

RESOLVED = 1e-6
"""Share of the measurements' size that is not resolved: rounding of files and computations."""

FORGOTTEN = 0.01
"""A command is forgotten when its part of the answer has fallen to this share."""

LONGEST = 400
"""Rows of commands that are compared at most."""

SPREAD = 1.8
"""Standard error of a noise from n third differences, in units of it over √n: they are correlated,
and the median of their size is less accurate than their mean square."""

SURE = 1.96


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

    def at_least(self, rounding: Array) -> "NoiseFloor":
        """No lower than what the steps of a coarse sensor leave, whatever noise hides them, (ny,).

        A level between two steps reads alike for long: no difference of measurements shows that
        error.
        """
        value = np.maximum(self.value, rounding)
        return NoiseFloor(value, np.maximum(self.low, rounding), np.maximum(self.high, value))


def floor_of(data: Sequence[Record] | LogFacts, errors: Sequence[Array], pole: float) -> NoiseFloor:
    """Noise of the measurements of all logs.

    Args:
        errors: those of a model there, (N, ny) a record; NaN where a sample does not count.
        pole: of that model, which says how long it remembers a command.
    """
    facts = LogFacts.of(data)
    records, value, calm = facts.records, facts.noise, facts.settles
    repeated = between_repeats(records, errors, pole)
    for other in (floor_of_errors(errors), repeated):
        value = np.where(other < REFUTED * value, other, value)
    y = np.concatenate([r.y for r in records])
    least = RESOLVED * np.sqrt(np.nanmean(np.where(np.isfinite(y), y, np.nan) ** 2, axis=0))
    least = np.maximum(least, 1e-300)
    value = np.maximum(value, least)
    n = np.maximum(np.isfinite(np.concatenate(errors)).sum(axis=0), 1)
    share = np.minimum(SURE * SPREAD / np.sqrt(n), 0.5)
    low = np.where(calm | np.isfinite(repeated), value * (1.0 - share), least)
    return NoiseFloor(value, np.maximum(low, least), value * (1.0 + share))


def between_repeats(records: Sequence[Record], errors: Sequence[Array], pole: float) -> Array:
    """Spread of errors at rows before which the same commands came, over √2, (ny,).

    Commands that did not change at all are left out, because measurements may rest there. Infinite
    where too few rows repeat.
    """
    rows = int(np.clip(np.ceil(np.log(FORGOTTEN) / np.log(np.clip(pole, 0.05, 0.995))), 2, LONGEST))
    weights = np.random.default_rng(0).standard_normal((rows, records[0].nu))
    marks, residuals = [], []
    for r, e in zip(records, errors, strict=True):
        if len(r) <= rows + 1:
            continue
        size = np.max(np.abs(r.u), axis=0) + 1e-300
        u = np.round(r.u / size, 6)
        mark = sum(np.convolve(u[:, i], weights[:, i], "valid")[:-1] for i in range(r.nu))
        changes = np.cumsum(np.any(np.diff(u, axis=0) != 0.0, axis=1))
        moved = changes[rows - 2 : -1] > np.concatenate([[0], changes[:-rows]])
        marks.append(np.where(moved, np.round(mark, 7), np.nan))
        residuals.append(e[rows:])
    if not marks:
        return np.full(records[0].ny, np.inf)
    mark, error = np.concatenate(marks), np.concatenate(residuals)
    order = np.argsort(mark, kind="stable")
    same = np.diff(mark[order]) == 0.0
    apart = (error[order][1:] - error[order][:-1])[same]
    spreads = np.full(error.shape[1], np.inf)
    y = np.concatenate([r.y for r in records])
    for i, column in enumerate(apart.T):
        there = column[np.isfinite(column)]
        if len(there) >= MIN_PAIRS:
            spreads[i] = trimmed_rms(there, finest_step(y[:, i])) / np.sqrt(2.0)
    return spreads
