"""Thrust of a track from the shear of the ground under it."""

from typing import Any

import numpy as np

from sysid.vehicle.kinematics import Real
from sysid.vehicle.soil import Soil


def uniform_thrust(
    soil: Soil, load: Real, slip: Real, length: Real, width: Real, xp: Any = np
) -> Real:
    """Thrust of a rigid footprint under uniform pressure on a soil of (2.28), in closed form.

    F = (A c + W tan φ)(1 − K/(iL) (1 − e^(−iL/K))),  A = bL     (thesis 2.33)

    An odd function of the slip: a track that is dragged brakes as much as it would drive.

    Args:
        soil: ground.
        load: W, normal load on the track [N].
        slip: i [1].
        length, width: L and b of the contact area [m].
        xp: array namespace.

    Returns:
        F [N].
    """
    most = length * width * soil.cohesion + load * soil.friction
    reach = abs(slip) * length / soil.shear_modulus
    small = reach < 1e-6
    safe = xp.where(small, 1.0, reach)
    share = xp.where(small, 0.5 * reach, 1.0 - (1.0 - xp.exp(-safe)) / safe)
    return xp.sign(slip) * most * share
