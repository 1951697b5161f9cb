"""Shear stress of the ground against normal pressure and shear displacement: (2.27)–(2.30)."""

import math
from typing import Any

import numpy as np

from sysid.vehicle.kinematics import Real
from sysid.vehicle.soil import Shear, Soil

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
