"""Kinematics of slipping tracks (thesis 2.24–2.26), and the slips of a steady motion."""

from typing import Any

from sysid.runners.loops import bisected
from sysid.vehicle.contact import Grip, Pair, grip, loads, tracks_at
from sysid.vehicle.floor import Floor
from sysid.vehicle.kinematics import Geometry, Real, body_velocity
from sysid.vehicle.tracked import TrackedVehicle

HALVINGS = 50
"""Halvings of an interval of slips or of speeds: what is left is below rounding."""

MOST_SLIP = 20.0
"""Slip at which a track that is dragged has all the thrust there is: a soil's K is far shorter."""


def slip_ratio(theoretical: Real, actual: Real) -> Real:
    """i = (v − v′)/v of one track (thesis 2.24): 0 rolls, 1 spins, below 0 is dragged.

    Args:
        theoretical: v = rω, not 0 [m/s].
        actual: v′ over the ground [m/s].
    """
    return (theoretical - actual) / theoretical


def slipping_velocity(
    omega: Pair, slips: Pair, geometry: Geometry, side_slip: Real = 0.0, xp: Any = None
) -> tuple[Real, Real, Real]:
    """V_x, V_y [m/s] and ψ̇ [rad/s] of tracks that slip (thesis 2.26).

    V_x = (r/2)(ω_L(1 − i_L) + ω_R(1 − i_R)),  V_y = V_x tan α
    ψ̇ = (r/B)(ω_R(1 − i_R) − ω_L(1 − i_L))

    Args:
        omega: sprocket speeds, left and right [rad/s].
        slips: i_L, i_R [1].
        side_slip: α, 0 at low speed [rad].
        xp: array namespace; needed where α is not 0.
    """
    forward, yaw_rate = body_velocity(
        omega[0] * (1.0 - slips[0]), omega[1] * (1.0 - slips[1]), geometry
    )
    return forward, 0.0 if xp is None else forward * xp.tan(side_slip), yaw_rate


def turning_share(omega: Pair, xp: Any) -> Real:
    """|ω_R − ω_L|/(|ω_L| + |ω_R|): 0 straight ahead, 1 on the spot and about one track."""
    left, right = omega
    return xp.abs(right - left) / xp.maximum(xp.abs(right) + xp.abs(left), 1e-6)


def balanced_velocity(
    omega: Pair, pose: tuple[Real, Real, Real], car: TrackedVehicle, floor: Floor, xp: Any
) -> tuple[Real, Real]:
    """Forward speed [m/s] and yaw rate [rad/s] at which the forces on the vehicle balance.

    Without inertia and at low speed the instantaneous centre lies abreast of the middle
    (x_ICR = 0). Each track then needs the thrust T_i = ±R_i ∓ M_r/B, M_r = Σ μl_i W_i L/4, which
    its law of shear yields at one slip. Where that would turn the vehicle against its tracks, or
    is more than the ground bears, lateral friction holds it straight, at the speed at which both
    thrusts together make up for rolling resistance.

    Args:
        omega: sprocket speeds, left and right [rad/s].
        pose: X, Y [m] and ψ [rad]: which soil is under which track.
        floor: soils; its slope is not looked at.
    """
    x, y, psi = pose
    gravity = floor.gravity(xp)[2]
    load = loads(car, gravity, 0.0, xp)
    places = tracks_at(x, y, (xp.cos(psi), xp.sin(psi)), car)

    def under(side: int, slip: Real) -> Grip:
        return grip(floor, places[side], load[side], slip, car, xp)

    r = car.geometry.r
    rolls = r * omega[0], r * omega[1]
    known = under(0, MOST_SLIP), under(1, MOST_SLIP)
    moment = 0.25 * car.contact_length * (known[0].lateral + known[1].lateral)
    sense = xp.sign(rolls[1] - rolls[0])
    over, bears = [], sense != 0.0
    for side, push in ((0, -1.0), (1, 1.0)):
        ahead = xp.sign(rolls[side])
        needed = ahead * known[side].rolling + push * sense * moment / car.geometry.B
        slip = _slip_for(xp.abs(needed), side, under, xp)
        bears = bears & (xp.abs(needed) < known[side].thrust)
        over.append(rolls[side] * (1.0 - xp.sign(needed) * ahead * slip))
    turns = bears & (sense * (over[1] - over[0]) > 0.0)
    straight = _straight(rolls, (known[0].rolling + known[1].rolling), under, xp)
    left, right = (xp.where(turns, v, straight) for v in over)
    return body_velocity(left / r, right / r, car.geometry)


def _slip_for(thrust: Real, side: int, under: Any, xp: Any) -> Real:
    """The smallest slip at which a track has this thrust."""
    nothing = 0.0 * thrust
    ends = nothing, nothing + MOST_SLIP
    return bisected(xp, HALVINGS, ends, lambda slip: under(side, slip).thrust >= thrust)


def _straight(rolls: Pair, rolling: Real, under: Any, xp: Any) -> Real:
    """Speed at which a vehicle that does not turn keeps going [m/s]."""

    def thrust(side: int, speed: Real) -> Real:
        apart = rolls[side] - speed
        slip = xp.minimum(xp.abs(apart) / (xp.abs(rolls[side]) + 1e-9), MOST_SLIP)
        return xp.sign(apart) * under(side, slip).thrust

    def slower(speed: Real) -> Real:
        return xp.logical_not(thrust(0, speed) + thrust(1, speed) > rolling * xp.sign(speed))

    # a track that rolls forward is not slower than 0, and not faster than the faster one
    low = xp.minimum(xp.minimum(rolls[0], rolls[1]), 0.0)
    high = xp.maximum(xp.maximum(rolls[0], rolls[1]), 0.0)
    stands = (rolls[0] == 0.0) & (rolls[1] == 0.0)
    return xp.where(stands, 0.0, bisected(xp, HALVINGS, (low, high), slower))
