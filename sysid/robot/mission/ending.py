"""The ending of a mission in words: what happened, why, and what to change."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.robot.mission.clearance import nearest_point
from sysid.robot.mission.contracts import Holding, References
from sysid.robot.mission.loop import STUCK
from sysid.robot.mission.result import Outcome, Stuck, StuckReason
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.traits import Hold


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

STANDING = References(0.0, 0.0, False)
"""What guidance asks of a robot while nothing is to be said of it."""


def ending(
    outcome: Outcome, mission: Mission, log: Mapping[str, Array], last: References = STANDING
) -> tuple[str, Stuck | None]:
    """One sentence on the end of a mission, with the next step; why and where it is stuck."""
    guidance = mission.guidance.advice
    if outcome in (Outcome.ARRIVED, Outcome.MISSED):
        return _arrived(outcome, mission, float(_to_goal(mission, log)[-1])), None
    if outcome is Outcome.TIMEOUT:
        faster = _either("raise timeout", guidance.faster)
        led = f" while it was led out of {_HOLD_WORDS[Hold(int(last.hold))]}" if last.detour else ""
        return f"Time ran out before the goal was reached{led}: {faster}.", None
    if outcome is Outcome.COLLISION:
        advice = _either(guidance.wider, guidance.slower) or "lead it farther away from obstacles"
        return f"The robot touched an obstacle: {advice}.", None
    reason, words = _stuck(mission, log, last)
    return words, Stuck(reason, (float(log["x"][-1]), float(log["y"][-1])))


def _arrived(outcome: Outcome, mission: Mission, away: float) -> str:
    """What it holds for the goal, and where it is: with slip or sensors these are two places."""
    if away <= mission.tolerance or not mission.guidance.traits.ends_at_goal:
        return "The robot reached the goal within the tolerance."
    if outcome is Outcome.ARRIVED:
        beyond = f"{100 * (away / mission.tolerance - 1):.2g} % beyond the tolerance"
        return f"The robot reached the goal: it is {away:.3g} m from it, {beyond}."
    return (
        f"The estimated pose reached the goal, but the robot is {away:.2g} m from it: its wheels "
        "slip or its sensors err; add a position sensor to navigation."
    )


_HOLD_WORDS = {
    Hold.NOTHING: "a place that it did not get on from",
    Hold.LOCAL_MINIMUM: "a local minimum of the field",
    Hold.OSCILLATION: "an oscillation between obstacles",
    Hold.NO_WAY_THROUGH: "a place without a way through",
}


def _either(*advice: str) -> str:
    """What there is of the advice, joined by "or", behind a comma where one has an "or" itself."""
    given = [a for a in advice if a]
    return (", or " if any(" or " in a for a in given) else " or ").join(given)


def _stuck(mission: Mission, log: Mapping[str, Array], last: References) -> tuple[StuckReason, str]:
    """Gave up, past the goal, held by an obstacle, standing still, or driving in circles."""
    x, y, to_go = float(log["x"][-1]), float(log["y"][-1]), _to_goal(mission, log)
    if last.gives_up:
        return _gave_up(mission, Hold(int(last.hold)), x, y)
    closest = int(np.argmin(to_go))
    said = f"The robot came less than {STUCK.progress} m closer in {STUCK.time:g} s"
    if to_go[closest] < min(to_go[-1] - STUCK.progress, _READING.near * mission.tolerance):
        wider = _either(
            f"raise tolerance (now {mission.tolerance:g} m)", mission.guidance.advice.slower
        )
        return StuckReason.PAST_GOAL, (
            f"{said}: it came within {to_go[closest]:.2g} m of the goal at "
            f"t = {log['t'][closest]:.4g} s and drove past it; {wider}."
        )
    hold = _hold_of(mission, log, last)
    if hold is not Hold.NOTHING:
        return StuckReason[hold.name], f"{said}: {_hold_words(mission, hold, log['t'][-1], x, y)}."
    return _misled(mission, log, said)


def _gave_up(mission: Mission, hold: Hold, x: float, y: float) -> tuple[StuckReason, str]:
    advice = mission.guidance.advice
    if hold is Hold.NO_WAY_THROUGH:
        change = _either("move the goal or what walls it off", advice.closer)
        return StuckReason.NO_WAY_THROUGH, (
            f"Guidance found no way to the goal and gave up at ({x:.3g}, {y:.3g}): {change}."
        )
    reason = StuckReason.OSCILLATION if hold is Hold.OSCILLATION else StuckReason.LOCAL_MINIMUM
    return reason, (
        f"Guidance did not leave {_HOLD_WORDS[hold]} at ({x:.3g}, {y:.3g}) and gave up: "
        f"{_either('choose another kind of guidance', advice.escape)}."
    )


def _misled(mission: Mission, log: Mapping[str, Array], said: str) -> tuple[StuckReason, str]:
    t, x, y, to_go = log["t"], log["x"], log["y"], _to_goal(mission, log)
    guidance, control = mission.guidance.advice, mission.control.advice
    last = t >= t[-1] - STUCK.time
    way = float(np.sum(np.hypot(np.diff(x[last]), np.diff(y[last]))))
    turned = float(np.ptp(np.unwrap(log["psi"][last])))
    if way < STUCK.progress and turned < _READING.still:
        largest = max(float(np.max(np.abs(log[n][last]))) for n in ("pwm_l", "pwm_r"))
        stronger = _either(control.stronger, "export a plant that moves at such commands")
        return StuckReason.STANDS_STILL, (
            f"{said}: it stands still {to_go[-1]:.2g} m from the goal at commands up to "
            f"{largest:.4g} µs, which the plant does not follow; {stronger}."
        )
    course = _either(guidance.slower, control.steer) or "choose another law of guidance"
    return StuckReason.OFF_COURSE, (
        f"{said} while it drove {way:.2g} m, at least {np.min(to_go):.2g} m from the goal: its "
        f"course does not lead there; {course}."
    )


def _to_goal(mission: Mission, log: Mapping[str, Array]) -> Array:
    """Distance to the goal at every sample [m]."""
    return np.hypot(log["x"] - mission.goal[0], log["y"] - mission.goal[1])


def _hold_of(mission: Mission, log: Mapping[str, Array], last: References) -> Hold:
    """What held the robot: what guidance noticed, or what a potential field did at the end."""
    if last.hold:
        return Hold(int(last.hold))
    if not isinstance(mission.guidance, Holding):
        return Hold.NOTHING
    late = log["t"] >= log["t"][-1] - STUCK.time
    return mission.guidance.hold(mission.scene(), *(log[n][late] for n in ("t", "x", "y")))


def _hold_words(mission: Mission, hold: Hold, t: float, x: float, y: float) -> str:
    """Which obstacle or wall holds the robot, how, and what to do."""
    advice, scene = mission.guidance.advice, mission.scene()
    near = [
        (math.hypot(o.x - x, o.y - y), f"the obstacle at ({o.x:.4g}, {o.y:.4g})")
        for o in (o.at(t) for o in scene.obstacles)
    ]
    for wall in scene.walls:
        px, py = nearest_point(wall, x, y, np)
        near.append((math.hypot(px - x, py - y), f"the wall at ({px:.3g}, {py:.3g})"))
    what = min(near)[1]
    change = _either(_either("move the goal", advice.closer), advice.escape)
    if hold is Hold.LOCAL_MINIMUM:
        return f"{what} pushes as hard as the goal pulls, a local minimum of the field; {change}"
    return f"{what} causes an oscillation; {change}"
