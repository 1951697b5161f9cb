"""Sinkage of a track and its compaction resistance (Bekker)."""

from typing import Any

import numpy as np

from sysid.vehicle.kinematics import Real
from sysid.vehicle.pressure import Pressure
from sysid.vehicle.soil import Soil


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
