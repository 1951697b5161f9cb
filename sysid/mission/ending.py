"""How a mission ended, in words: what happened, why, and what to change."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.mission.loop import STUCK
from sysid.mission.result import Outcome
from sysid.mission.spec import Mission, Obstacle


@dataclass(frozen=True)
class StuckReading:
    """How the log of a robot that got nowhere is read.

    Attributes:
        still: a robot that turns by less than this [rad] while it gets nowhere stands still:
            below it is the ripple of a heading that is held.
        near: a robot that came within so many tolerances of the goal was there and drove past it:
            farther away its course, not the end of the way, is the trouble.
    """

    still: float = 0.05
    near: float = 5.0


_READING = StuckReading()


def sentence(outcome: Outcome, mission: Mission, log: Mapping[str, Array]) -> str:
    """One sentence on the end of a mission, with the next step.

    Args:
        outcome: how it ended.
        mission: what was to be done, by which laws.
        log: columns of its log.
    """
    guidance = mission.guidance.advice
    if outcome is Outcome.ARRIVED:
        return "The robot reached the goal within the tolerance."
    if outcome is Outcome.TIMEOUT:
        faster = _either("raise timeout", guidance.faster)
        return f"Time ran out before the goal was reached: {faster}."
    if outcome is Outcome.COLLISION:
        advice = _either(guidance.wider, guidance.slower) or "lead it farther away from obstacles"
        return f"The robot touched an obstacle: {advice}."
    return _why_stuck(mission, log)


def _either(*advice: str) -> str:
    """What there is of the advice, joined by "or", behind a comma where one has an "or" itself."""
    given = [a for a in advice if a]
    return (", or " if any(" or " in a for a in given) else " or ").join(given)


def _why_stuck(mission: Mission, log: Mapping[str, Array]) -> str:
    """Standing still, past the goal, held by an obstacle, or driving in circles."""
    t, x, y = log["t"], log["x"], log["y"]
    guidance, control = mission.guidance.advice, mission.control.advice
    to_go = np.hypot(x - mission.goal[0], y - mission.goal[1])
    last = t >= t[-1] - STUCK.time
    way = float(np.sum(np.hypot(np.diff(x[last]), np.diff(y[last]))))
    turned = float(np.ptp(np.unwrap(log["psi"][last])))
    closest = int(np.argmin(to_go))
    said = f"The robot came less than {STUCK.progress} m closer in {STUCK.time:g} s"
    held = _holding(mission, float(x[-1]), float(y[-1]))
    if to_go[closest] < min(to_go[-1] - STUCK.progress, _READING.near * mission.tolerance):
        wider = _either(f"raise tolerance (now {mission.tolerance:g} m)", guidance.slower)
        return (
            f"{said}: it came within {to_go[closest]:.2g} m of the goal at t = {t[closest]:.4g} s "
            f"and drove past it; {wider}."
        )
    if held is not None:
        return (
            f"{said}: the obstacle at ({held.x:g}, {held.y:g}) pushes as hard as the goal pulls, a "
            f"local minimum of the field; {_either('move the goal', guidance.closer)}."
        )
    if way < STUCK.progress and turned < _READING.still:
        largest = max(float(np.max(np.abs(log[n][last]))) for n in ("pwm_l", "pwm_r"))
        stronger = _either(control.stronger, "export a plant that moves at such commands")
        return (
            f"{said}: it stands still {to_go[-1]:.2g} m from the goal at commands up to "
            f"{largest:.4g} µs, which the plant does not answer; {stronger}."
        )
    course = _either(guidance.slower, control.steer) or "choose another law of guidance"
    return (
        f"{said} while it drove {way:.2g} m, at least {to_go[closest]:.2g} m from the goal: its "
        f"course does not lead there; {course}."
    )


def _holding(mission: Mission, x: float, y: float) -> Obstacle | None:
    """The nearest obstacle that pushes at a place."""
    near = [
        (math.hypot(o.x - x, o.y - y), k)
        for k, o in enumerate(mission.obstacles)
        if math.hypot(o.x - x, o.y - y) <= mission.guidance.reach
    ]
    pushes = near and mission.guidance.advice.closer
    return mission.obstacles[min(near)[1]] if pushes else None
