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
