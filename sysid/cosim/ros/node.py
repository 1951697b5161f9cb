"""This process as a ROS node: the installation it needs, its master, and the node itself."""

import os
import re
import socket
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from http.client import HTTPConnection, HTTPException
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, cast
from urllib.parse import urlsplit
from xmlrpc.client import Error, ServerProxy, Transport

from sysid.errors import ModelError

ANSWER = 3.0
"""A master or a node that is there answers within this time [s], on a busy machine, too."""

ASKING = "/sysid"
"""Name under which the master is asked; nothing is registered under it."""

LOOPBACK = ("localhost", "127.0.0.1", "::1")


class _Bounded(Transport):
    """Calls that end after :data:`ANSWER`."""

    def make_connection(self, host: Any) -> HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = ANSWER
        return connection


@dataclass(frozen=True)
class Master:
    """A ROS master by its address, such as ``http://localhost:11311``."""

    uri: str

    def check(self) -> None:
        """Ask whether it is there."""
        self._call("getPid")

    def publishers(self, topic: str) -> tuple[str, ...]:
        """Names of the nodes that publish a topic and answer; the dead stay registered."""
        published = self._call("getSystemState")[0]
        names: list[str] = next((nodes for name, nodes in published if name == topic), [])
        return tuple(node for node in names if self._lives(node))

    def type_of(self, topic: str) -> str | None:
        """Type of a topic, e.g. ``nav_msgs/Odometry``; None if unknown."""
        types = dict(self._call("getTopicTypes"))
        type_name = types.get(topic)
        return None if type_name in (None, "*") else str(type_name)

    def check_types(self, wanted: Iterable[tuple[str, str]]) -> None:
        """Refuse topics that are of another type.

        Args:
            wanted: pairs of topic and type.
        """
        for topic, kind in wanted:
            type_name = self.type_of(topic)
            if type_name not in (None, kind):
                raise ModelError(
                    f"topic {topic} is of type {type_name} and {kind} is needed: end the node that "
                    f"uses it otherwise ({', '.join(self.publishers(topic)) or 'a subscriber'}), "
                    "or choose another topic"
                )

    def _lives(self, node: str) -> bool:
        try:
            address = urlsplit(self._call("lookupNode", node))
            place = (address.hostname or "", address.port or 0)
            socket.create_connection(place, timeout=ANSWER).close()
        except (OSError, ModelError):
            return False
        return True

    def _call(self, name: str, *arguments: object) -> Any:
        try:
            with ServerProxy(self.uri, transport=_Bounded()) as server:
                code, said, value = cast(Any, getattr(server, name)(ASKING, *arguments))
        except (OSError, Error, HTTPException, ValueError, TypeError) as error:
            raise ModelError(
                f"no ROS master answers at {self.uri} ({error}): start roscore, or set "
                "ROS_MASTER_URI to where it runs"
            ) from None
        if code != 1:
            raise ModelError(f"the ROS master at {self.uri} refuses {name}: {said}")
        return value


def master_here() -> Master:
    """The master that ``ROS_MASTER_URI`` names, there and answering."""
    master = Master(os.environ.get("ROS_MASTER_URI", "http://localhost:11311"))
    master.check()
    return master


SYSTEM_PYTHON = Path("/usr/bin/python3")
"""The interpreter for which a distribution installs rospy."""

SYSTEM_PACKAGES = (Path("/usr/lib/python3/dist-packages"),)
"""Where Debian and Ubuntu keep it; ``/opt/ros/*/lib/python3/dist-packages`` are looked at, too."""

WANTED = "ros-core python3-rospy python3-nav-msgs python3-geometry-msgs"
"""Debian's packages that bring a master, rospy and the messages."""


class Ros(NamedTuple):
    """What of ROS the nodes use.

    Attributes:
        message_class: "nav_msgs/Odometry" → class, None where its package is not installed.
    """

    rospy: Any
    genpy: Any
    message_class: Any
    odometry: Any
    twist: Any
    clock: Any
    string: Any


def load_ros() -> Ros:
    """Import rospy and the messages of the nodes.

    The system's packages come last on the path, so that they never take the place of ours.
    """
    if find_spec("rospy") is None:
        _append_system_packages()
    try:
        return Ros(
            import_module("rospy"),
            import_module("genpy"),
            import_module("roslib.message").get_message_class,
            import_module("nav_msgs.msg").Odometry,
            import_module("geometry_msgs.msg").Twist,
            import_module("rosgraph_msgs.msg").Clock,
            import_module("std_msgs.msg").String,
        )
    except ImportError as error:
        raise ModelError(
            f"rospy cannot be imported here ({error}): install Debian's packages {WANTED}"
        ) from error


def _append_system_packages(
    python: Path = SYSTEM_PYTHON, folders: Sequence[Path] = SYSTEM_PACKAGES
) -> None:
    """Put the folder that holds rospy at the end of the path."""
    opt = sorted(Path("/opt/ros").glob("*/lib/python3/dist-packages"))
    packages = [f for f in (*opt, *folders) if (f / "rospy").is_dir()]
    if not packages:
        raise ModelError(
            f"ROS 1 is not installed here: install Debian's packages {WANTED}, or run this where "
            "they are"
        )
    ros_python = re.search(r"python(3\.\d+)", os.path.realpath(python))
    ours = f"{sys.version_info[0]}.{sys.version_info[1]}"
    if ros_python is not None and ros_python[1] != ours:
        raise ModelError(
            f"rospy belongs to the system's Python {ros_python[1]}, and this is Python {ours}; "
            f"install the workbench into an environment of Python {ros_python[1]}"
        )
    sys.path.extend(str(f) for f in (*packages, *folders) if str(f) not in sys.path)


@dataclass(frozen=True)
class Node:
    """A node that is registered."""

    ros: Ros
    master: Master

    def end(self) -> None:
        """Leave the master; rospy cannot come back within the same process."""
        self.ros.rospy.signal_shutdown("the end")


def open_node(name: str) -> Node:
    """Register this process as a node; a second call in the process gives the node it is already.

    Signals stay with the caller, who ends by Ctrl-C as everywhere. Where the master runs on this
    machine, the node offers itself under 127.0.0.1 unless ``ROS_IP`` or ``ROS_HOSTNAME`` say
    otherwise: a host name that does not resolve would let the others wait for ever.

    Args:
        name: what the node is called; rospy appends a number so that two of them can live.
    """
    ros, master = load_ros(), master_here()
    if (urlsplit(master.uri).hostname or "") in LOOPBACK and "ROS_HOSTNAME" not in os.environ:
        os.environ.setdefault("ROS_IP", "127.0.0.1")
    rospy = ros.rospy
    if rospy.is_shutdown() and rospy.core.is_initialized():
        raise ModelError(
            "this process was a ROS node that has ended, and rospy cannot start it again: use a "
            "new process"
        )
    if not rospy.core.is_initialized():
        rospy.init_node(
            name, anonymous=True, disable_signals=True, disable_rosout=True, log_level=rospy.ERROR
        )
    return Node(ros, master)
