"""``--format ros``: a catkin package whose nodes drive and launch, and what cannot be one."""

import re
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xmlrpc.client import ServerProxy

import pytest
from mission_cases import goal
from plant_models import robot_model

from sysid.errors import ModelError
from sysid.export.package import Form, package_files, write_package
from sysid.export.verification import ros_nodes
from sysid.export.verification.ros_nodes import DRIVE, RosNodes, built, own_master, running

needs_ros = pytest.mark.skipif(bool(ros_nodes.lacks()), reason=f"ROS 1: {ros_nodes.lacks()}")


@pytest.fixture(scope="module")
def ros(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("ros") / "plant"
    write_package(robot_model(), place, formats=["json", "ros"], form=Form(goal(1, 0), True))
    return place / "ros"


@pytest.fixture(scope="module")
def nodes(ros: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(ros, tmp_path_factory.mktemp("catkin"))


def test_the_package_is_whole(ros: Path) -> None:
    name = ElementTree.parse(ros / "package.xml").findtext("name")
    assert name is not None
    assert re.fullmatch(r"[a-z][a-z0-9_]*", name)
    build = (ros / "CMakeLists.txt").read_text()
    assert f"project({name} C CXX)" in build
    named = re.findall(r"src/laws/\w+\.c", build)
    assert {p.name for p in (ros / "src/laws").glob("*.c")} == {Path(n).name for n in named}
    launched = ElementTree.parse(ros / "launch/mission.launch").findall("node")
    for node in launched:
        assert node.get("pkg") == name
        assert (ros / f"src/{node.get('type')}.cpp").is_file()
    for text in (p.read_text() for p in ros.rglob("*") if p.is_file()):
        assert "$package" not in text
    assert 'own.param("guidance/goal_x"' in (ros / "src/guidance_node.cpp").read_text()
    assert 'own.param("control/kp_yaw"' in (ros / "src/robot_node.cpp").read_text()


@needs_ros
def test_verify_builds_the_nodes_and_they_drive_as_python_does(
    ros: Path, nodes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The compiler takes every warning for an error."""
    monkeypatch.setattr(ros_nodes, "built", lambda package, build: nodes)
    files = {DRIVE: (ros / "drive.csv").read_bytes()}
    replay_result = RosNodes().replay(ros.parent, files)
    assert (replay_result.failed, replay_result.skipped, replay_result.passed) == ("", "", True)
    assert replay_result.max_error is not None
    assert replay_result.max_error < 1e-9
    shorter = {DRIVE: b"\n".join(files[DRIVE].splitlines()[:20])}
    assert "Python drives 19" in RosNodes().replay(ros.parent, shorter).failed
    assert "no nodes of ROS" in RosNodes().replay(ros.parent, {}).skipped


def test_verify_says_what_of_ros_is_not_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros_nodes, "COMMANDS", ("no-such-rosmaster",))
    assert RosNodes().replay(tmp_path, {}).skipped == "no-such-rosmaster is not installed"


@needs_ros
@pytest.mark.skipif(shutil.which("roslaunch") is None, reason="roslaunch is not installed")
def test_launched_nodes_talk_and_leave_on_a_signal(ros: Path, nodes: Path, tmp_path: Path) -> None:
    """In real time; the launch is ended as a terminal or an init system ends it."""
    devel, name = nodes.parents[1], nodes.name
    with own_master(tmp_path) as environment, ServerProxy(environment["ROS_MASTER_URI"]) as master:
        ours = {
            "CMAKE_PREFIX_PATH": f"{devel}:/usr",
            "ROS_PACKAGE_PATH": f"{ros}:/usr/share",
            "ROS_LOG_DIR": str(tmp_path),
        }

        def publishers() -> dict[str, list[str]]:
            system_state: Any = master.getSystemState("/test")
            return dict(system_state[2][0])

        def until(holds: Callable[[], bool]) -> None:
            last = time.monotonic() + 60.0
            while not holds():
                assert time.monotonic() < last
                time.sleep(0.1)

        for number in (signal.SIGTERM, signal.SIGINT):
            log = tmp_path / f"{number}.csv"
            command = ["roslaunch", name, "mission.launch", f"log:={log}"]
            with running(command, tmp_path, {**environment, **ours}) as launched:
                until(lambda: "/guidance" in publishers().get("/simulink_references", []))
                until(lambda: "/robot" in publishers().get("/odom", []))
                # a row of the log is an answer to /odom: the references flow
                until(lambda log=log: log.is_file() and log.stat().st_size > 0)
                launched.send_signal(number)
                assert launched.wait(60.0) == 0
            left = {node for every in publishers().values() for node in every}
            assert left <= {"/rosout"}


def test_what_cannot_be_two_nodes() -> None:
    with pytest.raises(ModelError, match="needs a mission"):
        package_files(robot_model(), name="p", formats=["ros"])
    noisy = goal(1, 0, sensors={"gyroscope": {}})
    with pytest.raises(ModelError, match="nodes in C\\+\\+: has sensors with noise"):
        package_files(robot_model(), name="p", formats=["ros"], form=Form(noisy, True))
