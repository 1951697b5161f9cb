"""Messages between the two halves of a mission, and their protocol; queues implement it."""

import queue
from enum import StrEnum
from typing import NamedTuple, Protocol

from sysid.errors import ModelError
from sysid.robot.mission.contracts import Body


class Seen(NamedTuple):
    """Robot to guidance: how the robot believes to move.

    Attributes:
        t: when [s].
    """

    t: float
    body: Body


class Asked(NamedTuple):
    """Guidance to robot, what a ``geometry_msgs/Twist`` holds in linear.x and angular.z.

    Attributes:
        along: V_d [m/s]; for PWM the mean of both tracks [µs].
        around: ψ_d [rad]; for PWM half of what the right track has more than the left one [µs].
    """

    along: float
    around: float


class Ended(NamedTuple):
    """Either way: the mission is over.

    Attributes:
        outcome: a value of :class:`sysid.robot.mission.result.Outcome`, or :data:`BROKEN_OFF`.
    """

    outcome: str


Message = Seen | Asked | Ended

BROKEN_OFF = "broken off"
"""What a half says that ends without an outcome: stopped by hand, or by an error."""


class SilenceError(ModelError):
    """The other half says nothing any more."""


class Port(Protocol):
    """One end of a connection between the halves; messages come in the order they were sent."""

    def send(self, message: Message) -> None: ...

    def receive(self, patience: float) -> Message:
        """The next message.

        Args:
            patience: how long to wait for it [s].

        Raises:
            SilenceError: none came.
        """
        ...

    def poll(self) -> Message | None:
        """The next message if there is one already."""
        ...


class QueuePort:
    """An end within the process, for tests and for scripts that drive both halves."""

    def __init__(self, out: "queue.Queue[Message]", come: "queue.Queue[Message]") -> None:
        self._out, self._come = out, come

    def send(self, message: Message) -> None:
        self._out.put(message)

    def receive(self, patience: float) -> Message:
        """The next message.

        Raises:
            SilenceError: none came in time.
        """
        try:
            return self._come.get(timeout=patience)
        except queue.Empty:
            raise SilenceError(
                f"the other half of the mission sent nothing for {patience:g} s; check that it "
                "still runs"
            ) from None

    def poll(self) -> Message | None:
        try:
            return self._come.get_nowait()
        except queue.Empty:
            return None


def joined() -> tuple[QueuePort, QueuePort]:
    """Both ends of a connection within the process."""
    there: queue.Queue[Message] = queue.Queue()
    back: queue.Queue[Message] = queue.Queue()
    return QueuePort(there, back), QueuePort(back, there)


class Level(StrEnum):
    """What the guidance half sends to the robot half."""

    REFERENCES = "references"
    """V_d [m/s] and ψ_d [rad]; the speed and yaw loops run in the robot half."""
    PWM = "pwm"
    """PWM of both tracks [µs]; the loops run in the guidance half."""
