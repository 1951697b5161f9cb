"""Options of the two commands that are nodes of ROS, declared once."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sysid.errors import UsageError

from ..options import changed, in_panel

if TYPE_CHECKING:
    from sysid.cosim.connection import Level

_node = in_panel("As a node of ROS 1", advanced=True)

REFERENCES = "/simulink_references"
LEVELS = ("references", "pwm")
WAIT = 60.0


def _topic(name: str) -> str:
    name = name if name.startswith("/") else f"/{name}"
    if not name.replace("/", "").replace("_", "").isalnum():
        raise UsageError(f"--topic {name} is not a topic name; use letters, digits, _ and /")
    return name


@dataclass(frozen=True)
class Topic:
    """What two nodes agree on."""

    topic: str | None = _node(
        "NAME", f"Topic for the references of guidance [{REFERENCES}].", parse=_topic
    )
    topic_level: str | None = _node(
        "|".join(LEVELS),
        "Content of the topic: V_d [m/s] and ψ_d [rad], or PWM [µs] with both loops in "
        f"the guiding node [{LEVELS[0]}].",
    )
    wait: float | None = _node("S", f"Time to wait for the other node [{WAIT:g}].")

    def __post_init__(self) -> None:
        if self.topic_level not in (None, *LEVELS):
            raise UsageError(
                f"--topic-level {self.topic_level} is unknown; choose {' or '.join(LEVELS)}"
            )
        if self.wait is not None and not 0.0 < self.wait < float("inf"):
            raise UsageError(f"--wait is {self.wait:g}: give a number above 0")

    @property
    def port(self) -> tuple[str, float]:
        """The topic, and how long the other node may take to come [s]."""
        return self.topic or REFERENCES, self.wait or WAIT

    @property
    def cut(self) -> "Level":
        """Where the loops run."""
        from sysid.cosim.connection import Level

        return Level(self.topic_level or LEVELS[0])


@dataclass(frozen=True)
class OverRos(Topic):
    """Whether and how a mission is guided over ROS."""

    ros: bool = _node(None, "Guide the robot of another node of ROS 1.", default=False)

    def __post_init__(self) -> None:
        Topic.__post_init__(self)
        for name in changed(self):
            if not self.ros:
                raise UsageError(f"--{name.replace('_', '-')} belongs to --ros; add --ros")

    def refuse_for_log(self, log: object) -> None:
        """A log is replayed without nodes."""
        if self.ros:
            raise UsageError(f"{log} is a log to replay; omit --ros")
