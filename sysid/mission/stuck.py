"""Why a mission went nowhere: what the last seconds of its log say, with what to change."""

import math
from collections.abc import Mapping

import numpy as np

from sysid.data.record import Array
from sysid.mission.result import STUCK_PROGRESS, STUCK_TIME
from sysid.mission.spec import Mission, Obstacle

STILL = 0.05
"""A robot that turns by less than this [rad] while it gets nowhere stands still."""

NEAR = 5.0
"""A robot that came within so many tolerances of the goal was there and drove past it: farther away
its course, not the end of the way, is the trouble."""


def why_stuck(mission: Mission, log: Mapping[str, Array]) -> str:
    """One sentence: standing still, past the goal, held by an obstacle, or driving in circles.

    Args:
        mission: what was to be done.
        log: columns of a mission log that ended as stuck.
    """
    t, x, y = log["t"], log["x"], log["y"]
    to_go = np.hypot(x - mission.goal[0], y - mission.goal[1])
    last = t >= t[-1] - STUCK_TIME
    way = float(np.sum(np.hypot(np.diff(x[last]), np.diff(y[last]))))
    turned = float(np.ptp(np.unwrap(log["psi"][last])))
    closest = int(np.argmin(to_go))
    said = f"The robot came less than {STUCK_PROGRESS} m closer in {STUCK_TIME:g} s"
    held = _holding(mission, float(x[-1]), float(y[-1]))
    if to_go[closest] < min(to_go[-1] - STUCK_PROGRESS, NEAR * mission.tolerance):
        return (
            f"{said}: it came within {to_go[closest]:.2g} m of the goal at t = {t[closest]:.4g} s "
            f"and drove past it; raise tolerance (now {mission.tolerance:g} m) or lower v_max."
        )
    if held is not None:
        return (
            f"{said}: the obstacle at ({held.x:g}, {held.y:g}) pushes as hard as the goal pulls, a "
            "local minimum of the field; move the goal or lower eta."
        )
    if way < STUCK_PROGRESS and turned < STILL:
        largest = max(float(np.max(np.abs(log[n][last]))) for n in ("pwm_l", "pwm_r"))
        return (
            f"{said}: it stands still {to_go[-1]:.2g} m from the goal at commands up to "
            f"{largest:.4g} µs, which the plant does not answer; raise kp_speed or kp_yaw, or "
            "export a plant that moves at such commands."
        )
    return (
        f"{said} while it drove {way:.2g} m, at least {to_go[closest]:.2g} m from the goal: its "
        "course does not lead there; lower v_max or raise kp_yaw."
    )


def _holding(mission: Mission, x: float, y: float) -> Obstacle | None:
    """The nearest obstacle that repels at a place."""
    reach = mission.guidance.rho0
    near = [
        (math.hypot(o.x - x, o.y - y), k)
        for k, o in enumerate(mission.obstacles)
        if math.hypot(o.x - x, o.y - y) <= reach
    ]
    return mission.obstacles[min(near)[1]] if near and mission.guidance.eta > 0 else None
