"""Options of the two commands that are nodes of ROS, declared once."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from sysid.errors import UsageError

if TYPE_CHECKING:
    from sysid.cosim.level import Level

_PANEL = "As a node of ROS 1"

REFERENCES = "/simulink_references"
LEVELS = ("references", "pwm")
WAIT = 60.0


@dataclass(frozen=True)
class OverRos:
    """How a command takes part in ROS.

    Attributes:
        level: "references" or "pwm".
        wait: how long the other node may take to come [s].
    """

    ros: bool
    topic: str
    level: str
    wait: float

    @property
    def cut(self) -> "Level":
        """Where the loops run."""
        from sysid.cosim.level import Level

        return Level(self.level)

    def refuse_for_log(self, log: object) -> None:
        """A log is replayed without nodes.

        Raises:
            UsageError: one was to be.
        """
        if self.ros:
            raise UsageError(f"{log} is a log to replay; omit --ros")


def over_ros(
    ros: Annotated[
        bool,
        typer.Option("--ros", rich_help_panel=_PANEL, help="Be one of two nodes of ROS 1."),
    ] = False,
    topic: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            rich_help_panel=_PANEL,
            help=f"Topic for the references of guidance [{REFERENCES}].",
        ),
    ] = None,
    topic_level: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(LEVELS),
            rich_help_panel=_PANEL,
            help="Content of the topic: V_d [m/s] and ψ_d [rad], or PWM [µs] with both loops in "
            f"the guiding node [{LEVELS[0]}].",
        ),
    ] = None,
    wait: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            rich_help_panel=_PANEL,
            help=f"Time to wait for the other node [{WAIT:g}].",
        ),
    ] = None,
) -> OverRos:
    """The options of a node.

    Raises:
        UsageError: one is given without ``--ros``, or cannot be.
    """
    given = {"--topic": topic, "--topic-level": topic_level, "--wait": wait}
    for option, value in given.items():
        if value is not None and not ros:
            raise UsageError(f"{option} belongs to --ros; add --ros")
    if topic_level not in (None, *LEVELS):
        raise UsageError(f"--topic-level {topic_level} is unknown; choose {' or '.join(LEVELS)}")
    if wait is not None and not 0.0 < wait < float("inf"):
        raise UsageError(f"--wait is {wait:g}: give a number above 0")
    name = topic or REFERENCES
    name = name if name.startswith("/") else f"/{name}"
    if not name.replace("/", "").replace("_", "").isalnum():
        raise UsageError(f"--topic {name} is not a topic name; use letters, digits, _ and /")
    return OverRos(ros, name, topic_level or LEVELS[0], wait or WAIT)
