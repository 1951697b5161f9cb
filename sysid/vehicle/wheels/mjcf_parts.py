"""Parts of a MuJoCo model (MJCF): a body, rows of road wheels, actuators, and the floor.

A track is a row of wheels that turn together, as those under a track do, and touch the floor in
points with Coulomb friction that knows no direction: what it leaves for driving is what the slip to
the side does not need. With an even number of wheels at the middles of equal pieces of the contact
length, their mean distance from the centre is L/4, that of a uniform pressure.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np

from sysid.data.record import Array
from sysid.vehicle.tracked import G

STEP = 0.001
"""Step of the engine [s]: a tenth of the fastest time constant of its contacts."""

SAG = 0.002
"""Way by which the wheels' springs give under the load [m]: it spreads the load evenly, as the
road wheels of a track do. Without springs the loads on eight points of a rigid body are undecided,
and a contact model that lifts sliding points a little puts all of it on a few."""

ROAD_WHEELS = 4
"""Wheels of a row: with more of them the effective width changes by a hundredth."""

SERVO_SLIP = 0.005
"""Speed [rad/s] by which a servo gives way under the largest force that friction passes on: less
than the tenth part of what an encoder of a small robot resolves."""

SPIN_INERTIA = 1e-7
"""Of one road wheel [kg m²] about its axle: what the motor turns stands in :class:`Axle`."""


@dataclass(frozen=True)
class Axle:
    """What one side's sprocket feels of its motor besides the torque.

    Attributes:
        inertia: [kg m²].
        damping: [Nm/(rad/s)].
        dry: torque of dry friction [Nm].
    """

    inertia: float = 0.0
    damping: float = 0.0
    dry: float = 0.0


@dataclass(frozen=True)
class Row:
    """The wheels of one track.

    Attributes:
        y: how far to the left it stands [m].
        height: z of the axles in the frame of the body [m].
        places: how far each wheel stands ahead of the body's origin [m].
        r: radius [m].
        mass: of one wheel [kg].
        load: on one wheel at rest [N].
        friction: between wheel and floor; None leaves it to the engine.
        axle: of all wheels together.
    """

    name: str
    y: float
    height: float
    places: tuple[float, ...]
    r: float
    mass: float
    load: float
    friction: float | None = None
    axle: Axle = Axle()

    @property
    def joints(self) -> list[str]:
        return [f"{self.name}_{k}" for k in range(len(self.places))]

    @property
    def wheels(self) -> list[str]:
        """A body for each wheel, on a spring."""
        n, stiff = len(self.places), self.load / SAG
        damp = 2.0 * math.sqrt(stiff * self.mass)
        turned = (
            f'armature="{self.axle.inertia / n!r}" damping="{self.axle.damping / n!r}" '
            f'frictionloss="{self.axle.dry / n!r}"'
        )
        lines = []
        for name, x in zip(self.joints, self.places, strict=True):
            lines += [
                f'<body name={quoteattr(name + "_wheel")} pos="{words((x, self.y, self.height))}">',
                f'  <joint type="slide" axis="0 0 1" stiffness="{stiff!r}" damping="{damp!r}"/>',
                f'  <joint name={quoteattr(name)} axis="0 1 0" {turned}/>',
                f'  <inertial pos="0 0 0" mass="{self.mass!r}" '
                f'diaginertia="{words((SPIN_INERTIA,) * 3)}"/>',
                f'  <geom class="wheel" type="sphere" size="{self.r!r}"{friction(self.friction)}/>',
                "</body>",
            ]
        return lines

    @property
    def together(self) -> list[str]:
        """What makes them turn together."""
        first, *others = map(quoteattr, self.joints)
        return [f'<joint joint1={j} joint2={first} solref="0.002 1"/>' for j in others]

    def servo(self) -> str:
        """What holds their speed at a control [rad/s], whatever friction passes on.

        It acts on one wheel, to which the others are tied: the engine takes a servo on all of them
        at once (through a tendon) as a force of the step before, which swings when it is stiff.
        """
        grip = 1.0 if self.friction is None else self.friction
        force = grip * self.load * len(self.places) * self.r
        return f'<velocity {self.acts} kv="{force / SERVO_SLIP!r}"/>'

    @property
    def acts(self) -> str:
        """Attributes of an actuator that turns them."""
        return f"name={quoteattr(self.name)} joint={quoteattr(self.joints[0])}"


def under_a_track(L: float, n: int = ROAD_WHEELS) -> Array:
    """How far each wheel of a row lies ahead of its middle [m], (n,)."""
    return L * ((np.arange(n) + 0.5) / n - 0.5)


def friction(mu: float | None) -> str:
    """An attribute of a geom; the engine takes the larger of two that touch."""
    return "" if mu is None else f' friction="{mu!r}"'


def words(values: Iterable[float]) -> str:
    """Numbers of an attribute, none of them −0."""
    return " ".join(repr(float(v) + 0.0) for v in values)


def options(step: float = STEP) -> list[str]:
    """How the engine computes; a model that has lost itself is not set back in silence.

    A pyramid for a cone of friction would know directions. ``impratio`` makes friction fifty times
    stiffer than what holds the wheels up: else they creep under forces that friction holds.
    """
    return [
        f'<option timestep="{step!r}" gravity="0 0 -{G}" cone="elliptic" impratio="50" '
        'integrator="implicitfast"><flag autoreset="disable"/></option>',
        "<default>",
        '  <geom solref="0.007 1" solimp="0.9 0.95 0.001" condim="3"/>',
        '  <joint solreffriction="0.002 1" solimpfriction="0.99 0.999 0.001"/>',
        '  <default class="wheel">'
        '<geom contype="0" conaffinity="3" rgba=".16 .17 .2 1"/></default>',
        '  <default class="body"><geom contype="0" conaffinity="2" mass="0"/></default>',
        '  <default class="obstacle">'
        '<geom contype="2" conaffinity="0" rgba=".95 .5 .13 1"/></default>',
        "</default>",
    ]


def floor(mu: float | None) -> list[str]:
    """A level floor without end, and light."""
    return [
        '<light pos="0 0 4" dir="0 0 -1" directional="true" diffuse=".7 .7 .7"/>',
        f'<geom name="floor" type="plane" size="0 0 1" conaffinity="0"{friction(mu)} '
        'rgba=".86 .87 .88 1"/>',
    ]


def block(tag: str, lines: Sequence[str], more: str = "") -> list[str]:
    """An element around others; none for none."""
    return [f"<{tag}{more}>", *(f"  {line}" for line in lines), f"</{tag}>"] if lines else []
