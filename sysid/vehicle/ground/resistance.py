"""Resistances of the ground: rolling, lateral friction and the moment against turning.

A turning vehicle slides sideways one way ahead of its instantaneous centre of rotation and the
other way behind it. ``icr`` is x_ICR, how far that centre lies ahead of the centre of mass [m]; the
weight is that on both tracks together.
"""

from typing import Any

import numpy as np

from sysid.vehicle.kinematics import Real
from sysid.vehicle.pressure import Pressure, axes_of, integrate
from sysid.vehicle.soil import Soil


def rolling_resistance(soil: Soil, load: Real, speed: Real, xp: Any = np) -> Real:
    """R = sign(v) W μr [N], to be subtracted from the thrust (thesis 2.34, W = mg/2 a track).

    Args:
        load: W, normal load on the track [N].
        speed: v of the track over the ground [m/s]; nothing resists at standstill.
    """
    return xp.sign(speed) * load * soil.rolling


def lateral_force(
    soil: Soil, weight: Real, icr: Real, yaw_rate: Real, length: Real, xp: Any = np
) -> Real:
    """Lateral force of the ground under uniform pressure [N], to the left positive (thesis 2.35).

    F_y = sign(ψ̇) 4 μl (mg/2L) x_ICR, which is −sign(V_y) 4 μl (mg/2L)|x_ICR| as V_y = −ψ̇ x_ICR;
    beyond the ends of the tracks everything slides one way and F_y stays μl mg.

    Args:
        weight: mg on both tracks [N].
        icr: x_ICR [m].
        yaw_rate: ψ̇ [rad/s]; only its sign matters.
        length: L [m].
    """
    half = 0.5 * length
    inside = xp.clip(icr, -half, half)
    return xp.sign(yaw_rate) * 2.0 * soil.lateral * weight / length * inside


def turning_moment(
    soil: Soil, weight: Real, icr: Real, yaw_rate: Real, length: Real, xp: Any = np
) -> Real:
    """Moment against turning under uniform pressure [N m], to be subtracted (thesis 2.36).

    M_r = sign(ψ̇) 2 μl (mg/2L)(L²/4 − x_ICR²), in the middle Wong's μl W L/4. (Printed: twice that,
    with a sign that its own use turns into a moment that helps.) Arguments as of
    :func:`lateral_force`.
    """
    half = 0.5 * length
    inside = xp.clip(icr, -half, half)
    return xp.sign(yaw_rate) * soil.lateral * weight / length * (half**2 - inside**2)


def lateral_reaction(
    soil: Soil,
    weight: Real,
    icr: Real,
    yaw_rate: Real,
    length: Real,
    pressure: Pressure,
    xp: Any = np,
) -> tuple[Real, Real]:
    """Lateral force and moment against turning under any pressure, by integration.

    F_y = −sign(ψ̇) μl ∫ q sign(s − x_ICR) ds,  M_r = sign(ψ̇) μl ∫ q s sign(s − x_ICR) ds

    q is the load per metre, s the place ahead of the centre of mass, which stands over the centre
    of the pressure.

    Args:
        soil, weight, icr, yaw_rate, length: as of :func:`lateral_force`.
        pressure: how the load is spread along each track.

    Returns:
        F_y [N], left positive, and M_r [N m], to be subtracted.
    """
    turn_at = 0.5 * length - pressure.centre - icr  # from the front of the track
    axes = axes_of(weight, icr, length, pressure.centre, soil.lateral)

    def line_load(x: Real) -> tuple[Real, Real]:
        load = pressure.at(x, weight, length, 1.0, xp)
        return load, load * (0.5 * length - pressure.centre - x)

    ahead, behind = [], []
    for low, high in pressure.smooth_parts(length, xp):
        middle = xp.clip(turn_at, low, high)
        ahead.append((low, middle))
        behind.append((middle, high))
    before, after = (integrate(line_load, parts, axes, xp) for parts in (ahead, behind))
    force, moment = before[0] - after[0], before[1] - after[1]
    way = xp.sign(yaw_rate) * soil.lateral
    return -way * force, way * moment


_NIKITIN = (0.925, 0.15)
"""Numbers of the empirical formula of tank practice (Nikitin): 1 where a track stands still."""


def lateral_at_radius(lateral: Real, radius: Real, track_distance: Real, xp: Any = np) -> Real:
    """Coefficient of turning resistance against the radius of the turn, μ_max/(0.925 + 0.15 R/B).

    The tighter the turn, the larger; μ_max from R = B/2 on, where one track stands, inwards.

    Args:
        lateral: μ_max [1].
        radius: R of the path of the vehicle's middle [m]; its sign does not matter.
        track_distance: B [m].

    Returns:
        μ [1].

    Source: the empirical formula of Nikitin, used for tanks; compare Steeds (1950) and Kar (1987),
    where the coefficient follows from slip, as :mod:`sysid.vehicle.ground.skid_steer` has it.
    """
    a, b = _NIKITIN
    return lateral / xp.maximum(a + b * xp.abs(radius) / track_distance, 1.0)


def sinkage(soil: Soil, pressure: Real, width: Real, xp: Any = np) -> Real:
    """Depth to which a pressure presses the ground: p = (k_c/b + k_φ) zⁿ, solved for z [m].

    Args:
        soil: ground; 0 where its k_phi is infinite.
        pressure: p [Pa].
        width: b, the smaller side of the contact area [m].

    Returns:
        z [m].

    Source: Bekker (1956); Wong, Theory of Ground Vehicles, section 2.4.
    """
    return (pressure / (soil.k_c / width + soil.k_phi)) ** (1.0 / soil.n)


def compaction_resistance(
    soil: Soil,
    load: Real,
    length: Real,
    width: Real,
    pressure: Pressure | None = None,
    xp: Any = np,
) -> Real:
    """Resistance of a track that presses its rut into the ground [N].

    R_c = b ∫₀ᶻ p dz = b (k_c/b + k_φ) z^(n+1)/(n + 1) = b p z/(n + 1): the work for a metre of rut,
    as deep as the largest pressure under the track presses it; what rises again behind a road
    wheel is not given back.

    Args:
        load: W, normal load on the track [N].
        length, width: L and b [m].
        pressure: how the load is spread; uniform where none is given.

    Source: Wong, Theory of Ground Vehicles, section 2.5.
    """
    peak = (pressure or Pressure()).peak(load, length, width, xp)
    depth = sinkage(soil, peak, xp.minimum(width, length), xp)
    return width * peak * depth / (soil.n + 1.0)
