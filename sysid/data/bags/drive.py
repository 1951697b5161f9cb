"""Write a simulated drive as a bag, with the topics of a robot and its simulation."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from sysid.data.bags.streams import CLOCK
from sysid.data.bags.writing import Messages, Outgoing, write_bag
from sysid.data.record import Array

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

    Raises:
        DataError: it cannot be written there.
        UsageError: the folder is there already, or no package writes bags.
    """
    return write_bag(Path(path), lambda make: _messages(columns, make))


def _messages(columns: Mapping[str, Array], make: Messages) -> Iterable[Outgoing]:
    names = list(columns)
    place = ESTIMATED if set(ESTIMATED) <= columns.keys() else TRUE
    for values in zip(*(c.tolist() for c in columns.values()), strict=True):
        row = dict(zip(names, values, strict=True))
        now = round(row["t"] * 1e9)
        for topic, kind, content in _of_row(row, now, place, make):
            yield Outgoing(topic, kind, now, content)
        if not math.isnan(row.get("gyro_z", math.nan)):
            yield Outgoing(IMU, "sensor_msgs/msg/Imu", now, _imu(row, now, make))


def _of_row(
    row: Mapping[str, float], now: int, place: tuple[str, ...], make: Messages
) -> Iterable[tuple[str, str, Any]]:
    """Topic, type and content of what is published at one instant."""

    yield (
        CLOCK,
        "rosgraph_msgs/msg/Clock",
        make.make("rosgraph_msgs/msg/Clock", clock=make.time(now)),
    )
    yield REFERENCES, "geometry_msgs/msg/Twist", _twist(make, row["v_ref"], row["psi_ref"])
    yield (
        PWM,
        "std_msgs/msg/Float64MultiArray",
        make.numbers({"left": row["pwm_l"], "right": row["pwm_r"]}),
    )
    yield (
        JOINTS,
        "sensor_msgs/msg/JointState",
        make.make(
            "sensor_msgs/msg/JointState",
            header=make.header(now, BODY),
            name=list(TRACKS),
            velocity=make.array(row["omega_l"], row["omega_r"]),
        ),
    )
    yield (
        ODOMETRY,
        "nav_msgs/msg/Odometry",
        make.make(
            "nav_msgs/msg/Odometry",
            header=make.header(now, WORLD),
            child_frame_id=BODY,
            pose=make.make(
                "geometry_msgs/msg/PoseWithCovariance", pose=_pose(make, *(row[n] for n in place))
            ),
            twist=make.make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=_twist(make, row["v"], row["yaw_rate"]),
            ),
        ),
    )
    yield (
        TRUE_POSE,
        "geometry_msgs/msg/PoseStamped",
        make.make(
            "geometry_msgs/msg/PoseStamped",
            header=make.header(now, WORLD),
            pose=_pose(make, *(row[n] for n in TRUE)),
        ),
    )


def _twist(make: Messages, speed: float, turn: float) -> Any:
    linear = make.make("geometry_msgs/msg/Vector3", x=speed)
    angular = make.make("geometry_msgs/msg/Vector3", z=turn)
    return make.make("geometry_msgs/msg/Twist", linear=linear, angular=angular)


def _pose(make: Messages, x: float, y: float, psi: float) -> Any:
    half = 0.5 * psi
    turn = make.make("geometry_msgs/msg/Quaternion", z=math.sin(half), w=math.cos(half))
    at = make.make("geometry_msgs/msg/Point", x=x, y=y)
    return make.make("geometry_msgs/msg/Pose", position=at, orientation=turn)


def _imu(row: Mapping[str, float], now: int, make: Messages) -> Any:
    acceleration = {n: row.get(f"acc_{n}", 0.0) for n in ("x", "y")}
    return make.make(
        "sensor_msgs/msg/Imu",
        header=make.header(now, BODY),
        angular_velocity=make.make("geometry_msgs/msg/Vector3", z=row["gyro_z"]),
        linear_acceleration=make.make("geometry_msgs/msg/Vector3", **acceleration),
    )
