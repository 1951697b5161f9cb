"""Rest at the head of a log: inputs held and outputs standing still before the first command."""

from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array, Record

STILL = 0.01
"""Share of an input's range within which it counts as held: noise and quantisation of a command."""

SHORTEST = 5
"""Samples of rest that are enough to call it so: a line through fewer fits anything."""

FLAT = 3.0
"""A slope of an output within so many standard errors of zero is none."""

QUIET = 0.25
"""Largest spread of a resting output as a share of its whole range."""

STICKIEST = 0.95
"""Largest correlation of neighbouring readings that a short rest can be trusted to show."""

ROUNDING = 1e-9
"""Share of a range below which numbers are alike."""


@dataclass(frozen=True, eq=False)
class Rest:
    """Where a log rests before its first command.

    Attributes:
        u: values of the inputs, (nu,).
        y: mean readings of the outputs, (ny,).
        y_error: standard errors of these means, (ny,); zero for readings that never change.
        samples: length of the rest.
    """

    u: Array
    y: Array
    y_error: Array
    samples: int

    @property
    def at_zero(self) -> bool:
        """Whether inputs are zero and no output is told apart from zero."""
        near = np.abs(self.y) <= FLAT * self.y_error
        return bool(np.all(self.u == 0.0) and np.all(near))


def rest_head(record: Record) -> Rest | None:
    """The rest at the head of a record, or None where it begins in motion.

    Until the first command the inputs stay where they are; each output's readings must then lie
    about a line without slope, and their spread must be small against the whole range.
    """
    range_u, range_y = np.ptp(record.u, axis=0), np.ptp(record.y, axis=0)
    moved = np.any(np.abs(record.u - record.u[0]) > STILL * range_u, axis=1)
    n = int(np.argmax(moved)) if moved.any() else 0
    if n < SHORTEST:
        return None
    y = record.y[:n]
    t = np.arange(n) - 0.5 * (n - 1)
    slope = t @ y / float(t @ t)
    mean: Array = y.mean(axis=0)
    left = y - mean - np.outer(t, slope)
    spread = np.sqrt(np.sum(left**2, axis=0) / max(n - 2, 1))
    tiny = ROUNDING * range_y
    noise = spread * np.sqrt(_memory(left))
    flat = np.abs(slope) * n <= FLAT * noise * n / np.sqrt(float(t @ t)) + tiny
    if not np.all(flat & (spread <= QUIET * range_y)):
        return None
    u = np.median(record.u[:n], axis=0)
    u = np.where(np.abs(u) <= STILL * range_u, 0.0, u)
    y_error = noise / np.sqrt(n)
    mean = np.where(np.abs(mean) <= tiny, 0.0, mean)
    return Rest(u, mean, y_error, n)


def _memory(left: Array) -> Array:
    """Factor by which the variance of a mean grows because neighbours are alike.

    (1 + ρ)/(1 − ρ) of noise whose correlation falls as ρᵏ.
    """
    power = np.sum(left**2, axis=0)
    rho = np.sum(left[1:] * left[:-1], axis=0) / np.where(power > 0.0, power, 1.0)
    rho = np.clip(rho, 0.0, STICKIEST)
    return np.asarray((1.0 + rho) / (1.0 - rho))
