"""Rest at the start of a log: constant inputs and outputs before the first command."""

from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array, Record

STILL = 0.01
"""Share of an input's range within which it counts as held: noise and quantisation of a command."""

SHORTEST = 5
"""Samples of rest that are enough to call it so: a line through fewer fits anything."""

FLAT = 3.0
"""A measurement within so many standard errors of zero is zero."""

CHANCE = 0.01
"""Chance that noise passes for a drift of one shape. A rest that is not taken costs little, since
the level is then estimated with the model; a drift that is taken for rest puts it wrong."""

SETTLING = (8.0, 4.0, 2.0, 1.0, 0.0)
"""Time constants that the head of a log may hold of a machine that settles: in eight it has done
so early, of less than one only a straight line is seen (0)."""

QUIET = 0.25
"""Largest spread of a resting output as a share of its whole range."""

KNOWN = 0.05
"""Largest standard error of a resting output as a share of its whole range. A mean of measurements
that ring for about a period of their own is no place where anything rests, and its error says
so."""

STICKIEST = 0.95
"""Largest correlation of neighbouring measurements that a short rest can be trusted to show."""

ROUNDING = 1e-9
"""Share of a range below which numbers are alike."""


@dataclass(frozen=True, eq=False)
class Rest:
    """Where a log rests before its first command.

    Attributes:
        u: values of the inputs, (nu,).
        y: mean measurements of the outputs, (ny,).
        y_error: standard errors of these means, (ny,); zero for measurements that never change.
        samples: length of the rest.
    """

    u: Array
    y: Array
    y_error: Array
    samples: int

    @property
    def at_zero(self) -> bool:
        """Whether inputs are zero and no output differs significantly from zero."""
        near = np.abs(self.y) <= FLAT * self.y_error
        return bool(np.all(self.u == 0.0) and np.all(near))


def rest_head(record: Record) -> Rest | None:
    """The rest at the head of a record, or None where it begins in motion.

    Until the first command the inputs stay where they are; each output's measurements must then not
    drift, and their spread and the error of their mean must be small against the whole range.
    """
    range_u, range_y = np.ptp(record.u, axis=0), np.ptp(record.y, axis=0)
    n = _still(record.u, STILL * range_u)
    if n < SHORTEST:
        return None
    y = record.y[:n]
    mean: Array = y.mean(axis=0)
    spread, memory = _noise(y - mean, 1)
    tiny = ROUNDING * range_y
    drifting = [_drifts(column, least) for column, least in zip(y.T, tiny, strict=True)]
    if any(drifting) or np.any(spread > QUIET * range_y):
        return None
    y_error = spread * np.sqrt(memory / n)
    if np.any(y_error > KNOWN * range_y):
        return None
    u = np.median(record.u[:n], axis=0)
    u = np.where(np.abs(u) <= STILL * range_u, 0.0, u)
    mean = np.where(np.abs(mean) <= tiny, 0.0, mean)
    return Rest(u, mean, y_error, n)


def _still(u: Array, near: Array) -> int:
    """Samples before an input first leaves its start; 0 where none ever does."""
    looked, ahead = 0, 1024
    while looked < len(u):
        moved = np.any(np.abs(u[looked : looked + ahead] - u[0]) > near, axis=1)
        if moved.any():
            return looked + int(np.argmax(moved))
        looked, ahead = looked + ahead, 2 * ahead
    return 0


def _drifts(y: Array, tiny: float) -> bool:
    """Whether an output's measurements (n,) rise or fall towards where they would rest.

    For each of SETTLING a t-test of d in y(k) = c + d exp(−k/τ) + noise, a straight line for the
    slowest: a machine that settles nears its rest so, fast or slowly. The noise may have a memory
    of its own; it is judged after the drift is taken out, which would otherwise pass for it.
    """
    from scipy.special import stdtrit

    n = len(y)
    limit = -float(stdtrit(n - 3, 0.5 * CHANCE))
    k = np.arange(n) / n
    for rate in SETTLING:
        shape = np.exp(-rate * k) if rate else k
        X = np.column_stack([np.ones(n), shape - shape.mean()])
        d = np.linalg.lstsq(X, y, rcond=None)[0]
        residuals = y - X @ d
        spread, memory = _noise(residuals[:, None], 2)
        error = float(spread[0] * np.sqrt(memory[0])) / float(np.linalg.norm(X[:, 1]))
        if abs(d[1]) > limit * error and abs(d[1]) * np.ptp(shape) > tiny:
            return True
    return False


def _noise(residuals: Array, fitted: int) -> tuple[Array, Array]:
    """Spread of residuals (n, ny), and the factor by which memory raises the variance of a mean.

    (1 + ρ)/(1 − ρ) of noise whose correlation falls as ρᵏ. Of n residuals of ``fitted`` constants
    ρ comes out low by (1 + ρ)(1 + fitted)/n or so (Kendall 1954).
    """
    n = len(residuals)
    power = np.sum(residuals**2, axis=0)
    rho = np.sum(residuals[1:] * residuals[:-1], axis=0) / np.where(power > 0.0, power, 1.0)
    rho = np.clip(rho + (1.0 + rho) * (1 + fitted) / n, 0.0, STICKIEST)
    return np.sqrt(power / (n - fitted)), np.asarray((1.0 + rho) / (1.0 - rho))
