"""Thrust of a track from the shear of the ground under it."""

from typing import Any

import numpy as np

from sysid.vehicle.kinematics import Real
from sysid.vehicle.pressure import Distribution, Pressure
from sysid.vehicle.quadrature import axes_of, integrate
from sysid.vehicle.shear import largest_stress, mean_share, mobilised_share
from sysid.vehicle.soil import NUMBERS, Soil

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

    Raises:
        ModelError: the load cannot be spread like this on this length.
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
