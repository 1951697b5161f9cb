"""Dead time of a servo, read off while it moves one way."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array, Record
from sysid.diagnosis.search.motion_equations import Motion, motion_equation

MOVES = 8.0
"""Change of the position over two samples, in its noise, from which it moves."""

ORDER = 2
"""Of the motion that is regressed: a mass in a loop that is stiff and damped."""

SURE = 0.5
"""Share of the linear model's squares that a shorter dead time must leave at most. Behind play and
friction it left a twentieth; behind a limit of the rate, which no linear motion is, nearly all."""


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
    tracks = range(len(noise))
    left = [sum(_squares(records, noise, n, most, i) for i in tracks) for n in tried]
    return 1 + int(np.argmin(left)) if min(left) < SURE * left[-1] < np.inf else most


def _squares(records: Sequence[Record], noise: Array, n: int, most: int, track: int) -> float:
    """What dead time n leaves of the motion, squared and in units of the noise; inf for too few."""
    rests = MOVES * noise[track]
    moving = []
    for r in records:
        u, y = r.u[:, track], r.y[:, track]
        at = np.arange(ORDER + most, len(y) - 1)
        way, before = y[at + 1] - y[at - 1], y[at] - y[at - 2]
        at = at[(np.abs(way) > rests) & (before * np.sign(way) > -rests)]
        moving.append(Motion(y, u, at, (np.sign(y[at + 1] - y[at - 1]), np.ones(len(at)))))
    equation = motion_equation(moving, ORDER, n)
    return np.inf if equation is None else equation.squares / max(float(noise[track]), 1e-12) ** 2
