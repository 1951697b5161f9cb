"""A box on two rows of wheels as MuJoCo XML.

The contact of its tracks with the floor is described in :mod:`sysid.vehicle.wheels.mjcf_parts`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sysid.data.record import Array
from sysid.vehicle.tracked import G
from sysid.vehicle.wheels.body import box_inertia
from sysid.vehicle.wheels.mjcf_parts import (
    ROAD_WHEELS,
    STEP,
    Axle,
    Row,
    block,
    floor,
    friction,
    options,
    under_a_track,
    words,
)

WHEEL_SHARE = 1.0 / 75.0
"""Of the machine's mass in one wheel: 20 g of 1.5 kg."""

SERVO_INERTIA = 2.0
"""What a servo turns with a row, over m r²: that of the thesis's rotors behind their gear under its
robot. It follows the machine's mass, so that machines of all masses move alike."""

OBSTACLE_HEIGHT = 0.25
"""Of obstacles and walls [m] (thesis 8.2.2)."""

WALL = 0.005
"""Half the thickness of a wall [m]."""


LEAST_MOMENT = 0.1
"""Share of a solid box's moment that the box keeps beside its wheels: none has no moment."""


SLACK = 1.0 + 1e-6
"""Of two principal moments the sum is not below the third, rounding included."""


@dataclass(frozen=True)
class Machine:
    """A box on two rows of wheels whose speeds servos hold.

    Without anything else it is the vehicle of the thesis's simulation in Gazebo (7.2.2, 8.2).

    Attributes:
        mass: of the whole [kg].
        yaw_inertia: of the whole, about the vertical through the centre of mass [kg m²]; None for
            that of a solid box on its wheels.
        r, B, L: radius of the wheels, distance of the rows, contact length [m].
        size: length, width, height of the box [m].
        height: of the centre of mass over the floor [m].
        centre: how far the centre of mass lies ahead of the middle of the wheels [m].
        wheels: of one row; an even number.
        friction: between wheels and floor [1].
    """

    mass: float = 1.5
    yaw_inertia: float | None = None
    r: float = 0.0215
    B: float = 0.186
    L: float = 0.14
    size: tuple[float, float, float] = (0.19, 0.134, 0.047)
    height: float = 0.03
    centre: float = 0.0
    wheels: int = ROAD_WHEELS
    friction: float = 0.1

    @property
    def places(self) -> Array:
        """How far each wheel of a row lies ahead of its middle [m], (wheels,)."""
        return under_a_track(self.L, self.wheels)

    @property
    def load(self) -> float:
        """On each wheel at rest [N]."""
        return self.mass * G / (2 * self.wheels)

    @property
    def axle(self) -> Axle:
        """What turns with the wheels of a row, and what resists."""
        return Axle(SERVO_INERTIA * self.mass * self.r**2)

    @property
    def actuators(self) -> list[str]:
        """What drives the rows."""
        return [row.servo() for row in self.rows]

    @property
    def rows(self) -> tuple[Row, Row]:
        """The left and the right track."""
        mass = WHEEL_SHARE * self.mass * ROAD_WHEELS / self.wheels
        common = (self.r, tuple(self.places.tolist()), self.r, mass, self.load)
        left, right = (
            Row(side, y, *common, self.friction, self.axle)
            for side, y in (("left", 0.5 * self.B), ("right", -0.5 * self.B))
        )
        return left, right

    @property
    def _box(self) -> tuple[float, Array]:
        """Mass [kg] and principal moments [kg m²] of the solid box without its wheels, (3,)."""
        box_mass = self.mass - 2 * self.wheels * self.rows[0].mass
        return box_mass, np.diag(box_inertia(box_mass, self.size))

    @property
    def _of_wheels(self) -> float:
        """The wheels' part of the moment about the vertical [kg m²]."""
        places = float(np.sum(self.places**2)) + self.wheels * (0.5 * self.B) ** 2
        return 2.0 * self.rows[0].mass * places

    @property
    def moment(self) -> float:
        """About the vertical [kg m²]: what is given, or that of a solid box on its wheels."""
        solid = float(self._box[1][2]) + self._of_wheels
        return solid if self.yaw_inertia is None else self.yaw_inertia

    @property
    def body(self) -> list[str]:
        """The box without its wheels: mass and principal moments, and what obstacles touch.

        A given moment about the vertical goes with such about the other axes as some body has.
        """
        box_mass, (roll, pitch, least) = self._box
        yaw = max(self.moment - self._of_wheels, LEAST_MOMENT * least)
        roll = max(roll, (yaw - pitch) * SLACK)
        tall = self.size[2]
        # a box of which the middle is the centre of mass would cut the floor where that lies low
        middle = max(self.height, 0.5 * tall)
        return [
            f'<inertial pos="{words((self.centre, 0.0, self.height))}" mass="{box_mass!r}" '
            f'diaginertia="{words((roll, pitch, yaw))}"/>',
            f'<geom class="body" type="box" pos="{words((0.0, 0.0, middle))}" '
            f'size="{words(0.5 * s for s in self.size)}"{friction(self.friction)} '
            'rgba=".27 .42 .62 1"/>',
        ]


def scene(
    machine: Machine,
    step: float = STEP,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    around: Sequence[str] = (),
) -> str:
    """The machine on its floor, in MuJoCo's XML.

    Args:
        step: of the engine [s].
        start: x, y [m] and ψ [rad] of the middle of the wheels.
        around: elements of the world beside it.
    """
    rows, (x, y, psi) = machine.rows, start
    turn = words((np.cos(0.5 * psi), 0.0, 0.0, np.sin(0.5 * psi)))
    body = block(
        "body",
        ["<freejoint/>", *machine.body, *(line for row in rows for line in row.wheels)],
        f' name="box" pos="{words((x, y, 0.0))}" quat="{turn}"',
    )
    return "\n".join(
        block(
            "mujoco",
            [
                *options(step),
                *block("worldbody", [*floor(machine.friction), *around, *body]),
                *block("equality", [line for row in rows for line in row.together]),
                *block("actuator", machine.actuators),
            ],
        )
    )


def cylinder(x: float, y: float, radius: float, mu: float, name: str = "") -> list[str]:
    """A round obstacle that stands [m]; with a name, one that is moved from outside."""
    pos = words((x, y, 0.5 * OBSTACLE_HEIGHT))
    geom = (
        f'<geom class="obstacle" type="cylinder" size="{words((radius, 0.5 * OBSTACLE_HEIGHT))}"'
        f"{friction(mu)}"
    )
    if not name:
        return [f'{geom} pos="{pos}"/>']
    return block("body", [f"{geom}/>"], f' name="{name}" mocap="true" pos="{pos}"')


def wall(points: Sequence[tuple[float, float]], mu: float) -> list[str]:
    """Thin upright plates from point to point [m]."""
    pieces = []
    for (ax, ay), (bx, by) in pairwise(points):
        half, angle = 0.5 * float(np.hypot(bx - ax, by - ay)), float(np.arctan2(by - ay, bx - ax))
        pos = words((0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * OBSTACLE_HEIGHT))
        quat = words((np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)))
        size = words((half + WALL, WALL, 0.5 * OBSTACLE_HEIGHT))
        pieces.append(
            f'<geom class="obstacle" type="box" size="{size}" pos="{pos}" quat="{quat}"'
            f"{friction(mu)}/>"
        )
    return pieces
