"""ROS 1 on this machine: rospy of the system's Python, appended last to the path."""

import os
import re
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from sysid.errors import ModelError

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

    Raises:
        ModelError: they are not installed, or belong to another Python.
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
    """Put the folder that holds rospy at the end of the path.

    Raises:
        ModelError: there is none, or it belongs to another Python.
    """
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
