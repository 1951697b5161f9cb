"""Steering angles for a motion, and the motion nearest to a wanted one that their limits allow."""

import math
from collections.abc import Iterator, Sequence
from itertools import combinations, product

import numpy as np

from sysid.data.record import Array
from sysid.errors import UsageError
from sysid.vehicle.wheels.constraints import Scale, rows_of
from sysid.vehicle.wheels.mobility import ROUNDING, nearest_turn
from sysid.vehicle.wheels.wheel import Wheel, velocity_at

MOST_LIMITED = 6
"""Wheels with limits whose ways of rolling can all be tried: 2⁶ take a fifth of a second."""

_EDGE = 1e-9
"""How far [rad] an angle that lies on a limit may stand beyond it by rounding."""


def steered(wheel: Wheel, twist: Array) -> float:
    """The steering angle for a twist: of two, the one within the limits, or the nearer one."""
    vx, vy = velocity_at(wheel.position, twist)
    if math.hypot(vx, vy) <= ROUNDING * (1.0 + float(np.abs(twist).max())):
        return wheel.angle  # the body turns about this wheel: any angle will do
    angle = wheel.angle + nearest_turn(math.atan2(vy, vx) - wheel.heading - wheel.angle)
    if wheel.angle_limits is None:
        return angle
    low, high = wheel.angle_limits
    turns = (angle, angle - math.pi, angle + math.pi)
    inside = (a for a in turns if low - _EDGE <= a <= high + _EDGE)
    return min(max(next(inside, angle), low), high)


def within_limits(z: Array, basis: Array, wheels: Sequence[Wheel], scale: Scale) -> Array:
    """The scaled twist nearest to z within a space, for which wheels need not turn too far.

    The velocity of a wheel's axis must lie between its directions at both limits, forward or
    backward: two inequalities for each way, so that for each choice of ways the twists are a cone.
    The nearest one of a cone is a projection on some of its faces; in three dimensions these are
    few enough to try all.

    Args:
        z: wanted, (3,), in the space.
        basis: of the space, orthonormal, (3, d).

    Raises:
        UsageError: more wheels have limits than can be tried.
    """
    limited = [w for w in wheels if w.angle_limits and np.ptp(w.angle_limits) < math.pi]
    if not limited:
        return z
    if len(limited) > MOST_LIMITED:
        raise UsageError(
            f"{len(limited)} steered wheels have limits, of which {MOST_LIMITED} can be kept at "
            "once: leave out angle_limits of the others"
        )
    wanted = basis.T @ z
    best, error = np.zeros(basis.shape[1]), float(np.linalg.norm(wanted))
    for walls in _cones(limited, basis, scale):
        for projection in _projections(wanted, walls):
            away = float(np.linalg.norm(projection - wanted))
            inside = (walls @ projection >= -_EDGE * (1.0 + error)).all()
            if inside and away < error - ROUNDING:
                best, error = projection, away
    nearest: Array = basis @ best
    return nearest


def _cones(wheels: Sequence[Wheel], basis: Array, scale: Scale) -> Iterator[Array]:
    """The inequalities G y ≥ 0, (2k, d), of every choice of ways in which wheels may roll."""
    pairs = []
    for wheel in wheels:
        low, high = wheel.angle_limits or (0.0, 0.0)
        between = rows_of([wheel.sliding_row(low), wheel.sliding_row(high)])
        pairs.append(np.array([[1.0], [-1.0]]) * between @ scale.matrix @ basis)
    for signs in product((1.0, -1.0), repeat=len(pairs)):
        yield np.vstack([sign * pair for sign, pair in zip(signs, pairs, strict=True)])


def _projections(wanted: Array, walls: Array) -> Iterator[Array]:
    """The wanted point on every face of a cone that is more than its tip."""
    yield wanted
    for count in range(1, len(wanted)):
        for chosen in combinations(range(len(walls)), count):
            face = walls[list(chosen)]
            yield wanted - np.linalg.pinv(face) @ (face @ wanted)
