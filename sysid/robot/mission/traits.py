"""Properties and advice of laws: capabilities, changes to suggest, reasons of being stuck."""

import math
from dataclasses import dataclass
from enum import IntEnum


class Hold(IntEnum):
    """What a law of guidance has noticed to keep a robot from its goal, as a number for arrays."""

    NOTHING = 0
    LOCAL_MINIMUM = 1
    OSCILLATION = 2
    NO_WAY_THROUGH = 3


@dataclass(frozen=True)
class GuidanceTraits:
    """What a law of guidance can do and needs.

    Attributes:
        passes_waypoints: it knows ``scene.way``; otherwise it is given one waypoint after the other
            as its goal.
        follows_path: it knows ``scene.path``; otherwise a mission with a path is refused.
        feasible: its references are kept within the limits of the plant unless a mission says
            otherwise.
        top_speed: no reference of speed is above it [m/s].
        ends_at_goal: it calls reached what lies at the goal; otherwise its end is no place.
    """

    passes_waypoints: bool = False
    follows_path: bool = False
    feasible: bool = False
    top_speed: float = math.inf
    ends_at_goal: bool = True


@dataclass(frozen=True)
class GuidanceAdvice:
    """What to change in a guidance law, for sentences about missions that failed; may be empty.

    Attributes:
        faster, slower: to drive faster, or slower, e.g. "lower v_max".
        wider: to keep farther from obstacles.
        closer: to let obstacles push less.
        escape: to leave what holds the robot.
    """

    faster: str = ""
    slower: str = ""
    wider: str = ""
    closer: str = ""
    escape: str = ""


@dataclass(frozen=True)
class ControlAdvice:
    """What to change in a controller.

    Attributes:
        stronger: to command more.
        steer: to steer harder.
    """

    stronger: str = ""
    steer: str = ""
