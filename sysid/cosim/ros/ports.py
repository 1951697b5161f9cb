"""The connection of the two halves over topics of ROS 1.

``/clock`` and ``/odom`` (``nav_msgs/Odometry``) go from the robot, ``geometry_msgs/Twist`` goes to
it (thesis 7.3), and each half says on a topic of its own (``std_msgs/String``) that it is over.
"""

import contextlib
import math
import queue
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from sysid.cosim.connection import Asked, Ended, Message, Seen, SilenceError
from sysid.cosim.ros.node import Node, open_node
from sysid.errors import ModelError
from sysid.robot.mission.contracts import Body, Pose

CLOCK, ODOM = "/clock", "/odom"
REFERENCES = "/simulink_references"
"""Where the thesis sends V_d and ψ_d (7.3)."""
ROBOT_ENDED, GUIDANCE_ENDED = "/sysid/robot_ended", "/sysid/guidance_ended"

_TYPES = {
    CLOCK: "rosgraph_msgs/Clock",
    ODOM: "nav_msgs/Odometry",
    ROBOT_ENDED: "std_msgs/String",
    GUIDANCE_ENDED: "std_msgs/String",
}

_LOOKS = 0.5
"""While it waits, a node looks so often [s] whether the other one is still connected."""

_GONE = 2.0
"""A node that was connected and is not for this long [s] has ended."""

_LAST_WORDS = 2.0
"""A node that ends waits so long [s] at most for the other one to say that it knows."""

_QUEUE = 1000
"""Messages that wait to be sent: in lock-step one, behind a slow listener many."""


@dataclass
class _Talk:
    """What came, and what is said where nothing comes.

    Attributes:
        listens: subscriptions by topic.
        says: publishers by topic.
        other: what the other node is, in words.
    """

    node: Node
    listens: dict[str, Any]
    says: dict[str, Any]
    other: str
    starts: str

    def __post_init__(self) -> None:
        self.came: queue.Queue[Message] = queue.Queue()

    def publish(self, topic: str, kind: Any) -> None:
        rospy = self.node.ros.rospy
        self.says[topic] = rospy.Publisher(topic, kind, queue_size=_QUEUE, tcp_nodelay=True)

    def subscribe(self, topic: str, kind: Any, take: Callable[[Any], None]) -> None:
        rospy = self.node.ros.rospy
        self.listens[topic] = rospy.Subscriber(topic, kind, take, tcp_nodelay=True)

    def heard_end(self, message: Any) -> None:
        """Take the other half's last word."""
        self.came.put(Ended(str(message.data)))

    def wait(self, topic: str, patience: float) -> Message:
        """The next message.

        Args:
            patience: how long [s].
        """
        until, gone = time.monotonic() + patience, 0.0
        while True:
            remaining = until - time.monotonic()
            try:
                return self.came.get(timeout=max(min(remaining, _LOOKS), 1e-3))
            except queue.Empty:
                connected = self.listens[topic].get_num_connections()
            gone = 0.0 if connected else gone + _LOOKS
            if connected > 1:
                self.refuse_two(topic)
            if remaining <= 0.0 or gone >= _GONE:
                raise SilenceError(self.why_silent(topic, patience if remaining <= 0.0 else gone))

    def why_silent(self, topic: str, seconds: float) -> str:
        if self.listens[topic].get_num_connections() == 0:
            self.node.master.check()
            return (
                f"{self.other} left, and no node publishes {topic} any more; {self.starts} and run "
                "this again"
            )
        return (
            f"{self.other} is connected, but sent nothing on {topic} for {seconds:.3g} s: check "
            "whether it hangs or waits"
        )

    def refuse_two(self, topic: str) -> None:
        """Refuse a topic that several nodes publish."""
        names = self.node.master.publishers(topic)
        if len(names) > 1:
            raise ModelError(
                f"{len(names)} nodes publish {topic} ({', '.join(names)}): end all but one"
            )

    def meet(self, topic: str, patience: float) -> None:
        """Wait until the other node publishes a topic."""
        missing = (
            f"{self.other} did not appear within {patience:g} s, and no node publishes {topic}; "
            f"{self.starts}"
        )
        self._connect(self.listens[topic], patience, missing)
        self.refuse_two(topic)

    def be_heard(self, topic: str, patience: float) -> None:
        """Wait until a topic of ours has a listener: what is said before is lost."""
        missing = f"no node subscribed to {topic} within {patience:g} s; {self.starts}"
        self._connect(self.says[topic], patience, missing)

    def _connect(self, one: Any, patience: float, missing: str) -> None:
        until = time.monotonic() + patience
        while not one.get_num_connections():
            if time.monotonic() > until:
                raise SilenceError(missing)
            time.sleep(0.02)

    def end(self, said: bool) -> None:
        """Close; after a last word only when the other one has had the time to hear it."""
        until = time.monotonic() + (_LAST_WORDS if said else 0.0)
        while time.monotonic() < until and any(
            p.get_num_connections() for topic, p in self.says.items() if topic in _TYPES
        ):
            with contextlib.suppress(queue.Empty):
                if isinstance(self.came.get(timeout=0.02), Ended):
                    time.sleep(0.1)  # ours is on its way
                    break
        for one in (*self.listens.values(), *self.says.values()):
            with contextlib.suppress(Exception):  # the master may be gone
                one.unregister()
        self.node.end()


class _End:
    """One end: what comes on a topic is taken in its order."""

    def __init__(self, talk: _Talk, references: str, heard: str) -> None:
        self._talk, self._references, self.said_end = talk, references, False
        self._heard_on = heard

    def receive(self, patience: float) -> Message:
        return self._talk.wait(self._heard_on, patience)

    def poll(self) -> Message | None:
        with contextlib.suppress(queue.Empty):
            return self._talk.came.get_nowait()
        return None


class RobotPort(_End):
    """The robot's end: says ``/clock`` and ``/odom``, hears what is asked."""

    def __init__(self, talk: _Talk, references: str) -> None:
        super().__init__(talk, references, heard=references)
        ros = talk.node.ros
        talk.publish(CLOCK, ros.clock)
        talk.publish(ODOM, ros.odometry)
        talk.publish(ROBOT_ENDED, ros.string)
        talk.subscribe(references, ros.twist, self._heard)
        talk.subscribe(GUIDANCE_ENDED, ros.string, talk.heard_end)

    def send(self, message: Message) -> None:
        """Say where the robot is, or that it is over."""
        ros, says = self._talk.node.ros, self._talk.says
        if isinstance(message, Ended):
            says[ROBOT_ENDED].publish(ros.string(message.outcome))
            self.said_end = True
        elif isinstance(message, Seen):
            stamp = ros.genpy.Time(*divmod(round(message.t * 1e9), 1_000_000_000))
            says[CLOCK].publish(ros.clock(stamp))
            says[ODOM].publish(odometry_of(message.body, stamp, ros.odometry()))

    def _heard(self, message: Any) -> None:
        self._talk.came.put(Asked(float(message.linear.x), float(message.angular.z)))


class GuidancePort(_End):
    """The end of guidance: hears ``/clock`` and ``/odom``, says what it asks for."""

    def __init__(self, talk: _Talk, references: str) -> None:
        super().__init__(talk, references, heard=ODOM)
        self._now: float | None = None
        ros = talk.node.ros
        talk.subscribe(CLOCK, ros.clock, self._ticked)
        talk.subscribe(ROBOT_ENDED, ros.string, talk.heard_end)
        talk.subscribe(ODOM, ros.odometry, self._heard)

    def offer(self) -> None:
        """Publish what is asked: the robot begins when it sees that; all else is ready by now."""
        ros = self._talk.node.ros
        self._talk.publish(GUIDANCE_ENDED, ros.string)
        self._talk.publish(self._references, ros.twist)

    def send(self, message: Message) -> None:
        """Ask for something, or say that it is over."""
        ros, says = self._talk.node.ros, self._talk.says
        if isinstance(message, Ended):
            says[GUIDANCE_ENDED].publish(ros.string(message.outcome))
            self.said_end = True
        elif isinstance(message, Asked):
            twist = ros.twist()
            twist.linear.x, twist.angular.z = message
            says[self._references].publish(twist)

    def _ticked(self, message: Any) -> None:
        self._now = float(message.clock.to_sec())

    def _heard(self, message: Any) -> None:
        """Its stamp is the time; a robot that does not stamp goes by ``/clock``."""
        t = float(message.header.stamp.to_sec())
        if t == 0.0 and self._now is not None:
            t = self._now
        self._talk.came.put(Seen(t, body_of(message)))


def odometry_of(body: Body, stamp: Any, message: Any) -> Any:
    """Fill a ``nav_msgs/Odometry``: pose in ``odom``, velocities in ``base_link``."""
    message.header.stamp, message.header.frame_id = stamp, "odom"
    message.child_frame_id = "base_link"
    x, y, psi = map(float, body.pose)
    place, turned = message.pose.pose.position, message.pose.pose.orientation
    place.x, place.y = x, y
    turned.z, turned.w = math.sin(0.5 * psi), math.cos(0.5 * psi)
    moves = message.twist.twist
    moves.linear.x, moves.linear.y = float(body.speed), float(body.lateral)
    moves.angular.z = float(body.yaw_rate)
    return message


def body_of(message: Any) -> Body:
    """Pose and velocity of a ``nav_msgs/Odometry``; the heading is that of its quaternion.

    ψ = atan2(2 (w z + x y), 1 − 2 (y² + z²))
    """
    place, q, moves = (
        message.pose.pose.position,
        message.pose.pose.orientation,
        message.twist.twist,
    )
    psi = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    pose = Pose(float(place.x), float(place.y), psi)
    return Body(pose, float(moves.linear.x), float(moves.angular.z), float(moves.linear.y))


@contextmanager
def robot_node(topic: str = REFERENCES, patience: float = 60.0) -> Iterator[RobotPort]:
    """This process as the node that is the robot, connected to the one that guides it.

    Args:
        patience: how long the other node may take to come [s].
    """
    node = _checked("sysid_robot", topic)
    for said in (ODOM, CLOCK):
        publishers = node.master.publishers(said)
        if publishers:
            raise ModelError(
                f"{', '.join(publishers)} already publishes {said}, and only one robot may; "
                "end that node or use another master"
            )
    node.ros.rospy.set_param("/use_sim_time", True)  # as Gazebo: this node is the clock
    talk = _Talk(node, {}, {}, "the node that guides", "start it, e.g. with `sysid simulate`")
    port = RobotPort(talk, topic)
    try:
        talk.meet(topic, patience)
        talk.be_heard(ODOM, patience)
        yield port
    finally:
        talk.end(port.said_end)


@contextmanager
def guidance_node(topic: str = REFERENCES, patience: float = 60.0) -> Iterator[GuidancePort]:
    """This process as the node that guides, connected to the robot.

    Args:
        patience: how long the robot may take to come [s].
    """
    node = _checked("sysid_guidance", topic)
    publishers = node.master.publishers(topic)
    if publishers:
        raise ModelError(
            f"{', '.join(publishers)} publishes {topic} already: only one node may guide; end it "
            "or choose another topic"
        )
    talk = _Talk(node, {}, {}, "the robot", "start it, e.g. with `sysid node`")
    port = GuidancePort(talk, topic)
    try:
        talk.meet(ODOM, patience)
        port.offer()
        talk.be_heard(topic, patience)
        yield port
    finally:
        talk.end(port.said_end)


def _checked(name: str, references: str) -> Node:
    node = open_node(name)
    wanted = _TYPES | {references: "geometry_msgs/Twist"}
    node.master.check_types(wanted.items())
    return node
