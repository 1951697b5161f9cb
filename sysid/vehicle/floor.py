"""The floor under a vehicle: a soil, patches of other soils, and its slope."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from sysid.errors import ModelError
from sysid.vehicle.kinematics import Real
from sysid.vehicle.soil import Soil
from sysid.vehicle.tracked import G

Corner = tuple[Real, Real]


class Circle(NamedTuple):
    """Everything within ``radius`` of (x, y) [m]."""

    x: Real
    y: Real
    radius: Real

    def contains(self, x: Real, y: Real, xp: Any) -> Real:
        dx, dy = x - self.x, y - self.y
        return dx * dx + dy * dy <= self.radius * self.radius


class HalfPlane(NamedTuple):
    """Everything to the left of the line from ``start`` towards ``end`` [m]."""

    start: Corner
    end: Corner

    def contains(self, x: Real, y: Real, xp: Any) -> Real:
        (ax, ay), (bx, by) = self.start, self.end
        return (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0.0


class Polygon(NamedTuple):
    """Everything inside of these corners [m]."""

    corners: tuple[Corner, ...]

    def contains(self, x: Real, y: Real, xp: Any) -> Real:
        """Whether a point lies in it: a ray from it crosses the edge an odd number of times."""
        odd = x != x
        for (ax, ay), (bx, by) in zip(
            self.corners, (*self.corners[1:], self.corners[0]), strict=True
        ):
            if ay == by:
                continue
            between = (ay > y) != (by > y)
            odd = odd != (between & (x < ax + (bx - ax) * (y - ay) / (by - ay)))
        return odd


@dataclass(frozen=True)
class Patch:
    """A part of the floor with a soil of its own."""

    area: Circle | HalfPlane | Polygon
    soil: Soil


@dataclass(frozen=True)
class Floor:
    """What a vehicle stands on.

    Attributes:
        soil: everywhere where no patch is.
        patches: later ones lie on earlier ones.
        slope: how much it rises a metre in X and in Y [1].
    """

    soil: Soil
    patches: tuple[Patch, ...] = ()
    slope: tuple[Real, Real] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not all(math.isfinite(s) for s in self.slope if isinstance(s, int | float)):
            raise ModelError(f"the floor's slope is {self.slope}: give its rise a metre in X and Y")

    def gravity(self, xp: Any) -> tuple[Real, Real, Real]:
        """Acceleration along X and Y, and into the floor [m/s²]."""
        sx, sy = self.slope
        if type(sx) is type(sy) is float and sx == sy == 0.0:
            return 0.0, 0.0, G
        into = G / xp.sqrt(1.0 + sx * sx + sy * sy)
        return -into * sx, -into * sy, into
