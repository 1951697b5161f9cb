"""Degrees of mobility, steerability and manoeuvrability, and centres of rotation."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from sysid.data.record import Array
from sysid.vehicle.wheels.constraints import (
    Angles,
    Scale,
    constraints,
    free_motions,
    rank,
    rows_of,
)
from sysid.vehicle.wheels.wheel import Wheel, velocity_at

FARTHEST = 1e5
"""Sizes of the vehicle beyond which a centre counts as infinitely far: angles written with five
decimals look parallel to this extent."""

ROUNDING = 1e-12
"""Share that sums of a handful of products may lose."""

Point = tuple[float, float]

_PROBES = ((0.731, 1.417), (-1.213, 0.611), (0.377, -1.773))
"""Centres at which steerable wheels are tried, in sizes of the vehicle: three places without any
symmetry, so that not all of them fall on an axle or on a wheel."""


@dataclass(frozen=True)
class Degrees:
    """The degrees of freedom of a set of wheels (Campion 1996; thesis 2.21, 2.23).

    Attributes:
        mobility: δm = 3 − rank C1, of the motion that wheel speeds alone give at once.
        steerability: δs, of the centre of turning that steering moves: rank C1 less that of the
            fixed wheels' rows alone.
    """

    mobility: int
    steerability: int

    @property
    def manoeuvrability(self) -> int:
        """δM = δm + δs."""
        return self.mobility + self.steerability


class IcrKind(Enum):
    """What is known of the instantaneous centre of rotation; the value says what the body does."""

    POINT = "rotates about a fixed centre, or rests"
    LINE = "turns about any point of a line, as wheel speeds choose"
    INFINITY = "axles are parallel: drives straight, or stands"
    ANYWHERE = "turns about any point of the plane, as wheel speeds choose"
    NONE = "axles do not meet in one point: stands, or wheels slide"
    STANDSTILL = "stands: there is no centre"


@dataclass(frozen=True)
class Icr:
    """The instantaneous centre of rotation in the body frame.

    Attributes:
        kind: a point, a line of possible ones, at infinity, anywhere, or none.
        point: x, y [m] of the point, or of the line where it passes the wheels nearest.
        direction: unit vector along the line; of the motion where the centre is at infinity.
    """

    kind: IcrKind
    point: Point | None = None
    direction: Point | None = None


def degrees(wheels: Sequence[Wheel]) -> Degrees:
    """δm and δs of wheels, with steerable ones turned so that the axles of all of them meet.

    The degrees belong to the vehicle, not to its present steering angles: what two steered wheels
    of a car lose at angles that do not fit is no property of the car.
    """
    scale = Scale.of(wheels)
    fixed = rows_of([w.sliding_row() for w in wheels if w.kind == "fixed"])
    of_fixed = rank(fixed, scale)
    steered = [w for w in wheels if w.kind == "steerable"]
    if of_fixed >= 2 or not steered:  # steered wheels can only follow a centre that is settled
        return Degrees(3 - of_fixed, 0)
    together = max(
        rank(np.vstack([fixed, rows_of([_aimed(w, centre) for w in steered])]), scale)
        for centre in _possible_centres(fixed, scale)
    )
    return Degrees(3 - together, together - of_fixed)


def icr(wheels: Sequence[Wheel], angles: Angles | None = None) -> Icr:
    """Where the body can turn about at steering angles, whatever the speeds of the wheels."""
    scale = Scale.of(wheels)
    rows = constraints(wheels, angles).C1
    allowed = free_motions(rows, scale)
    dimension = allowed.shape[1]
    if dimension == 0:
        return Icr(IcrKind.NONE)
    if dimension == 3:
        return Icr(IcrKind.ANYWHERE)
    if dimension == 1:  # the same motion forward or backward: said as forward, else to the left
        twist = scale.matrix @ allowed[:, 0]
        leading = next(v for v in (*twist[:2], 1.0) if abs(v) * FARTHEST > np.linalg.norm(twist))
        return icr_of_twist(np.copysign(1.0, leading) * twist, scale)
    point, along = _line(rows, scale)
    return Icr(IcrKind.LINE, point, along)


def icr_of_twist(twist: Array, scale: Scale) -> Icr:
    """The centre about which a twist (Vx, Vy, ψ̇) turns the body: (−Vy/ψ̇, Vx/ψ̇) [m]."""
    z = scale.scaled(twist)
    size, forward, sideways = float(np.linalg.norm(z)), float(z[0]), float(z[1])
    if size == 0:
        return Icr(IcrKind.STANDSTILL)
    if abs(z[2]) * FARTHEST <= size:
        speed = math.hypot(forward, sideways)
        return Icr(IcrKind.INFINITY, direction=_clean((forward / speed, sideways / speed), 1.0))
    vx, vy, yaw_rate = map(float, twist)
    return Icr(IcrKind.POINT, point=_clean((-vy / yaw_rate, vx / yaw_rate), scale.length))


def misalignment(wheels: Sequence[Wheel], angles: Angles | None = None) -> dict[str, float]:
    """How far each fixed or steerable wheel points off the motion that suits all of them best.

    Returns:
        Angle by name [rad], to be added to the wheel's direction; zeros where they fit together.
    """
    scale, at = Scale.of(wheels), angles or {}
    fitting = [w for w in wheels if w.constrains]
    rows = rows_of([w.sliding_row(at.get(w.name)) for w in fitting])
    if rank(rows, scale) < 3:
        return dict.fromkeys((w.name for w in fitting), 0.0)
    _, _, right = np.linalg.svd(rows @ scale.matrix)
    twist = scale.matrix @ right[2]
    by_wheel = {}
    for wheel in fitting:
        vx, vy = velocity_at(wheel.contact(at.get(wheel.name)), twist)
        by_wheel[wheel.name] = nearest_turn(
            math.atan2(vy, vx) - wheel.direction(at.get(wheel.name))
        )
    return by_wheel


def nearest_turn(angle: float) -> float:
    """The angle [rad] brought into (−π/2, π/2] by half turns, as a wheel rolls both ways."""
    return math.pi / 2 - (math.pi / 2 - angle) % math.pi


def _aimed(wheel: Wheel, centre: Point) -> list[float]:
    """The sliding row of a steerable wheel whose axle points at a centre."""
    x, y = wheel.position
    return wheel.sliding_row(math.atan2(centre[1] - y, centre[0] - x) - math.pi / 2 - wheel.heading)


def _possible_centres(fixed: Array, scale: Scale) -> Iterator[Point]:
    """Centres that the fixed wheels allow, which are none or on one common axle."""
    if not len(fixed):
        yield from ((scale.x + a * scale.length, scale.y + b * scale.length) for a, b in _PROBES)
        return
    (x, y), (dx, dy) = _line(fixed, scale)
    for across, along in _PROBES:
        far = (across + along) * scale.length
        yield x + far * dx, y + far * dy


def _line(rows: Array, scale: Scale) -> tuple[Point, Point]:
    """The common axle of rows of rank 1: its point nearest to the wheels' centre, its direction.

    A body that turns about c has ξ = ψ̇ (c_y, −c_x, 1), so that a row (a, b, l) asks
    a c_y − b c_x + l = 0.
    """
    _, _, right = np.linalg.svd(rows @ scale.matrix)
    a, b, lever = map(float, right[0] @ np.linalg.inv(scale.matrix))
    size = math.hypot(a, b)
    a, b, lever = a / size, b / size, lever / size
    away = lever + a * scale.y - b * scale.x
    point = (scale.x + away * b, scale.y - away * a)
    leading = b if abs(b) > ROUNDING else a  # one direction of two, whatever rounding left of zero
    flip = -1.0 if leading < 0.0 else 1.0
    return _clean(point, scale.length), _clean((flip * a, flip * b), 1.0)


def _clean(point: Point, length: float) -> Point:
    """The point without what sums of a few products leave where a coordinate is 0."""
    x, y = (0.0 if abs(v) <= ROUNDING * length else v for v in point)
    return x, y
