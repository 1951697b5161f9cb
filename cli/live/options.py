"""The options of following, declared once."""

import math
from dataclasses import dataclass
from typing import Annotated

from sysid.errors import UsageError

from .. import reading

_following = reading.in_panel("Following")


@dataclass(frozen=True)
class Following:
    """Whether and how a log is followed.

    Attributes:
        seconds: after which to end, None for never.
        idle: seconds without a row after which to end, None for never.
        every: seconds between two looks at the estimate.
        forgetting: λ.
        false_alarms: chance of ever seeing a change where there is none.
    """

    on: bool
    seconds: float | None
    idle: float | None
    every: float
    forgetting: float
    false_alarms: float


def following(
    follow: Annotated[
        bool,
        _following(
            "--follow",
            None,
            "Follow one LOG while it is written (a file, - for the standard input, a pipe, or a "
            "ROS topic) until Ctrl-C, and keep the model.",
        ),
    ] = False,
    seconds: Annotated[
        float | None,
        _following("--for", "SECONDS", "End following after so long."),
    ] = None,
    idle: Annotated[
        float | None,
        _following("--idle", "SECONDS", "End following after this time without a new row."),
    ] = None,
    every: Annotated[
        float,
        _following("--every", "SECONDS", "Time between two updates."),
    ] = 1.0,
    forgetting: Annotated[
        float,
        _following(
            "--forgetting",
            "FACTOR",
            "Forgetting factor per row; 0.999 remembers 1000 rows, 1 all.",
        ),
    ] = 1.0,
    false_alarms: Annotated[
        float,
        _following(
            "--false-alarms",
            "CHANCE",
            "Probability of a false alarm while the plant does not change.",
        ),
    ] = 0.01,
) -> Following:
    """Whether and how a log is followed.

    Raises:
        UsageError: a time cannot be, or belongs to following and there is none.
    """
    given = (("--for", seconds), ("--idle", idle), ("--every", every))
    for name, value in given:
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise UsageError(f"{name} is a time in seconds above 0, got {value:g}")
        if value is not None and not follow and name != "--every":
            raise UsageError(f"{name} belongs to --follow; add --follow or omit it")
    if not follow and (every, forgetting, false_alarms) != (1.0, 1.0, 0.01):
        raise UsageError("--every, --forgetting and --false-alarms belong to --follow; add it")
    return Following(follow, seconds, idle, every, forgetting, false_alarms)
