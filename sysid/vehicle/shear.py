"""Shear stress of the ground, (2.27)–(2.30), and the thrust of a track from it, (2.31)–(2.33)."""

import math
from typing import Any

import numpy as np

from sysid.vehicle.kinematics import Real
from sysid.vehicle.pressure import Distribution, Pressure, axes_of, integrate
from sysid.vehicle.soil import NUMBERS, Shear, Soil

_SERIES_BELOW = 1e-2
"""Reach below which 1 − (1 − e^(−u))/u is summed as a series: cancellation would cost digits."""


def largest_stress(soil: Soil, pressure: Real, xp: Any = np) -> Real:
    """Largest shear stress the ground bears: τ_max = c + σ tan φ (thesis 2.27, Mohr–Coulomb).

    Args:
        pressure: σ, normal pressure [Pa].

    Returns:
        τ_max [Pa].
    """
    return soil.cohesion + pressure * xp.tan(soil.friction_angle)


def mobilised_share(soil: Soil, displacement: Real, xp: Any = np) -> Real:
    """Share τ/τ_max of the shear strength that a shear displacement calls up.

    1 − e^(−t)                                                   (2.28), t = |j|/K
    t e^(1−t)                                                    (2.29)
    K_r (1 + [1/(K_r (1 − 1/e)) − 1] e^(1−t)) (1 − e^(−t))       (2.30), brackets completed

    (2.30) is 1 at t = 1 by construction, but its peak lies elsewhere for most K_r and exceeds 1 by
    up to 7.5 % (K_r → 0): that is how the law is published.

    Args:
        displacement: j [m]; its sign does not matter.

    Returns:
        The share [1], from 0.
    """
    t = xp.abs(displacement) / soil.shear_modulus
    if soil.shear == Shear.HUMP:
        return t * xp.exp(1.0 - t)
    if soil.shear == Shear.RESIDUAL:
        return soil.residual * (1.0 + _excess(soil) * xp.exp(-t)) * -xp.expm1(-t)
    return -xp.expm1(-t)


def shear_stress(soil: Soil, pressure: Real, displacement: Real, xp: Any = np) -> Real:
    """Shear stress under a pressure, odd in the displacement [Pa] (thesis 2.28–2.30).

    Args:
        pressure: σ [Pa].
        displacement: j [m].
    """
    share = mobilised_share(soil, displacement, xp)
    return xp.sign(displacement) * largest_stress(soil, pressure, xp) * share


def mean_share(soil: Soil, reach: Real, xp: Any = np) -> Real:
    """Mean of the share over a contact along which displacement grows linearly from nothing.

    With ψ(u) = 1 − (1 − e^(−u))/u, u the displacement at the end over K:

    ψ(u)                                             (2.28), the bracket of (2.33)
    e (1 − e^(−u) − ψ(u))                            (2.29)
    K_r (a e ψ(2u) − (a e − 1) ψ(u))                 (2.30), a = 1/(K_r (1 − 1/e)) − 1

    Args:
        reach: u = |i| L / K [1], at least 0.

    Returns:
        The mean share [1].
    """
    if soil.shear == Shear.HUMP:
        return math.e * (-xp.expm1(-reach) - _saturation(reach, xp))
    if soil.shear == Shear.RESIDUAL:
        ae = _excess(soil)
        twice = _saturation(2.0 * reach, xp)
        return soil.residual * (ae * twice - (ae - 1.0) * _saturation(reach, xp))
    return _saturation(reach, xp)


def _excess(soil: Soil) -> Real:
    """Factor of e^(−t) in the first bracket of (2.30)."""
    return math.e * (1.0 / (soil.residual * (1.0 - 1.0 / math.e)) - 1.0)


def _saturation(u: Real, xp: Any) -> Real:
    """1 − (1 − e^(−u))/u, from 0 (its slope there is 1/2) towards 1."""
    small = u < _SERIES_BELOW
    # the term left out is u⁷/40320: below 3e-17 of the first at the switch
    series = u / 2.0 * (1.0 - u / 3.0 * (1.0 - u / 4.0 * (1.0 - u / 5.0 * (1.0 - u / 6.0))))
    safe = xp.where(small, 1.0, u)
    return xp.where(small, series, 1.0 + xp.expm1(-safe) / safe)


_LAYER = 36.0
"""Shear displacement over K within which every law has settled, to e⁻³⁶: it is integrated apart
from the rest of the contact, so that a stiff soil loses no digits."""
_NO_SLIP = 1e-200
"""Slip that stands for none where a length is divided by it."""


def uniform_thrust(
    soil: Soil, load: Real, slip: Real, length: Real, width: Real, xp: Any = np
) -> Real:
    """Thrust of a rigid footprint under uniform pressure, in closed form for each law of shear.

    F = (A c + W tan φ) m(|i|L/K) sign(i),  A = bL;  m is the mean share of
    :func:`sysid.vehicle.shear.mean_share`, for (2.28) 1 − K/(iL) (1 − e^(−iL/K)) (2.33).

    An odd function of the slip: a track that is dragged brakes as much as it would drive.

    Args:
        load: W, normal load on the track [N].
        slip: i [1].
        length, width: L and b of the contact area [m].

    Returns:
        F [N].
    """
    most = length * width * soil.cohesion + load * xp.tan(soil.friction_angle)
    reach = xp.abs(slip) * length / soil.shear_modulus
    return xp.sign(slip) * most * mean_share(soil, reach, xp)


def thrust(
    soil: Soil,
    load: Real,
    slip: Real,
    length: Real,
    width: Real,
    pressure: Pressure | None = None,
    xp: Any = np,
) -> Real:
    """Thrust of a track under any normal pressure, F = b ∫ τ(σ(x), i x) dx (thesis 2.31).

    Displacement begins where contact does. Gauss–Legendre quadrature, for every law, pressure and
    slip within 1e-10 of the exact integral, of which :func:`uniform_thrust` is one; arguments that
    are arrays broadcast, numbers of the soil included.

    Args:
        load: W, normal load on the track [N].
        slip: i [1].
        length, width: L and b [m].
        pressure: how the load is spread; uniform where none is given.

    Returns:
        F [N].
    """
    if pressure is None or pressure.distribution == Distribution.UNIFORM:
        return uniform_thrust(soil, load, slip, length, width, xp)
    if axes_of(length, pressure.centre) == 0:
        pressure.check(length)
    axes = axes_of(
        load, slip, length, width, pressure.centre, *(getattr(soil, name) for name in NUMBERS)
    )
    rate = xp.abs(slip)
    begin, _ = pressure.contact(length, xp)
    settled = begin + _LAYER * soil.shear_modulus / xp.maximum(rate, _NO_SLIP)

    def stress(x: Real) -> tuple[Real]:
        most = largest_stress(soil, pressure.at(x, load, length, width, xp), xp)
        return (most * mobilised_share(soil, rate * (x - begin), xp),)

    parts: list[tuple[Real, Real]] = []
    for low, high in pressure.smooth_parts(length, xp):
        middle = xp.clip(settled, low, high)
        parts += [(low, middle), (middle, high)]
    (force,) = integrate(stress, parts, axes, xp)
    return xp.sign(slip) * width * force
