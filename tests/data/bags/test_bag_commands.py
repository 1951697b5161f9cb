"""Bags on the command line: what is in one, a mission as one, and the tools that read it back."""

import json
import shlex
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from mission_cases import Robot as Plant
from recorded_robots import EPOCH, MAP, Robot, Sender

from sysid.data.bags.writing import Messages, Outgoing, write_bag, write_drive
from sysid.data.io import read_file, read_log
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import DataError, UsageError
from sysid.robot.mission.localize import localize
from sysid.robot.mission.result import MissionResult, write_log
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission

pytest.importorskip("rosbags", reason="the extra ros reads bags")

TRACKS = {
    "pwm_l": "/pwm.data[left]",
    "pwm_r": "/pwm.data[right]",
    "omega_l": "/joint_states.velocity[left_track]",
    "omega_r": "/joint_states.velocity[right_track]",
    "pose": "/true_pose",
}
SENSORS = {"navigation": {"kind": "ekf"}, "sensors": {"encoders": None, "gyroscope": None}}
SYSTEM_PYTHON = Path("/usr/bin/python3")


@pytest.fixture(scope="module")
def driven() -> tuple[Mission, MissionResult]:
    mission = Mission.model_validate({"goal": [1.0, 0.4], **SENSORS})
    return mission, simulate(mission, Plant(), seed=2)


@pytest.mark.parametrize("name", ["m.mcap", "m.bag"])
def test_a_mission_comes_back_out_of_its_bag_as_out_of_its_log(
    driven: tuple[Mission, MissionResult], tmp_path: Path, name: str
) -> None:
    """Bit for bit: the stamps of 0.1 s are exact in nanoseconds, and the numbers are doubles."""
    _, result = driven
    write_drive(result.log, tmp_path / name)
    write_log(result, tmp_path / "m.csv")
    bag = read_log(tmp_path / name, ReadOptions(map=TRACKS))
    log = read_log(tmp_path / "m.csv", ReadOptions(inputs=("pwm_l", "pwm_r"),
                                                   outputs=("omega_l", "omega_r")))  # fmt: skip
    np.testing.assert_array_equal(bag.u, log.u)
    np.testing.assert_array_equal(bag.y, log.y)
    assert bag.dt == log.dt
    assert bag.pose is not None
    assert log.pose is not None
    np.testing.assert_array_equal(bag.pose[:, :2], log.pose[:, :2])
    np.testing.assert_allclose(bag.pose[:, 2], log.pose[:, 2], atol=1e-12)  # through a quaternion


def test_the_recorded_tools_read_what_was_written(
    driven: tuple[Mission, MissionResult], tmp_path: Path
) -> None:
    reader = pytest.importorskip("mcap.reader", reason="mcap reads MCAP")
    _, result = driven
    path = write_drive(result.log, tmp_path / "m.mcap")
    with path.open("rb") as stream:
        opened = reader.make_reader(stream, validate_crcs=True)
        counts = opened.get_summary().statistics.channel_message_counts
        assert set(counts.values()) == {len(result.log["t"])}
        first = next(opened.iter_messages(topics=["/odom"]))
    assert first[0].name == "nav_msgs/msg/Odometry"


def test_rosbag_of_ros_1_reads_what_was_written(
    driven: tuple[Mission, MissionResult], tmp_path: Path
) -> None:
    check = [SYSTEM_PYTHON, "-c", "import rosbag"]
    if not SYSTEM_PYTHON.exists() or subprocess.run(check, capture_output=True).returncode:
        pytest.skip("rosbag (python3-rosbag) is not installed for the system's Python")
    _, result = driven
    path = write_drive(result.log, tmp_path / "m.bag")
    script = (
        "import json, rosbag, sys\n"
        "bag = rosbag.Bag(sys.argv[1])\n"
        "print(json.dumps([[t.to_sec(), m.velocity] for _, m, t in "
        "bag.read_messages(topics=['/joint_states'])]))"
    )
    line = [SYSTEM_PYTHON, "-c", script, path]
    done = subprocess.run(line, capture_output=True, check=True, timeout=60)
    rows = json.loads(done.stdout)
    assert [r[0] for r in rows] == pytest.approx(result.log["t"].tolist(), abs=1e-9)
    assert [r[1][0] for r in rows] == result.log["omega_l"].tolist()


def test_an_estimate_of_a_bag_is_that_of_the_log(
    driven: tuple[Mission, MissionResult], tmp_path: Path
) -> None:
    mission, result = driven
    bag, log = write_drive(result.log, tmp_path / "m.bag"), write_log(result, tmp_path / "m.csv")
    mapping = {**TRACKS, "gyro_z": "/imu.angular_velocity.z"}
    found = localize(bag, mission, options=ReadOptions(map=mapping))
    own = localize(log, mission)
    np.testing.assert_allclose(found.columns["psi_est"], own.columns["psi_est"], atol=1e-9)
    assert "gyro_z" in found.used


def test_the_command_records_a_mission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    from plant_models import robot_model

    from sysid.export.package import write_package

    monkeypatch.chdir(tmp_path)
    write_package(robot_model(), tmp_path / "plant")
    (tmp_path / "m.yaml").write_text("goal: [0.6, 0]\n")
    line = ("simulate", "m.yaml", "--plant", "plant")
    assert run(capsys, *line, "--bag", "m.mcap", "--json").document["bag"] == "m.mcap"
    assert len(read_log(tmp_path / "m.mcap", ReadOptions(map=TRACKS)).y) > 20
    refused = run(capsys, *line, "--bag", "m.mcap", "--runs", "2")
    assert refused.code == 2
    (tmp_path / "there").mkdir()
    assert "exists already" in run(capsys, *line, "--bag", "there").err


def test_inspect_lists_a_bag_and_its_line_reads_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    Robot(length=6.0).write(tmp_path / "run.mcap")
    found = run(capsys, "inspect", "run.mcap", "--json").document
    assert {t["name"]: t["count"] for t in found["topics"]} == {
        "/cmd_drive": 60, "/imu/data": 60, "/joint_states": 300,
    }  # fmt: skip
    wheels = found["topics"][2]["fields"]
    assert [f["path"] for f in wheels if f["moves"]] == ["velocity[wheel_right]",
                                                         "velocity[wheel_left]"]  # fmt: skip
    assert set(found["proposal"]["map"].values()) == set(MAP.values())
    words = shlex.split(found["proposal"]["command"])
    assert words[:2] == ["sysid", "fit"]
    record = run(capsys, "inspect", *words[2:], "--json").document["records"][0]
    roles = {c["name"]: c["role"] for c in record["channels"]}
    assert roles == {"cmd_0": "input", "cmd_1": "input", "omega_l": "output", "omega_r": "output"}
    assert "lists its topics" in (unmapped := run(capsys, "fit", "run.mcap")).err
    assert unmapped.code == 2
    assert "--map 'omega_l=/joint_states.velocity[wheel_left]'" in unmapped.err


def shuffled(make: Messages) -> list[Outgoing]:
    """Readings whose messages overtake one another, some of them twice."""
    kind, read = "std_msgs/msg/Float64", "geometry_msgs/msg/PointStamped"
    point = "geometry_msgs/msg/Point"
    found = []
    for k in range(60):
        t = EPOCH + k * 10**8
        found.append(Outgoing("/u", kind, t, make.make(kind, data=float(k // 5 % 2))))
        late = 1.5e8 if k % 10 == 3 else 0.1e8
        y = make.make(read, header=make.header(t, ""), point=make.make(point, x=0.5 * k))
        found.append(Outgoing("/y", read, t + int(late), y))
        if k == 20:
            found.append(Outgoing("/y", read, t + int(late) + 1, y))
    return found


def test_disorder_and_doubled_messages_are_mended_and_said(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "s.mcap", shuffled)
    log = read_file(path, ReadOptions(map={"u": "/u", "y": "/y.point.x"}))
    assert log.records[0].y[:, 0] == pytest.approx(0.5 * np.arange(60.0))
    said = " ".join(log.notes)
    assert "6 messages were out of order" in said
    assert "1 message was stamped like the next one" in said
    assert "by header.stamp (10 ms before receipt)" in said
    by_receipt = read_log(path, ReadOptions(map={"u": "/u", "y": "/y.point.x"}, stamps="received"))
    assert not np.array_equal(by_receipt.y, log.records[0].y)
    with pytest.raises(DataError, match="/u: the messages have no stamp"):
        read_file(path, ReadOptions(map={"u": "/u", "y": "/y.point.x"}, stamps="header"))


def test_a_simulation_that_starts_again_is_two_experiments(
    driven: tuple[Mission, MissionResult], tmp_path: Path
) -> None:
    """The recorder's clock goes on and runs at another speed; the times are the simulation's."""
    _, result = driven

    def twice(make: Messages) -> list[Outgoing]:
        from sysid.data.bags.writing import _messages

        once = list(_messages(result.log, make))
        later = 2 * once[-1].received + 3 * 10**9
        slow = [replaced(m, 2 * m.received + EPOCH) for m in once]
        return [*slow, *(replaced(m, 2 * m.received + later + EPOCH) for m in once)]

    path = write_bag(tmp_path / "two.bag", twice)
    with pytest.raises(DataError, match="starts again 1 times; `resample='split'`"):
        read_file(path, ReadOptions(map=TRACKS))
    runs = read_file(path, ReadOptions(map=TRACKS, resample="split")).records
    assert [len(r) for r in runs] == [len(result.log["t"])] * 2
    assert runs[0].dt == pytest.approx(0.1)
    np.testing.assert_allclose(runs[1].y[:, 0], result.log["omega_l"], atol=1e-9)


def replaced(message: Outgoing, received: int) -> Outgoing:
    return message._replace(received=received)


def test_a_gap_is_a_gap(tmp_path: Path) -> None:
    robot = Robot(length=8.0, gyro=Sender(1.0))

    def broken(make: Messages) -> list[Outgoing]:
        return [m for m in robot.messages(make) if not (m.topic == "/joint_states" and
                3.0 < (m.received - EPOCH) / 1e9 < 4.5)]  # fmt: skip

    path = write_bag(tmp_path / "gap.mcap", broken)
    with pytest.raises(DataError, match="without samples"):
        read_file(path, ReadOptions(map=MAP, resample="refuse"))
    assert len(read_file(path, ReadOptions(map=MAP)).records) == 2


def test_frames_that_are_not_those_of_ros_are_said(tmp_path: Path) -> None:
    def circle(make: Messages, sense: float, world: bool) -> list[Outgoing]:
        kind, found = "nav_msgs/msg/Odometry", []
        for k in range(300):
            t, psi = k * 0.05, 0.3 * k * 0.05
            speed = np.cos(psi) if world else 1.0
            turn = make.make("geometry_msgs/msg/Quaternion", z=np.sin(0.5 * sense * psi),
                             w=np.cos(0.5 * sense * psi))  # fmt: skip
            at = make.make("geometry_msgs/msg/Point", x=np.sin(psi) / 0.3,
                           y=(1.0 - np.cos(psi)) / 0.3)  # fmt: skip
            pose = make.make("geometry_msgs/msg/Pose", position=at, orientation=turn)
            linear = make.make("geometry_msgs/msg/Vector3", x=speed + 1e-6 * k)
            twist = make.make("geometry_msgs/msg/Twist", linear=linear)
            stamp = EPOCH + round(t * 1e9)
            both = (make.make("geometry_msgs/msg/PoseWithCovariance", pose=pose),
                    make.make("geometry_msgs/msg/TwistWithCovariance", twist=twist))  # fmt: skip
            found.append(Outgoing("/odom", kind, stamp, make.make(
                kind, header=make.header(stamp, "odom"), child_frame_id="base_link", pose=both[0],
                twist=both[1])))  # fmt: skip
        return found

    mapping = {"pose": "/odom", "v": "/odom.twist.twist.linear.x"}
    options = ReadOptions(map=mapping, inputs=("none",), outputs=("v",))
    for sense, world, words in (
        (1.0, False, ""), (-1.0, False, "counts clockwise"), (1.0, True, "is expressed in odom"),
    ):  # fmt: skip
        path = write_bag(tmp_path / f"{sense}{world}.mcap",
                         lambda make, s=sense, w=world: circle(make, s, w))  # fmt: skip
        said = [f.text for f in read_file(path, options).findings if f.code == "bag"]
        warned = [t for t in said if "by the path driven" in t]
        assert bool(warned) == bool(words)
        assert all(words in t for t in warned)


def test_latency_is_asked_for_by_topic(tmp_path: Path) -> None:
    robot = replace(Robot(length=6.0), wheels=Sender(0.02, way=0.04, stamped=False))
    path = robot.write(tmp_path / "late.mcap")
    given = read_log(path, ReadOptions(map=MAP, latency=("/joint_states=0.04",)))
    true = Robot(length=6.0).write(tmp_path / "true.mcap")
    np.testing.assert_allclose(given.y[1:-1], read_log(true, ReadOptions(map=MAP)).y[1:-1],
                               atol=1e-6)  # fmt: skip
    for wrong, words in (("soon", "cannot read"), ("/imu=0.1", "which is not mapped")):
        with pytest.raises(UsageError, match=words):
            read_log(path, ReadOptions(map=MAP, latency=(wrong,)))
