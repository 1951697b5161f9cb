"""Bags as logs: every form of recording, fields by path, clocks and rates of their own."""

import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from recorded_robots import EPOCH, GAIN, MAP, RADIUS, TAU, WIDTH, Robot, Sender

from sysid.data.bags.fields import reader, steps_of
from sysid.data.bags.latency import dead_time
from sysid.data.bags.writing import Messages, Outgoing, write_bag
from sysid.data.io import read_file, read_log
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import DataError, SysidError, UsageError

pytest.importorskip("rosbags", reason="the extra ros reads bags")

FOREIGN = {"offset": 3.2, "drift": 80e-6}
"""The robot's clock against the recorder's."""
APART = Robot(
    command=Sender(0.1, jitter=0.001),
    wheels=Sender(0.02, jitter=0.001, way=0.05, queue=0.004, **FOREIGN),
    gyro=Sender(0.005, way=0.01, queue=0.002, offset=-1.2, drift=-30e-6),
    length=20.0,
)
"""Three rates, three clocks, 50 ms on the way."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return APART.write(tmp_path_factory.mktemp("bags") / "run.mcap")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Robot(length=3.0).write(tmp_path_factory.mktemp("bags") / "small.mcap")


def first_order(path: Path, options: ReadOptions) -> np.ndarray:
    """K and τ of both motors by least squares on the log, (2, 2)."""
    record = read_log(path, options)
    found = []
    for k in (0, 1):
        phi = np.column_stack([record.y[:-1, k], record.u[:-1, k] / 20000.0])
        a, b = np.linalg.lstsq(phi, record.y[1:, k], rcond=None)[0]
        found.append((b / (1.0 - a), -record.dt / np.log(a)))
    return np.array(found)


def test_the_plant_comes_out_of_streams_with_clocks_of_their_own(recorded: Path) -> None:
    """K and τ to 2 %: least squares are drawn by noise of 0.02 of 9 rad/s, not by the clocks."""
    truth = np.column_stack([GAIN, TAU])
    moved = first_order(recorded, ReadOptions(map=MAP, latency="remove"))
    assert np.abs(moved / truth - 1.0).max() < 0.02
    left = first_order(recorded, ReadOptions(map=MAP))
    assert np.abs(left / truth - 1.0).max() > 0.2  # half a row of dead time is not nothing


def test_the_latency_is_said_within_its_error(recorded: Path) -> None:
    log = read_file(recorded, ReadOptions(map=MAP))
    said = [f.sentence for f in log.findings if f.code == "latency"]
    assert len(said) == 1
    words = said[0].split("responds to /cmd_drive ")[1].split()
    late, error = float(words[0]), float(words[2])
    # the way of 50 ms, and the shortest queue of 4 ms / 2000 messages, at three standard errors
    assert abs(late - 50.0) <= 3.0 * error + 0.1
    assert error < 5.0
    clocks = next(f.sentence for f in log.findings if "comes from a clock" in f.sentence)
    assert "3.151 s ahead of" in clocks
    assert "drifts by -80 µs" in clocks


def test_every_form_of_recording_reads_alike(tmp_path: Path) -> None:
    robot = Robot(length=2.0)
    records = [read_log(robot.write(tmp_path / n), ReadOptions(map=MAP))
               for n in ("a.bag", "b.mcap", "c")]  # fmt: skip
    records.append(read_log(next((tmp_path / "c").glob("*.db3")), ReadOptions(map=MAP)))
    for other in records[1:]:
        assert np.array_equal(other.y, records[0].y)
        assert np.array_equal(other.u, records[0].u)
    assert records[0].dt == pytest.approx(0.1, rel=1e-9)
    assert [c.unit for c in records[0].outputs] == ["rad/s", "rad/s"]


def test_a_command_is_held_and_a_reading_is_read_between(tmp_path: Path) -> None:
    def ramp(make: Messages) -> list[Outgoing]:
        kind, read = "geometry_msgs/msg/Twist", "std_msgs/msg/Float64"
        vector = "geometry_msgs/msg/Vector3"
        commands = [
            Outgoing("/cmd_vel", kind, EPOCH + k * 10**8, make.make(
                kind, linear=make.make(vector, x=float(k % 7)))) for k in range(40)
        ]  # fmt: skip
        readings = [Outgoing("/level", read, EPOCH + k * 3 * 10**7, make.make(read, data=0.03 * k))
                    for k in range(140)]  # fmt: skip
        return commands + readings

    path = write_bag(tmp_path / "ramp.bag", ramp)
    options = ReadOptions(map={"cmd": "/cmd_vel.linear.x", "level": "-2*/level"})
    record = read_log(path, options)
    assert record.u[:, 0] == pytest.approx(np.arange(40.0) % 7)
    assert record.y[:, 0] == pytest.approx(-0.2 * np.arange(40.0), abs=1e-9)
    assert record.inputs[0].unit == "m/s"


FIELDS = (
    ("velocity[wheel_left]", 2.0),
    ("velocity[0]", 1.0),
    ("velocity[9]", np.nan),
    ("header.stamp.nanosec", 5.0),
)


def test_fields_by_path_and_name() -> None:
    from rosbags.typesys import Stores, get_typestore

    make = Messages(get_typestore(Stores.ROS2_HUMBLE))
    names, speeds = ["wheel_right", "wheel_left"], np.array([1.0, 2.0])
    joints = make.make("sensor_msgs/msg/JointState", header=make.header(5, ""), name=names,
                       velocity=speeds)  # fmt: skip
    for path, value in FIELDS:
        assert reader(joints, steps_of(path))(joints) == pytest.approx(value, nan_ok=True)
    turn = make.make("geometry_msgs/msg/Quaternion", z=np.sin(0.4), w=np.cos(0.4))
    pose = make.make("geometry_msgs/msg/Pose", orientation=turn)
    assert reader(pose, steps_of("orientation.yaw"))(pose) == pytest.approx(0.8)
    assert reader(pose, steps_of("orientation.pitch"))(pose) == pytest.approx(0.0)


def test_a_pose_and_the_turn_of_a_gyroscope(recorded: Path, tmp_path: Path) -> None:
    """The gyroscope's column agrees with the wheels' r (ω_r − ω_l)/B, both moved to commands."""
    options = ReadOptions(
        map={**MAP, "turn": "/imu/data.angular_velocity.z"}, outputs=("omega_l", "omega_r", "turn"),
        latency="remove",
    )  # fmt: skip
    y = read_log(recorded, options).y
    turn = RADIUS * (y[:, 1] - y[:, 0]) / WIDTH
    assert np.std(y[:, 2] - turn) < 0.1 * np.std(turn)


WRONG = (
    ({}, UsageError, "inspect"),
    ({"u": "/nothing.data"}, UsageError, "has no topic /nothing"),
    ({"u": "/joint_state.velocity[0]"}, UsageError, "/joint_states"),
    ({"u": "/joint_states.velocity[wheel_lef]"}, UsageError, "velocity[wheel_left]"),
    ({"u": "/joint_states.name"}, UsageError, "not a number"),
    ({"u": "/joint_states.effort[0]"}, DataError, "no message of /joint_states"),
    ({"u": "/cmd_drive"}, UsageError, "holds 2 numbers"),
    ({"pose": "/imu/data"}, UsageError, "no pose"),
    ({"u": "?"}, UsageError, "cannot read"),
    ({"u": "/cmd_drive.data[0", "y": "/joint_states"}, UsageError, "cannot be read"),
    ({"u": "0*/cmd_drive.data[0]"}, UsageError, "by 0"),
)


@pytest.mark.parametrize(("mapping", "kind", "words"), WRONG)
def test_a_mapping_that_cannot_be_is_one_sentence(
    small: Path, mapping: dict[str, str], kind: type[SysidError], words: str
) -> None:
    with pytest.raises(kind) as caught:
        read_file(small, ReadOptions(map=mapping))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_damaged_files_are_one_sentence(small: Path, tmp_path: Path) -> None:
    whole = small.read_bytes()
    for name, content, words in (
        ("empty.bag", b"", "record it again"),
        ("text.mcap", b"t,u,y\n", "cannot be read as a bag"),
        ("cut.mcap", whole[: len(whole) // 2], "mcap recover"),
        ("old.bag", b"#ROSBAG V1.2\n" + bytes(100), "rosbag fix"),
        ("data.db3", b"SQLite format 3\0" + bytes(200), "cannot be read as a bag"),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(DataError) as caught:
            read_file(path, ReadOptions(map=MAP))
        assert words in str(caught.value)
    with pytest.raises(DataError, match="no messages"):
        read_file(write_bag(tmp_path / "none.bag", lambda make: ()), ReadOptions(map=MAP))


def test_compressed_bags_and_messages_of_other_packages(tmp_path: Path) -> None:
    """What another recorder writes: rosbag -j and --lz4, ROS 2 by zstd, types of one's own."""
    from rosbags.rosbag1 import Writer as First
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.rosbag2 import Writer as Second
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    kind = "my_robot/msg/Wheels"
    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg("float64 u\nfloat64[2] speeds\nstring who", kind))
    rows = [(k * 10**8, k // 5 % 2, 0.5 * k) for k in range(40)]
    sent = [types.types[kind](u=u, speeds=np.array([0.0, y]), who="me") for _, u, y in rows]
    writers: list[tuple[str, First | Second]] = []
    for form in (First.CompressionFormat.BZ2, First.CompressionFormat.LZ4):
        one = First(tmp_path / f"{form.name}.bag")
        one.set_compression(form)
        writers.append((f"{form.name}.bag", one))
    for name, mode, plugin in (
        ("file", CompressionMode.FILE, StoragePlugin.SQLITE3),
        ("chunks", CompressionMode.STORAGE, StoragePlugin.MCAP),
    ):
        two = Second(tmp_path / name, version=8, storage_plugin=plugin)
        two.set_compression(mode, CompressionFormat.ZSTD)
        writers.append((name, two))
    options = ReadOptions(map={"u": "/wheels.u", "y": "/wheels.speeds[1]"})
    for name, writer in writers:
        raw = types.serialize_ros1 if name.endswith(".bag") else types.serialize_cdr
        with writer:
            topic = writer.add_connection("/wheels", kind, typestore=types)
            for (t, _, _), message in zip(rows, sent, strict=True):
                writer.write(topic, t, raw(message, kind))
        y = read_log(tmp_path / name, options).y[:, 0]
        assert y == pytest.approx(0.5 * np.arange(40.0))


def test_sqlite_without_definitions_reads_what_comes_with_ros(tmp_path: Path) -> None:
    """ROS 2 up to Humble writes such files."""
    path = Robot(length=2.0).write(tmp_path / "old")
    file = next(path.glob("*.db3"))
    with closing(sqlite3.connect(file)) as base:
        base.execute("DELETE FROM message_definitions")
        base.commit()
    assert len(read_log(path, ReadOptions(map=MAP)).y) > 15
    with closing(sqlite3.connect(file)) as base:
        base.execute("UPDATE topics SET type = 'my_robot/msg/Wheels' WHERE name = '/joint_states'")
        base.commit()
    with pytest.raises(DataError, match="what a message of type my_robot/msg/Wheels holds"):
        read_log(file, ReadOptions(map=MAP))


def test_commands_that_come_now_and_then_tell_the_dead_time() -> None:
    """A closed form, y = Σ Δu_j (1 − e^{−(t − s_j − θ)/τ}); commands from 2 s on, rest before."""
    rng = np.random.default_rng(4)
    at, u = np.sort(rng.uniform(2.0, 38.0, 30)), rng.uniform(-1.0, 1.0, 30)
    t = np.arange(0.0, 40.0, 0.02)
    since = t[:, None] - at - 0.05
    y = np.where(since > 0.0, 1.0 - np.exp(-since / 0.3), 0.0) @ np.diff(u, prepend=0.0)
    found = dead_time(t, y + 0.005 * rng.standard_normal(len(t)), [(at, u[:, None])])
    assert found is not None
    assert abs(found.seconds - 0.05) <= 3.0 * found.std_error
    assert found.std_error < 0.002
    assert found.share > 0.99


def test_a_clock_that_is_right_is_not_moved_with_one_that_is_wrong(tmp_path: Path) -> None:
    robot = Robot(wheels=Sender(0.02, way=0.02), gyro=Sender(0.02, way=0.003, offset=0.08),
                  length=4.0)  # fmt: skip
    mapping = {**MAP, "turn": "/imu/data.angular_velocity.z"}
    log = read_file(robot.write(tmp_path / "two.mcap"), ReadOptions(map=mapping))
    moved = [f.sentence for f in log.findings if "comes from a clock" in f.sentence]
    assert ["/imu/data: header.stamp" in text for text in moved] == [True]
    assert "by header.stamp (20 ms before receipt)" in " ".join(log.notes)


def test_without_the_extra_the_sentence_names_it(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(UsageError, match=r"extra ros .* pip install 'sysid-workbench\[ros\]'"):
        read_file(recorded, ReadOptions(map=MAP))
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(UsageError, match="extra ros writes"):
        write_bag(recorded.with_name("other.bag"), lambda make: ())


def test_a_second_file_joins_a_bag_but_no_bag_a_file(recorded: Path, tmp_path: Path) -> None:
    """The recorder's stamps count from 1970, as those of the other file do."""
    t = EPOCH // 10**9 + 2.0 + 0.05 * np.arange(200)
    rows = [f"{x:.3f},{20.0 + 0.1 * k:.2f}" for k, x in enumerate(t)]
    table = tmp_path / "temperature.csv"
    table.write_text("\n".join(["timestamp,temp_degC", *rows]) + "\n")
    outputs = ("omega_l", "omega_r", "temp_degC")
    record = read_log(recorded, ReadOptions(map=MAP, join=(str(table),), outputs=outputs))
    assert record.y[0, 2] == pytest.approx(20.0, abs=0.21)  # its first row to the next of the log
    assert np.diff(record.y[:, 2]) == pytest.approx(0.2, abs=0.01)
    with pytest.raises(UsageError, match="is a bag, which cannot be joined"):
        read_log(table, ReadOptions(join=(str(recorded),), inputs=("none",)))
