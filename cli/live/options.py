"""The options of following, declared once."""

import math
from dataclasses import dataclass

from sysid.errors import UsageError

from ..options import in_panel

_following = in_panel("Following")
_following_more = in_panel("Following", advanced=True)


@dataclass(frozen=True)
class Following:
    """Whether and how a log is followed."""

    follow: bool = _following(
        None,
        "Follow one LOG while it is written, until Ctrl-C; a file, - for the standard input, a "
        "pipe, or a ROS topic. The model is kept.",
        default=False,
    )
    seconds: float | None = _following_more("SECONDS", "End following after so long.", "--for")
    idle: float | None = _following_more(
        "SECONDS", "End following after this time without a new row."
    )
    every: float = _following_more("SECONDS", "Time between two updates.", default=1.0)
    forgetting: float = _following_more(
        "FACTOR", "Forgetting factor per row; 0.999 remembers 1000 rows, 1 all.", default=1.0
    )
    false_alarms: float = _following_more(
        "CHANCE", "Probability of a false alarm while the plant does not change.", default=0.01
    )

    def __post_init__(self) -> None:
        given = (("--for", self.seconds), ("--idle", self.idle), ("--every", self.every))
        for name, value in given:
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise UsageError(f"{name} is a time in seconds above 0, got {value:g}")
            if value is not None and not self.follow and name != "--every":
                raise UsageError(f"{name} belongs to --follow; add --follow or omit it")
        if not self.follow and (self.every, self.forgetting, self.false_alarms) != (1.0, 1.0, 0.01):
            raise UsageError("--every, --forgetting and --false-alarms belong to --follow; add it")
