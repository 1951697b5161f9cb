"""A track on the floor: thrust from slip, and resistances."""

from typing import Any, NamedTuple

from sysid.vehicle.floor import Floor
from sysid.vehicle.ground.resistance import compaction_resistance
from sysid.vehicle.kinematics import Real
from sysid.vehicle.shear import largest_stress, uniform_thrust
from sysid.vehicle.soil import Soil
from sysid.vehicle.tracked import TrackedVehicle

Pair = tuple[Real, Real]
"""Of the left and of the right track."""


class Grip(NamedTuple):
    """What the floor under one track gives.

    Attributes:
        thrust: at the slip that was asked for [N].
        most: the largest there is, by Mohr and Coulomb [N].
        rolling: largest resistance to rolling: that of the running gear (2.34), and what pressing
            the ground together takes [N].
        lateral: largest lateral friction [N].
    """

    thrust: Real
    most: Real
    rolling: Real
    lateral: Real


def grip(
    floor: Floor, at: tuple[Real, Real], load: Real, slip: Real, car: TrackedVehicle, xp: Any
) -> Grip:
    """What the soil under the middle of a track gives.

    Args:
        at: X, Y of the middle of the track [m].
        load: normal load on it [N].
        slip: i [1].
    """
    chosen = _on(floor.soil, load, slip, car, xp)
    for patch in floor.patches:
        here = patch.area.contains(*at, xp)
        other = _on(patch.soil, load, slip, car, xp)
        chosen = Grip(*(xp.where(here, b, a) for a, b in zip(chosen, other, strict=True)))
    return chosen


def _on(soil: Soil, load: Real, slip: Real, car: TrackedVehicle, xp: Any) -> Grip:
    length, width = car.contact_length, car.track_width
    return Grip(
        uniform_thrust(soil, load, slip, length, width, xp),
        length * width * largest_stress(soil, load / (length * width), xp),
        soil.rolling * load + compaction_resistance(soil, load, length, width, xp=xp),
        soil.lateral * load,
    )


def tracks_at(x: Real, y: Real, heading: Pair, car: TrackedVehicle) -> tuple[Pair, Pair]:
    """X, Y of the middles of the left and the right track [m].

    Args:
        x, y: of the vehicle's middle [m].
        heading: cos ψ and sin ψ.
    """
    cos, sin = heading
    half = 0.5 * car.geometry.B
    return (x - half * sin, y + half * cos), (x + half * sin, y - half * cos)


def loads(car: TrackedVehicle, into: Real, outward: Real, xp: Any) -> Pair:
    """Normal load of the left and of the right track: half the weight each, and what is moved [N].

    Args:
        car: mass, height of the centre of mass, track distance.
        into: acceleration of free fall into the floor [m/s²].
        outward: what pushes the vehicle to its right: v_xψ̇ of a turn to the left, less what a
            slope pulls to the left [m/s²].
    """
    half = 0.5 * car.mass * into
    moved = car.mass * outward * car.height / car.geometry.B
    moved = xp.minimum(xp.maximum(moved, -half), half)
    return half - moved, half + moved
