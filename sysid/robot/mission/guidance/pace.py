"""Speed along a known path."""

import math
from typing import Any

from sysid.vehicle.kinematics import Real, wrap_angle

LEAST = 0.25
"""Share of its speed that a robot keeps up to its goal: at less it would hardly get there."""


def paced(v_max: float, slow_within: float, psi: Real, psi_ref: Real, to_go: Real, xp: Any) -> Real:
    """V_ref = V_max · max(0, cos(ψ_ref − ψ)) · clip(way to go/slow_within, ¼, 1) [m/s].

    A robot that looks the other way turns on the spot.

    Args:
        v_max: largest speed [m/s].
        slow_within: distance before the goal within which it slows down [m].
        psi, psi_ref: heading and the one wanted [rad].
        to_go: way still to go [m].
    """
    ahead = xp.maximum(0.0, xp.sin(wrap_angle(psi_ref - psi) + 0.5 * math.pi))
    return v_max * ahead * xp.clip(to_go / slow_within, LEAST, 1.0)
