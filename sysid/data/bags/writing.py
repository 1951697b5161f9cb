"""Bags as the tools of ROS write them: ROS 1, a folder of ROS 2, or one MCAP file.

A simulated drive is written with the topics of a robot and its simulation.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from sysid.data.bags.streams import CLOCK
from sysid.data.files import replacing
from sysid.data.record import Array
from sysid.errors import UsageError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

FOLDER_VERSION: Literal[8] = 8
"""Version of a ROS 2 folder's description, which Iron and later distributions read."""


class Outgoing(NamedTuple):
    """A message to write: its topic and type, when it was received [ns], and its content."""

    topic: str
    kind: str
    received: int
    content: Any


Source = Callable[["Messages"], Iterable[Outgoing]]
"""Makes the messages of a bag, in any order, with the types of its kind of ROS."""


class Messages:
    """Makes messages of one kind of ROS from plain values."""

    def __init__(self, types: "Typestore") -> None:
        self._types = types

    def make(self, kind: str, **fields: Any) -> Any:
        """A message; what is not given is zero, empty or a message of zeros.

        Args:
            kind: its type, e.g. ``geometry_msgs/msg/Twist``.
            fields: by name, numbers and messages.
        """
        return self._types.types[kind](
            **{
                name: fields[name] if name in fields else self._empty(*shape)
                for name, shape in self._types.fielddefs[kind][1]
            }
        )

    def header(self, stamp: int, frame: str) -> Any:
        """A header with a stamp [ns]."""
        return self.make("std_msgs/msg/Header", stamp=self.time(stamp), frame_id=frame)

    def labelled(self, by_label: Mapping[str, float]) -> dict[str, Any]:
        """The fields of a Float64MultiArray whose elements are labelled."""
        part = "std_msgs/msg/MultiArrayDimension"
        dims = [self.make(part, label=label, size=1, stride=1) for label in by_label]
        layout = self.make("std_msgs/msg/MultiArrayLayout", dim=dims)
        return {"layout": layout, "data": self.array(*by_label.values())}

    def array(self, *values: float) -> Any:
        import numpy as np

        return np.array(values, dtype=np.float64)

    def time(self, stamp: int) -> Any:
        """An instant [ns]."""
        sec, nanosec = divmod(stamp, 10**9)
        return self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def _empty(self, form: int, what: Any) -> Any:
        """The empty value of a type, as the tables of the message types describe it."""
        import numpy as np

        if form == 1:  # a plain value
            name = what[0]
            return "" if name == "string" else False if name == "bool" else 0
        if form == 2:  # a message
            return self.make(what)
        inner, count = what
        if inner[0] == 1 and inner[1][0] != "string":
            return np.zeros(count, dtype=np.dtype(inner[1][0]))
        return [self._empty(*inner) for _ in range(count)]


def write_bag(path: Path, source: Source) -> Path:
    """Write a bag; the ending sets its form: ``.bag``, ``.mcap``, or none for a ROS 2 folder.

    Args:
        path: where; a file is replaced, and appears complete or not at all.
        source: makes its messages.

    Returns:
        The path written.
    """
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise UsageError(
            f"{path.name} is a bag, which the extra ros writes: pip install 'sysid-workbench[ros]'"
        ) from None
    suffix = path.suffix.lower()
    if suffix not in ("", ".bag", ".mcap"):
        raise UsageError(f"{path} is not a bag; name a .bag, an .mcap, or a folder")
    if path.is_dir() or (not suffix and path.exists()):
        raise UsageError(f"{path} exists already; choose another path for the bag")
    types = get_typestore(Stores.ROS1_NOETIC if suffix == ".bag" else Stores.ROS2_HUMBLE)
    messages = sorted(source(Messages(types)), key=lambda m: m.received)
    with replacing(path, folder=not suffix) as new:
        made = new.with_name("bag") if suffix == ".mcap" else new
        _write(made, messages, types, suffix)
        if suffix == ".mcap":  # written as a folder that holds the file
            next(made.glob("*.mcap")).rename(new)
    return path


def _write(path: Path, messages: list[Outgoing], types: "Typestore", suffix: str) -> None:
    from rosbags import rosbag1, rosbag2

    if suffix == ".bag":
        writer: Any = rosbag1.Writer(path)
        serialized = types.serialize_ros1
    else:
        storage = rosbag2.StoragePlugin
        plugin = storage.MCAP if suffix else storage.SQLITE3
        writer = rosbag2.Writer(path, version=FOLDER_VERSION, storage_plugin=plugin)
        serialized = types.serialize_cdr
    with writer as bag:
        topics = {
            m.topic: bag.add_connection(m.topic, m.kind, typestore=types)
            for m in {m.topic: m for m in messages}.values()
        }
        for m in messages:
            bag.write(topics[m.topic], m.received, serialized(m.content, m.kind))


REFERENCES, PWM, JOINTS = "/simulink_references", "/pwm", "/joint_states"
ODOMETRY, TRUE_POSE, IMU = "/odom", "/true_pose", "/imu"
TRACKS = ("left_track", "right_track")
WORLD, BODY = "odom", "base_link"

ESTIMATED = ("x_est", "y_est", "psi_est")
TRUE = ("x", "y", "psi")


def write_drive(columns: Mapping[str, Array], path: str | Path) -> Path:
    """Write the log of a mission as a bag.

    /clock; /simulink_references (Twist: linear.x the speed, angular.z the heading to be driven);
    /pwm (Float64MultiArray: left, right [µs]); /joint_states of both tracks [rad/s]; /odom, the
    pose as navigation has it with the speeds of the body; /true_pose; where the mission has a
    gyroscope, /imu at the instants of its measurements. All are stamped by the mission's clock, and
    received in the instant of their stamp.

    Args:
        columns: of the log by name (:data:`sysid.robot.mission.loop.COLUMNS`), (N,) each.
        path: ``.bag``, ``.mcap``, or a folder of ROS 2.
    """
    return write_bag(Path(path), lambda make: _messages(columns, make))


def _messages(columns: Mapping[str, Array], make: Messages) -> Iterable[Outgoing]:
    names = list(columns)
    place = ESTIMATED if set(ESTIMATED) <= columns.keys() else TRUE
    for values in zip(*(c.tolist() for c in columns.values()), strict=True):
        row = dict(zip(names, values, strict=True))
        now = round(row["t"] * 1e9)
        for topic, kind, fields in _of_row(row, now, place, make):
            yield Outgoing(topic, kind, now, make.make(kind, **fields))


def _of_row(
    row: Mapping[str, float], now: int, place: tuple[str, ...], make: Messages
) -> Iterable[tuple[str, str, Mapping[str, Any]]]:
    """Topic, type and fields of what is published at one instant."""
    body, world = ({"header": make.header(now, frame)} for frame in (BODY, WORLD))
    yield CLOCK, "rosgraph_msgs/msg/Clock", {"clock": make.time(now)}
    yield REFERENCES, "geometry_msgs/msg/Twist", _twist(make, row["v_ref"], row["psi_ref"])
    pwm = make.labelled({"left": row["pwm_l"], "right": row["pwm_r"]})
    yield PWM, "std_msgs/msg/Float64MultiArray", pwm
    speeds = {"name": list(TRACKS), "velocity": make.array(row["omega_l"], row["omega_r"])}
    yield JOINTS, "sensor_msgs/msg/JointState", body | speeds
    twist = make.make("geometry_msgs/msg/Twist", **_twist(make, row["v"], row["yaw_rate"]))
    pose, true_pose = (_pose(make, *(row[n] for n in names)) for names in (place, TRUE))
    pose = make.make("geometry_msgs/msg/PoseWithCovariance", pose=pose)
    twist = make.make("geometry_msgs/msg/TwistWithCovariance", twist=twist)
    odometry = world | {"child_frame_id": BODY, "pose": pose, "twist": twist}
    yield ODOMETRY, "nav_msgs/msg/Odometry", odometry
    yield TRUE_POSE, "geometry_msgs/msg/PoseStamped", world | {"pose": true_pose}
    if not math.isnan(row.get("gyro_z", math.nan)):
        acceleration = {n: row.get(f"acc_{n}", 0.0) for n in ("x", "y")}
        turn = make.make("geometry_msgs/msg/Vector3", z=row["gyro_z"])
        pushed = make.make("geometry_msgs/msg/Vector3", **acceleration)
        imu = body | {"angular_velocity": turn, "linear_acceleration": pushed}
        yield IMU, "sensor_msgs/msg/Imu", imu


def _twist(make: Messages, speed: float, turn: float) -> dict[str, Any]:
    linear = make.make("geometry_msgs/msg/Vector3", x=speed)
    angular = make.make("geometry_msgs/msg/Vector3", z=turn)
    return {"linear": linear, "angular": angular}


def _pose(make: Messages, x: float, y: float, psi: float) -> Any:
    half = 0.5 * psi
    turn = make.make("geometry_msgs/msg/Quaternion", z=math.sin(half), w=math.cos(half))
    at = make.make("geometry_msgs/msg/Point", x=x, y=y)
    return make.make("geometry_msgs/msg/Pose", position=at, orientation=turn)
