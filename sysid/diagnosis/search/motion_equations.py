"""Cores, loads and dead times by regressions of measured motion, where no free run says them.

F(q) y(k + 1) = B(q) u(k + 1 − n) + further columns is linear in all its parameters. While a servo
moves one way, friction and a load are such columns; a weight over the angle always is two. A
baseline without them follows nothing: it has nearly no gain, and no error shows the effect.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array, Index, Record
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import Data
from sysid.effects.base import OF_SERVO, Effect, Wave
from sysid.effects.catalogue import LEVEL

LEAST_ROWS = 10
"""Rows a parameter of the regression, below which it says nothing."""

MOVES = 8.0
"""Change of a position over two samples, in its noise, from which it moves."""

SPANS = (1, 2, 3)
"""Samples over which the direction of the motion is taken; each is a start."""

ORDER_OF_SERVO = 2
"""Of the motion whose dead time is read: a mass in a loop that is stiff and damped."""

SURE = 0.5
"""Share of the linear model's squares that a shorter dead time must leave at most. Behind play and
friction it left a twentieth; behind a limit of the rate, which no linear motion is, nearly all."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Rows of a record on which it moves as the equation says.

    Attributes:
        y, u: measurements and commands, (N,).
        at: the rows k, (n,).
        beside: further columns, (n,) each.
    """

    y: Array
    u: Array
    at: Index
    beside: Sequence[Array]


def motion_equation(
    records: Iterable[Motion], order: int, delay: int = 1
) -> tuple[Array, float] | None:
    """The equation of some records together, by least squares; None where too few rows determine
    it.

    Args:
        delay: n, the samples until a command acts.

    Returns:
        (factors of past measurements, of past commands and of the further columns; the sum of
        squares that they leave).
    """
    rows, rights = [], []
    for r in records:
        past = [r.y[r.at - j] for j in range(order)]
        past += [r.u[r.at + 1 - delay - j] for j in range(order)]
        rows.append(np.column_stack([*past, *r.beside]))
        rights.append(r.y[r.at + 1])
    A, b = np.concatenate(rows or [np.empty((0, 1))]), np.concatenate(rights or [np.empty(0)])
    if len(b) < LEAST_ROWS * A.shape[1]:
        return None
    theta = np.linalg.lstsq(A, b, rcond=None)[0]
    left = b - A @ theta
    return theta, float(left @ left)


Moving = Callable[[Array, Array, Index], tuple[Index, Sequence[Array]]]
"""(measurements of a record, angle counted before each, rows that count) → (those on which it moves
as the equation says, further columns on them)."""


def _with_core(
    model: FullModel, row: Array, data: Data, track: int, first: int, moving: Moving
) -> Array | None:
    """Put the core of a track's motion into ``row``; the further factors over F(1).

    None where too few rows determine the core, or it is unstable.

    Args:
        first: row of each record from which ``moving`` is asked.
    """
    n, motions = model.order, []
    columns = (x[:, track] for x in (data.drive, data.y, data.weight, data.counted))
    for u, y, weight, angle in zip(*map(data.split, columns), strict=True):
        at = np.arange(first, len(y) - 1)
        counts = np.min([weight[at - j] for j in range(-1, n)], axis=0) > 0.0
        at, beside = moving(y, angle, at[counts])
        motions.append(Motion(y, u, at, beside))
    if (equation := motion_equation(motions, n)) is None:
        return None
    theta, f = equation[0], -equation[0][:n]
    size = 1.0 + float(f.sum())
    if not size > 1e-9 or np.any(np.abs(np.roots([1.0, *f])) >= 1.0):
        return None
    model.set_core(row, track, float(theta[n : 2 * n].sum()) / size, f)
    return np.asarray(theta[2 * n :] / size)


def friction_of_servo(model: FullModel, e: Effect, q: Array, data: Data) -> list[Array]:
    """Starts with cores and friction with which a servo moves as it was seen to.

    While it moves one way, F(q) y = B(q) u − F(1) (c sign ẏ + l) is linear in all parameters.

    Args:
        e: friction with a law of servos; its first parameter is c.
        q: parameters of the model without it, (parameters,).
    """
    rows = []
    for span in SPANS:
        row = q.copy()
        for i in range(model.tracks):
            rests = MOVES * data.noise[i]

            def one_way(
                y: Array, angle: Array, at: Index, span: int = span, rests: float = rests
            ) -> tuple[Index, Sequence[Array]]:
                moved, goes_on = y[at] - y[at - 2 * span], y[at + 1] - y[at - span]
                on = (np.abs(moved) > rests) & (goes_on * moved > 0.0)
                return at[on], (np.sign(moved[on]), np.ones(int(on.sum())))

            further = _with_core(model, row, data, i, max(2 * span, model.order), one_way)
            if further is None:
                break
            row[model.index[e.id, e.parameters[0].name, i]] = max(float(-further[0]), 0.0)
            row[model.index[e.id, OF_SERVO, i]] = 1.0
            if (bias := (LEVEL.id, LEVEL.parameters[0].name, i)) in model.index:
                row[model.index[bias]] = -further[1]
        else:
            rows.append(row)
    return rows


def weight_over_angle(
    model: FullModel, e: Effect, wave: Wave, q: Array, data: Data
) -> Array | None:
    """A start with core and weight; None where the motion does not determine them.

    F(q) ω = B(q) K d − F(1) (a cos θ + b sin θ), with θ counted from the measurements.

    Args:
        wave: that of the law, a torque.
        q: parameters of the model without it, (parameters,).
    """
    row = q.copy()
    for i in range(model.tracks):
        line = model.parameters[model.index[e.id, wave.line, i]].null

        def turning(
            y: Array, counted: Array, at: Index, line: float = line
        ) -> tuple[Index, Sequence[Array]]:
            angle = line * (counted[at] + 0.5 * model.dt * y[at])
            return at, (np.cos(angle), np.sin(angle))

        further = _with_core(model, row, data, i, model.order - 1, turning)
        if further is None:
            return None
        for name, value in zip((wave.cosine, wave.sine), -further, strict=True):
            k = model.index[e.id, name, i]
            row[k] = model.parameters[k].within(float(value))
    return row


def servo_delay(records: Sequence[Record], noise: Array, most: int) -> int:
    """Whole samples from a set point to the position, 1 … ``most``, of all tracks.

    Friction and play wait at each reversal, and a dead time that is chosen over the whole log takes
    their waiting in: effects could then no longer start in time. While the position goes one way
    F(q) y = B(q) u(k − n) + c sign ẏ + l is linear in all parameters; an n that leaves far smaller
    squares than ``most`` is the dead time.

    Args:
        records: set points u and positions y, a track a column.
        noise: standard deviation of each position's measurements, (tracks,).
        most: dead time of the linear model.
    """
    tried = range(1, most + 1)
    left = [sum(_squares(records, noise, n, most, i) for i in range(len(noise))) for n in tried]
    return 1 + int(np.argmin(left)) if min(left) < SURE * left[-1] < np.inf else most


def _squares(records: Sequence[Record], noise: Array, n: int, most: int, track: int) -> float:
    """What dead time n leaves of the motion, squared and in units of the noise; inf for too few."""
    rests = MOVES * noise[track]
    moving = []
    for r in records:
        u, y = r.u[:, track], r.y[:, track]
        at = np.arange(ORDER_OF_SERVO + most, len(y) - 1)
        way, before = y[at + 1] - y[at - 1], y[at] - y[at - 2]
        on = (np.abs(way) > rests) & (before * np.sign(way) > -rests)
        moving.append(Motion(y, u, at[on], (np.sign(way[on]), np.ones(int(on.sum())))))
    equation = motion_equation(moving, ORDER_OF_SERVO, n)
    return np.inf if equation is None else equation[1] / max(float(noise[track]), 1e-12) ** 2
