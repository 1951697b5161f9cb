"""Skid steering in general: thrust and lateral friction share the shear strength under the tracks.

Every place of a track is dragged over the ground, forwards by slip and sideways by turning. Its
shear displacement grows from where it touched down, its stress follows one of the laws (2.28–2.30)
and points against its sliding velocity, so that what turning takes is missing for driving. No
coefficient of lateral friction is needed, and turning resistance falls with the radius by itself.

Source: Wong and Chiang, A general theory for skid steering of tracked vehicles on firm ground,
Proc. IMechE D 215 (2001); there for (2.28) without cohesion.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from sysid.errors import ModelError
from sysid.vehicle.ground.drawbar import Traction
from sysid.vehicle.kinematics import Real
from sysid.vehicle.pressure import axes_of, integrate
from sysid.vehicle.shear import largest_stress, mobilised_share

_STANDING = 1e-9
"""Track speed below which a track counts as standing [m/s]: what is on it has slid for ever."""
_QUARTER = 0.5 * math.pi
"""Largest angle turned during contact that is reckoned [rad]: a track that stands slides on until
its shear has long settled, and going round would bring a place back to where it began."""
_NO_SLIDING = 1e-300
"""Keeps a direction defined where nothing slides [m²/s²]."""
_FIRST_SLIPS = (0.3, 1.0, 0.1, 3.0)
"""Slip that a search for a steady turn begins with, in lengths of the track a radian turned."""
_MOST_TRIED = 60
"""Motions that a search tries from one beginning: those that end well need some 30."""
_BALANCED = 1e-6
"""Imbalance over weight that counts as none: far below what is known of any soil."""
_GRADES = (1.0 / 8.0, 1.0 / 64.0)
"""Where the contact is cut on both sides of the place that does not slide sideways, in lengths of
the track: the direction of sliding turns round there, at once where the track does not slip."""


class GroundForces(NamedTuple):
    """Forces of the ground on both tracks.

    Attributes:
        left, right: forward forces [N].
        lateral: force to the left [N].
        moment: of the lateral forces about the centre of mass, against clockwise positive [N m].
    """

    left: Real
    right: Real
    lateral: Real
    moment: Real


def ground_forces(
    traction: Traction,
    velocity: tuple[Real, Real, Real],
    tracks: tuple[Real, Real],
    xp: Any = np,
) -> GroundForces:
    """Forces of the ground on tracks that slip and are dragged sideways at once.

    A place s ahead of the centre of mass slides with u = (Vx ∓ ψ̇B/2 − v, Vy + ψ̇ s); it touched
    down d behind the leading end ago, t = d/|v|, and its displacement j is from that spot of the
    ground, the body's motion taken as constant. τ = τ_max(σ) share(|j|) against u.

    Args:
        traction: vehicle, soil and pressure; of a track that runs backwards the rear end leads.
        velocity: Vx, Vy [m/s], ψ̇ [rad/s] of the body at its centre of mass.
        tracks: speeds v = r ω of the left and right track [m/s].
    """
    vx, vy, yaw_rate = velocity
    half_gauge = 0.5 * traction.vehicle.geometry.B
    left = _track(traction, (vx - yaw_rate * half_gauge, vy, yaw_rate), tracks[0], xp)
    right = _track(traction, (vx + yaw_rate * half_gauge, vy, yaw_rate), tracks[1], xp)
    return GroundForces(left[0], right[0], left[1] + right[1], left[2] + right[2])


def _track(
    traction: Traction, velocity: tuple[Real, Real, Real], speed: Real, xp: Any
) -> tuple[Real, Real, Real]:
    """Forward force, lateral force [N] and moment about the centre of mass [N m] of one track.

    Args:
        velocity: of the body where the track's line passes the centre of mass.
        speed: of the track [m/s].
    """
    vehicle, soil, pressure = traction.vehicle, traction.soil, traction.spread(xp)
    vx, vy, yaw_rate = velocity
    length, width, load = vehicle.contact_length, vehicle.track_width, traction.load(xp)
    begin, end = pressure.contact(length, xp)
    axes = axes_of(vx, vy, yaw_rate, speed, load, pressure.centre)

    def stress(x: Real) -> tuple[Real, Real, Real]:
        ahead = 0.5 * length - pressure.centre - x
        slide_x, slide_y = vx - speed, vy + yaw_rate * ahead
        behind = xp.where(speed < 0.0, end - x, x - begin)
        t = behind / xp.maximum(xp.abs(speed), _STANDING)
        t = xp.minimum(t, _QUARTER / xp.maximum(xp.abs(yaw_rate), _STANDING))
        angle = yaw_rate * t
        # where it touched down, in the body's frame of now: R(−θ) (start − t sinc(θ/2) R(θ/2) V)
        chord = t * xp.sinc(angle / (2.0 * math.pi))
        c, s = xp.cos(0.5 * angle), xp.sin(0.5 * angle)
        start = ahead + speed * t
        j = xp.hypot(
            ahead - start * (c * c - s * s) + chord * (c * vx + s * vy),
            2.0 * start * s * c + chord * (c * vy - s * vx),
        )
        tau = largest_stress(soil, pressure.at(x, load, length, width, xp), xp)
        tau = -tau * mobilised_share(soil, j, xp)
        tau = tau / xp.sqrt(slide_x**2 + slide_y**2 + _NO_SLIDING)
        return tau * slide_x, tau * slide_y, tau * slide_y * ahead

    turning = xp.where(yaw_rate == 0.0, 1.0, yaw_rate)
    still = 0.5 * length - pressure.centre + vy / turning
    cuts = [still + length * g for g in (*(-g for g in _GRADES), 0.0, *reversed(_GRADES))]
    parts: list[tuple[Real, Real]] = []
    for low, high in pressure.smooth_parts(length, xp):
        parts += pairwise([low, *(xp.clip(c, low, high) for c in cuts), high])
    forward, sideways, moment = integrate(stress, parts, axes, xp)
    return width * forward, width * sideways, width * moment


@dataclass(frozen=True)
class SteadyTurn:
    """A turn that goes on as it is.

    Attributes:
        radius: of the path of the centre of mass [m]; 0 on the spot.
        yaw_rate: ψ̇ [rad/s].
        tracks: speeds v = r ω of the left and right track [m/s].
        forces: forward forces of the ground on the left and right track [N].
        icr: x_ICR, how far the instantaneous centre lies ahead of the centre of mass [m].
        moment: against turning, of the lateral forces [N m].
        coefficient: what μl would be in μl W L/4 for that moment [1].
        power: of both sprockets [W].
    """

    radius: float
    yaw_rate: float
    tracks: tuple[float, float]
    forces: tuple[float, float]
    icr: float
    moment: float
    coefficient: float
    power: float


def steady_turn(traction: Traction, radius: float, speed: float = 0.1) -> SteadyTurn:
    """The turn in which thrust, lateral forces and moments of the ground are in balance.

    F_L + F_R = R + R_c,  F_y = m Vx ψ̇,  M + ((F_R − R_R) − (F_L − R_L)) B/2 = 0, solved for the
    speeds of the tracks and V_y. Without the centripetal force the forces do not depend on how fast
    it turns, but on the radius alone; power goes with the speed.

    Args:
        radius: R of the path of the centre of mass [m], at least 0; to the left.
        speed: of the body over its outer track, ψ̇ (R + B/2) [m/s], above 0; slow by default.
    """
    if not (math.isfinite(radius) and radius >= 0.0):
        raise ModelError(f"the radius of a turn is {radius}: give metres, at least 0")
    if not (math.isfinite(speed) and speed > 0.0):
        raise ModelError(f"the speed of a turn is {speed}: give m/s above 0")
    yaw_rate = speed / (radius + 0.5 * traction.vehicle.geometry.B)
    balance = _balance(traction, radius, yaw_rate)
    if balance is None:
        raise ModelError(
            f"no steady turn on a radius of {radius:.3g} m was found: turning and driving take "
            "more than the shear strength under the tracks, or nearly; try a larger radius, or a "
            "shorter or wider vehicle"
        )
    speeds, vy, ground = balance
    forces = (float(ground.left), float(ground.right))
    moment = -float(ground.moment)
    level = float(0.25 * traction.vehicle.weight * traction.vehicle.contact_length)
    power = forces[0] * speeds[0] + forces[1] * speeds[1]
    return SteadyTurn(
        radius, yaw_rate, speeds, forces, -vy / yaw_rate, moment, moment / level, power
    )


def _balance(
    traction: Traction, radius: float, yaw_rate: float
) -> tuple[tuple[float, float], float, GroundForces] | None:
    """Track speeds [m/s], V_y [m/s] and forces in balance; None where there is no balance."""
    from scipy.optimize import root

    if float(traction.largest_pull()[0]) < 0.0:
        return None  # it does not drive straight on either

    vehicle, vx = traction.vehicle, radius * yaw_rate
    half = 0.5 * vehicle.geometry.B
    resistance = 0.5 * float(traction.rolling() + traction.compaction())
    weight, arm = vehicle.weight, 0.25 * vehicle.contact_length
    scale = yaw_rate * vehicle.contact_length

    def forces(unknown: Any) -> tuple[tuple[float, float], float, GroundForces]:
        left, right, vy = (float(u) * scale for u in unknown)
        return (left, right), vy, ground_forces(traction, (vx, vy, yaw_rate), (left, right))

    def imbalance(unknown: Any) -> list[float]:
        (left, right), _, ground = forces(unknown)
        slow = 1e-3 * scale  # resistance turns round where a track stands, within this
        drag = [resistance * math.tanh(v / slow) for v in (left, right)]
        return [
            (ground.left + ground.right - sum(drag)) / weight,
            (ground.lateral - vehicle.mass * vx * yaw_rate) / weight,
            (ground.moment + (ground.right - drag[1] - ground.left + drag[0]) * half)
            / (weight * arm),
        ]

    options: Any = {"maxfev": _MOST_TRIED}
    for extra in _FIRST_SLIPS:
        apart = extra + half / vehicle.contact_length
        first = [vx / scale - apart, vx / scale + apart, 0.0]
        solution = root(imbalance, first, method="hybr", options=options)
        if max(map(abs, imbalance(solution.x))) < _BALANCED:
            return forces(solution.x)
    return None
