"""``--format ros``: a catkin package whose nodes compile, and what cannot be one."""

import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
from mission_cases import goal
from plant_models import robot_model

from sysid.errors import ModelError
from sysid.export.package import Form, package_files, write_package

HEADERS = Path("/usr/include/ros/ros.h")
COMPILER = shutil.which("g++") or shutil.which("clang++")


@pytest.fixture(scope="module")
def ros(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("ros") / "plant"
    write_package(robot_model(), place, formats=["json", "ros"], form=Form(goal(1, 0), True))
    return place / "ros"


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


@pytest.mark.skipif(COMPILER is None, reason="no C++ compiler here")
@pytest.mark.skipif(not HEADERS.is_file(), reason="libroscpp-dev is not installed")
@pytest.mark.parametrize("node", ["guidance_node", "robot_node"])
def test_the_nodes_are_correct_for_a_compiler(ros: Path, node: str) -> None:
    """Built and driven by hand: benchmarks/study_ros.py."""
    flags = [
        "-std=c++14",
        "-fsyntax-only",
        "-Wall",
        "-Wextra",
        "-Werror",
    ]
    done = subprocess.run(
        [str(COMPILER), *flags, f"-I{ros / 'src/laws'}", str(ros / f"src/{node}.cpp")],
        capture_output=True,
        text=True,
        timeout=120.0,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_what_cannot_be_two_nodes() -> None:
    with pytest.raises(ModelError, match="name the mission that it drives"):
        package_files(robot_model(), name="p", formats=["ros"])
    noisy = goal(1, 0, sensors={"gyroscope": {}})
    with pytest.raises(ModelError, match="nodes in C\\+\\+: has sensors with noise"):
        package_files(robot_model(), name="p", formats=["ros"], form=Form(noisy, True))
