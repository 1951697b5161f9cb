"""Speeds from event times: a marker or Hall sensor that passes, or the ticks of an encoder.

Between two events the shaft turns by a known angle, so its mean speed over that interval is exact
but for the clock. Differences of a counter over fixed intervals are not: they are wrong by up to a
tick, whatever the clock.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sysid.data.record import Array
from sysid.errors import DataError

_TURN = 2.0 * np.pi

MIN_EVENTS = 3
"""Events of a steady speed: two intervals, whose difference shows whether the speed is steady."""

UNSTEADY = 5.0
"""A speed counts as not steady where its trend over the events is larger than so many standard
errors and than 2 % of the speed."""


@dataclass(frozen=True, eq=False)
class Events:
    """Instants at which a shaft passes known angles.

    Attributes:
        t: instants [s], (N,), rising.
        angle: of the shaft [rad], (N,).
        error: standard error of each instant [s], (N,), from the resolution of the clock.
    """

    t: Array
    angle: Array
    error: Array

    def intervals(self) -> tuple[Array, Array, Array, Array]:
        """Mean speed of every interval between two events.

            ω = Δθ/Δt,    σ = |ω| √(σ_a² + σ_b²)/Δt

        Neighbours share an event: their errors are correlated by −1/2.

        Returns:
            Start and end [s], speed and its standard error [rad/s], (N − 1,) each.
        """
        step = np.diff(self.t)
        speed = np.diff(self.angle) / step
        error = np.abs(speed) * np.hypot(self.error[:-1], self.error[1:]) / step
        return self.t[:-1], self.t[1:], speed, error

    def steady_speed(self) -> tuple[float, float]:
        """Speed of a shaft that turns evenly, and its standard error [rad/s].

        The slope of the angle over the instants, by least squares: every event counts, while the
        mean of the intervals is that of the first and the last event alone.
        """
        away = self.t - self.t.mean()
        speed = float(away @ (self.angle - self.angle.mean()) / (away @ away))
        n = len(self.t)
        rest = self.angle - self.angle.mean() - speed * away
        scatter = float(rest @ rest) / max(n - 2, 1)
        clock = float(np.mean(np.square(speed * self.error)))
        return speed, float(np.sqrt(max(scatter, clock) / (away @ away)))

    def trend(self) -> tuple[float, float]:
        """How much the speed changes from the first event to the last, and the error [rad/s]."""
        span = float(self.t[-1] - self.t[0])
        x = (self.t - self.t.mean()) / span
        terms = np.column_stack([np.ones(len(x)), x, x**2])
        theta, *_ = np.linalg.lstsq(terms, self.angle, rcond=None)
        rest = self.angle - terms @ theta
        speed = abs(float(self.angle[-1] - self.angle[0])) / span
        noise = max(
            float(rest @ rest) / max(len(x) - 3, 1), float(np.mean((speed * self.error) ** 2))
        )
        spread = np.linalg.pinv(terms.T @ terms)[2, 2]
        return 2.0 * float(theta[2]) / span, 2.0 * float(np.sqrt(noise * spread)) / span


def from_times(t: Array, pulses_per_turn: float, where: str) -> Events:
    """Events from the instants of pulses, so many a turn.

    Args:
        t: instants [s], (N,).
        pulses_per_turn: of the sensor; 1 for one marker.
    """
    if len(t) < MIN_EVENTS:
        raise DataError(
            f"{where}: {len(t)} events are too few for a steady speed; record {MIN_EVENTS}"
        )
    if not np.all(np.diff(t) > 0.0):
        row = int(np.flatnonzero(np.diff(t) <= 0.0)[0])
        raise DataError(
            f"{where}: the event at {t[row + 1]:g} s does not come after the one before it"
        )
    angle = _TURN / pulses_per_turn * np.arange(len(t), dtype=np.float64)
    return Events(t, angle, np.full(len(t), clock_step(t) / np.sqrt(12.0)))


def clock_step(t: Array) -> float:
    """Resolution of a clock [s]: the largest step of 1, 2 or 5 times a power of ten that all
    instants are multiples of; 0 where they are multiples of none."""
    for exponent in range(0, -10, -1):
        for head in (5.0, 2.0, 1.0):
            parts = t / (head * 10.0**exponent)
            if np.all(np.abs(parts - np.round(parts)) < 1e-6 * np.maximum(np.abs(parts), 1.0)):
                return float(head * 10.0**exponent)
    return 0.0


def from_counter(t: Array, angle: Array, tick: float) -> Events:
    """Events from the rows of a counter: where it changes, an edge was passed.

    With n ticks between two rows a time h apart the last edge was passed within the last h/n:

        t_e = t − h/(2n),    σ = h/(n √12).

    Args:
        t: instants of the rows [s], (N,).
        angle: count as an angle [rad], without wraps, (N,).
        tick: angle of one count [rad].
    """
    step = np.diff(angle)
    moved = np.flatnonzero(np.abs(step) > 0.5 * tick)
    h = np.diff(t)[moved]
    count = np.maximum(np.abs(step[moved]) / tick, 1.0)
    # backward the edge passed last is the upper one of the tick that was reached
    edge = angle[moved + 1] + np.where(step[moved] < 0.0, tick, 0.0)
    return Events(t[moved + 1] - 0.5 * h / count, edge, h / count / np.sqrt(12.0))


def require_steady(events: Events, where: str, voltage: float) -> None:
    """Refuse events of a motor that still runs up."""
    if len(events.t) <= MIN_EVENTS:
        return
    change, error = events.trend()
    speed, _ = events.steady_speed()
    if abs(change) > max(UNSTEADY * error, 0.02 * abs(speed)):
        raise DataError(
            f"{where}: at {voltage:g} V the speed changes by {100.0 * change / speed:.0f} % from "
            "the first event to the last; leave out the events before it is steady"
        )


def groups_of(*columns: Array) -> Sequence[slice]:
    """Stretches of rows over which all these columns keep their values."""
    changes = np.any([np.diff(c) != 0.0 for c in columns], axis=0)
    edges = [0, *(np.flatnonzero(changes) + 1).tolist(), len(columns[0])]
    return [slice(a, b) for a, b in pairwise(edges)]
