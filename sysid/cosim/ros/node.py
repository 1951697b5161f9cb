"""This process as a ROS node."""

import os
from dataclasses import dataclass
from urllib.parse import urlsplit

from sysid.cosim.ros.installation import Ros, load_ros
from sysid.cosim.ros.master import LOOPBACK, Master, master_here
from sysid.errors import ModelError


@dataclass(frozen=True)
class Node:
    """A node that is registered.

    Attributes:
        master: where it is registered.
    """

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

    Raises:
        ModelError: there is no ROS or no master, or the process was a node that has ended.
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
