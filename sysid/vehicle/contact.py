"""A track on the floor: thrust from slip, resistances, and lateral friction.

Lateral friction of tracks: force and moment together.

Every point of a track at x along the vehicle slides sideways at v_y + ψ̇x, and Coulomb's friction
opposes it with q per metre, of all tracks together. Summed over −L/2 … L/2, with the instantaneous
centre at x_ICR = −v_y/ψ̇ between the ends,

    F_y = −sign(ψ̇)·2q x_ICR        M_r = sign(ψ̇)·q (L²/4 − x_ICR²)

taken from the motion, which is (2.35) and (2.36) with q = μl mg/L (there 4μl(mg/2L) and
2μl(mg/2L)), and M_r = μl W L/4 at x_ICR = 0 (Wong). Beyond the ends the whole length slides one
way: |F_y| = qL, M_r = 0. The pairs (F_y, M_r) that friction can take fill the lens between the
two parabolas |M_r| ≤ q (L²/4 − (F_y/2q)²); on its edge it slides (as
:mod:`sysid.vehicle.ground.resistance` has it), inside it sticks.
"""

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


NEWTON_STEPS = 6
"""From the end of the track to the root of a convex cubic: digits double from the second on."""


class Taken(NamedTuple):
    """What lateral friction takes from the motion.

    Attributes:
        side: force against v_y [N].
        turning: moment against ψ̇ [Nm].
        sticks: whether it could take more.
    """

    side: Real
    turning: Real
    sticks: Real


def nearest(
    wanted: tuple[Real, Real], q: Real, half: Real, ease: tuple[Real, Real], xp: Any
) -> Taken:
    """What friction takes where ``wanted`` would stop all motion: the nearest point of the lens.

    Nearest in the metric of the motion that is left, w₁ΔF² + w₂ΔM², which makes the outcome
    Coulomb's law: on the edge the motion that is left has its centre where the edge says so.

    Args:
        wanted: force [N] and moment [Nm].
        q: friction per metre of length, both tracks together [N/m].
        half: L/2 [m].
        ease: w₁, w₂: motion that a unit of each changes, 1/m and 1/J.
    """
    force, moment = xp.abs(wanted[0]), xp.abs(wanted[1])
    q = xp.maximum(q, 1e-12)  # no friction at all takes nothing: the lens is a point
    reach = 0.5 * force / q
    inside = (reach < half) & (moment < q * (half * half - reach * reach))
    # Edge point (2qa, q(L²/4 − a²)): a³ + αa = β where the distance is smallest. β ≥ 0, and from
    # the end of the track Newton's steps come down to the root monotonically.
    ratio = ease[0] / ease[1]
    alpha = 2.0 * ratio + moment / q - half * half
    beta = ratio * force / q
    a = half
    for _ in range(NEWTON_STEPS):
        a = (2.0 * a * a * a + beta) / (3.0 * a * a + alpha)
    a = xp.minimum(a, half)
    side = xp.where(inside, force, 2.0 * q * a)
    turning = xp.where(inside, moment, q * (half * half - a * a))
    return Taken(xp.sign(wanted[0]) * side, xp.sign(wanted[1]) * turning, inside)
