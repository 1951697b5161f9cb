"""Mission 1 of the thesis through two nodes of ROS 1, and what is said where one is missing."""

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from command_line import Capture, run
from plant_models import robot_model
from ros_core import ros_core, ros_or_skip

from sysid.export.package import write_package

Steps = list[dict[str, Any]]


def start(name: str, *arguments: object) -> dict[str, Any]:
    return {"name": name, "start": [str(a) for a in arguments]}


def end(name: str) -> dict[str, Any]:
    return {"name": name}


@pytest.fixture(scope="module")
def ready(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with mission 1 and a workspace with a plant."""
    folder = tmp_path_factory.mktemp("mission")
    (folder / "mission.yaml").write_text("goal: [1, 0]\n")
    write_package(robot_model(), folder / "w" / "plant", formats=["json"])
    return folder


def commands(steps: Steps, environment: dict[str, str]) -> dict[str, dict[str, Any]]:
    """What each command left: exit code, stdout, stderr."""
    script = Path(__file__).with_name("forked_commands.py")
    done = subprocess.run(
        [sys.executable, str(script)],
        input=json.dumps(steps),
        env=environment,
        capture_output=True,
        text=True,
        timeout=180.0,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    collected: dict[str, dict[str, Any]] = json.loads(done.stdout)
    return collected


@pytest.mark.slow
def test_two_nodes_in_lock_step_and_what_is_said_when_one_ends(
    ready: Path, capsys: Capture
) -> None:
    ros_or_skip()
    common = (ready / "mission.yaml", "--workspace", ready / "w", "--json")
    alone = run(capsys, "simulate", *common).document
    guided, driven = ready / "guided.csv", ready / "driven.csv"
    steps = [
        start("guide", "simulate", *common, "--ros", "-o", guided),
        start("robot", "node", *common, "--lock-step", "-o", driven),
        end("robot"),
        end("guide"),
        # a robot that is killed on its way, while a second one asks to be let in
        start("slow", "node", *common, "--pace", 0.01, "-o", ready / "a.csv"),
        start("left", "simulate", *common, "--ros", "-o", ready / "b.csv"),
        {"name": "left", "meets": "/simulink_references"},
        start("second", "node", *common, "-o", ready / "c.csv"),
        end("second"),
        {"name": "slow", "signal": int(signal.SIGKILL)},
        end("slow"),
        end("left"),
        # another kind of topic, and a person who has waited long enough
        start("wrong", "simulate", *common, "--ros", "--topic", "/rosout"),
        end("wrong"),
        start("waits", "node", *common),
        {"name": "waits", "meets": "/odom"},
        {"name": "waits", "signal": int(signal.SIGINT)},
        end("waits"),
    ]
    with ros_core(ready / "ros") as environment:
        result = commands(steps, environment)
    for name, log in (("guide", guided), ("robot", driven)):
        assert result[name]["code"] == 0, result[name]["err"]
        shown = json.loads(result[name]["out"])
        assert shown.keys() == alone.keys() - ({"page"} if name == "robot" else set())
        assert (shown["outcome"], shown["time_s"]) == (alone["outcome"], alone["time_s"])
        for figure in ("path_length_m", "max_deviation_m"):
            assert shown[figure] == pytest.approx(alone[figure], abs=1e-6)
        assert shown["final"] == pytest.approx(alone["final"], abs=1e-6)
        assert len(log.read_text().splitlines()) == len(Path(alone["log"]).read_text().splitlines())
    for name, code, words in (
        ("second", 1, "and only one robot may"),
        ("left", 1, "the robot left, and no node publishes /odom any more"),
        ("wrong", 1, "is of type rosgraph_msgs/Log and geometry_msgs/Twist is needed"),
        ("waits", 130, ""),
    ):
        assert (result[name]["code"], result[name]["out"]) == (code, ""), result[name]
        assert words in " ".join(result[name]["err"].split())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "m.yaml", "--topic", "/a"), "--topic belongs to --ros"),
        (("node", "m.yaml", "--topic-level", "x"), "choose references or pwm"),
        (("node", "m.yaml", "--topic", "a b"), "is not a topic name"),
        (("node", "m.yaml", "--wait", "0"), "give a number above 0"),
        (("node", "m.yaml", "--pace", "-1"), "give a number above 0"),
        (("simulate", "log.csv", "--ros"), "is a log to replay; omit --ros"),
        (("simulate", "m.yaml", "--ros", "--runs", "5"), "--runs does not apply with --ros"),
    ],
)
def test_wrong_use(ready: Path, capsys: Capture, arguments: tuple[str, ...], words: str) -> None:
    files = {"m.yaml": ready / "mission.yaml", "log.csv": ready / "log.csv"}
    line = [str(files.get(a, a)) for a in arguments]
    result = run(capsys, *line, "--workspace", ready / "w")
    assert (result.code, result.out) == (2, "")
    assert words in " ".join(result.err.split())
