"""Mission files: what is read, and one sentence with its line for everything that is not."""

import re
from pathlib import Path

import pytest
from pydantic import ValidationError

from sysid.errors import DataError
from sysid.robot.mission.spec import Mission, Obstacle, load_mission


def write(folder: Path, content: str | bytes) -> Path:
    path = folder / "m.yaml"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def test_only_the_goal_is_required_and_defaults_are_the_published_ones(tmp_path: Path) -> None:
    mission = load_mission(write(tmp_path, "goal: [1, 0]\n"))
    assert mission == Mission(goal=(1.0, 0.0))
    assert mission.start == (0.0, 0.0, 0.0)
    assert (mission.tolerance, mission.timeout, mission.obstacles) == (0.10, 120.0, ())
    g, c, v = mission.guidance, mission.control, mission.vehicle
    assert (g.K, g.d, g.rho0, g.eta, g.v_max) == (0.15, 2.0, 0.7, 0.05, 0.3)
    assert (g.theta, g.h, g.Kg, g.Ki) == (2.0, 1.0, 0.4, 1.0)
    assert (c.kp_speed, c.ki_speed, c.kp_yaw, c.period) == (2.0, 1.85, 0.4, 0.1)
    assert (c.v_cmd_min, c.v_cmd_max, c.psi_cmd_max) == (0.0, 1.0, 0.3)
    assert (v.r, v.B, v.command_scale, v.speed_scale) == (0.0215, 0.186, None, None)
    assert Obstacle(x=1.0, y=2.0).radius == 0.15


def test_everything_that_can_be_said_is_read(tmp_path: Path) -> None:
    mission = load_mission(
        write(
            tmp_path,
            """\
            # a comment
            goal: [6, 3.5]
            start: [1, -2, 0.5]
            obstacles:
              - [2, 3.5]
              - [3, 1, 0.2]
              - {at: [4, 2.5]}
              - at: [5, 3]
                radius: 0.25
            tolerance: 1e-1      # YAML 1.1 would read this as text
            timeout: 60
            guidance: {theta: 1, Kg: 0.3, h: 2}
            control:
              kp_yaw: .3
              period: 5e-2
            vehicle: {r: 0.03, B: 0.2, command_scale: 12, speed_scale: 0.1047}
            """,
        )
    )
    assert mission.goal == (6.0, 3.5)
    assert mission.start == (1.0, -2.0, 0.5)
    assert [(o.x, o.y, o.radius) for o in mission.obstacles] == [
        (2, 3.5, 0.15),
        (3, 1, 0.2),
        (4, 2.5, 0.15),
        (5, 3, 0.25),
    ]
    assert (mission.tolerance, mission.timeout) == (0.1, 60.0)
    assert (mission.guidance.theta, mission.guidance.Kg, mission.guidance.h) == (1, 0.3, 2)
    assert (mission.control.kp_yaw, mission.control.period) == (0.3, 0.05)
    assert (mission.vehicle.geometry.r, mission.vehicle.geometry.B) == (0.03, 0.2)
    assert (mission.vehicle.command_scale, mission.vehicle.speed_scale) == (12.0, 0.1047)


@pytest.mark.parametrize(
    "text",
    ["goal: [1, 0]\nobstacles:\nguidance:\n", "\ufeffgoal: [1, 0]\r\n", "{goal: [1.0, 0]}"],
    ids=["empty sections", "BOM and CRLF", "flow style"],
)
def test_harmless_variations_are_read(tmp_path: Path, text: str) -> None:
    assert load_mission(write(tmp_path, text)).goal == (1.0, 0.0)


def test_a_start_without_heading_faces_along_x(tmp_path: Path) -> None:
    assert load_mission(write(tmp_path, "goal: [1, 0]\nstart: [1, 2]\n")).start == (1.0, 2.0, 0.0)


G = "goal: [1, 0]\n"
BAD = {
    "empty": ("", 1, "the file is empty"),
    "only a comment": ("# nothing\n", 1, "the file is empty"),
    "list": ("- 1\n", 1, "not a mapping"),
    "word": ("goal\n", 1, "not a mapping"),
    "no goal": ("tolerance: 1\n", 1, "'goal' is missing"),
    "goal as text": ("goal: 1, 0\n", 1, r"goal is the text '1, 0': write goal: \[x, y\]"),
    "goal empty": ("goal:\n", 1, "goal is empty"),
    "goal of one number": ("goal: [1]\n", 1, "goal has 1 numbers"),
    "goal of three numbers": ("goal: [1, 0, 0]\n", 1, "goal has 3 numbers"),
    "goal with a word": ("goal: [1, a]\n", 1, r"goal\[2\] is the text 'a'"),
    "goal with a boolean": ("goal: [1, yes]\n", 1, r"goal\[2\] is True"),
    "goal NaN": ("goal: [1, .nan]\n", 1, "finite"),
    "goal infinite": ("goal: [1, -.inf]\n", 1, "finite"),
    "goal overflowing": ("goal: [1, 1e400]\n", 1, "finite"),
    "goal absurd": ("goal: [1e9, 0]\n", 1, "at most 1e[+]06"),
    "goal hexadecimal": ("goal: [0x10, 0]\n", 1, "text '0x10'"),
    "goal base 60": ("goal: [1:30, 0]\n", 1, "text '1:30'"),
    "start of one number": (G + "start: [0]\n", 2, "start has 1 numbers"),
    "start in degrees": (G + "start: [0, 0, 90]\n", 2, "radians, e.g. 1.571"),
    "start with null": (G + "start: [0, 0, null]\n", 2, r"start\[3\] is empty"),
    "start an impossible date": (G + "start: 2024-13-45\n", 2, "text '2024-13-45'"),
    "key twice": (G + "goal: [2, 0]\n", 2, "second time, first in line 1"),
    "key twice in a section": (
        G + "guidance:\n  K: 1\n  d: 1\n  K: 2\n",
        5,
        "second time, first in line 3",
    ),
    "misspelt goal": ("gaol: [1, 0]\n", 1, "did you mean 'goal'"),
    "wrong case": ("Goal: [1, 0]\n", 1, "did you mean 'goal'"),
    "misspelt key": (G + "\ntolerence: 0.1\n", 3, "did you mean 'tolerance'"),
    "foreign key": (G + "colour: red\n", 2, "the keys are goal, start, obstacles"),
    "number as key": (G + "1: 2\n", 2, "unknown key '1'"),
    "list as key": ("? [a]\n: 1\n", 1, "a key must be a word"),
    "merge key": ("<<: {goal: [1, 0]}\n", 1, "unknown key '<<'"),
    "tolerance zero": (G + "tolerance: 0\n", 2, "tolerance is 0: give a number above 0"),
    "tolerance negative": (G + "tolerance: -1\n", 2, "tolerance is -1"),
    "tolerance quoted": (G + "tolerance: '0.1'\n", 2, "text '0.1'"),
    "tolerance boolean": (G + "tolerance: on\n", 2, "True"),
    "tolerance with a comma": (G + "tolerance: 0,1\n", 2, "text '0,1'"),
    "timeout zero": (G + "timeout: 0\n", 2, "timeout is 0: give a number above 0"),
    "timeout too long": (G + "timeout: 1e9\n", 2, "at most 86400"),
    "start inside an obstacle": (
        G + "obstacles: [[0.1, 0]]\n",
        1,
        r"the start \(0, 0\) lies inside the obstacle",
    ),
    "goal inside an obstacle": (
        "goal: [3, 1]\nobstacles: [[5, 5], [3, 1.1, 0.2]]\n",
        1,
        r"the goal \(3, 1\) lies inside the obstacle at \(3, 1.1\) of radius 0.2 m",
    ),
    "obstacles a number": (G + "obstacles: 5\n", 2, "must be a list"),
    "obstacles one bare point": (G + "obstacles: [1, 2]\n", 2, "1 is not an obstacle"),
    "obstacle of one number": (G + "obstacles: [[1]]\n", 2, "an obstacle has 1 numbers"),
    "obstacle radius negative": (
        G + "obstacles:\n  - [1, 2]\n  - [1, 2, -3]\n",
        4,
        r"obstacles\[2\].radius is -3: give a number above 0",
    ),
    "obstacle key misspelt": (
        G + "obstacles:\n  - at: [1, 2]\n    radus: 1\n",
        4,
        r"'radus' in obstacles\[1\]: did you mean 'radius'",
    ),
    "obstacle without position": (G + "obstacles: [{radius: 1}]\n", 2, "one position"),
    "obstacle with two positions": (G + "obstacles: [{at: [1, 2], x: 3}]\n", 2, "one position"),
    "obstacle at a word": (G + "obstacles: [{at: here}]\n", 2, "at is the text 'here'"),
    "section a number": (G + "guidance: 5\n", 2, "write a section"),
    "section a list": (G + "vehicle: [1, 2]\n", 2, "write a section"),
    "guidance key": (G + "guidance: {rho: 1}\n", 2, "'rho' in guidance: did you mean 'rho0'"),
    "guidance theta": (G + "guidance:\n  K: 1\n  theta: 0\n", 4, "guidance.theta is 0"),
    "guidance h": (G + "guidance: {h: 11}\n", 2, "guidance.h is 11: give a number of at most 10"),
    "guidance eta": (G + "guidance: {eta: -1}\n", 2, "of at least 0"),
    "control key": (G + "control: {kp: 1}\n", 2, "kp_speed, ki_speed, kp_yaw"),
    "control limit": (G + "control: {v_cmd_max: 2}\n", 2, "of at most 1"),
    "control period": (G + "control: {period: 0}\n", 2, "control.period is 0"),
    "vehicle radius": (G + "vehicle: {r: 0}\n", 2, "vehicle.r is 0: give a number above 0"),
    "vehicle scale": (G + "vehicle: {command_scale: 0}\n", 2, "command_scale is 0"),
    "two problems": (G + "tolerance: -1\ntimeout: -1\n", 2, r"\(more to correct in line 3\)"),
    "open bracket": ("goal: [1, 0\ntolerance: 1\n", 2, "check the brackets"),
    "open quote": ("goal: 'abc\n", 2, "check the brackets"),
    "surplus bracket": ("goal: [1, 0]}\n", 1, "check the brackets"),
    "two colons": ("a: b: c\n", 1, "mapping values are not allowed"),
    "tab": (G + "\ttolerance: 1\n", 2, "a tab"),
    "two documents": (G + "---\ngoal: [2, 0]\n", 2, "second document"),
    "alias": ("goal: &a [1, 0]\nstart: *a\n", 1, "anchors and aliases"),
    "tag": ("goal: !!python/object/apply:os.getcwd []\n", 1, "the tag"),
    "nested too deep": ("goal: " + "[" * 5000 + "]" * 5000 + "\n", 1, "nested too deep"),
    "bad directive": ("%YAML 3\n", 1, "check the brackets"),
    "control characters": (b"goal\x00\x01\x02", 1, "control characters"),
}


@pytest.mark.parametrize(("text", "line", "words"), BAD.values(), ids=BAD)
def test_a_bad_file_gets_one_sentence_with_its_line(
    tmp_path: Path, text: str | bytes, line: int, words: str
) -> None:
    with pytest.raises(DataError) as caught:
        load_mission(write(tmp_path, text))
    message = str(caught.value)
    assert message.startswith(f"m.yaml:{line}: ")
    assert re.search(words, message), message
    assert "\n" not in message
    assert len(message) < 250
    assert caught.value.__cause__ is None
    assert caught.value.exit_code == 1


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\xff\xfeg\x00", "not a text file"),
        (b"\x89PNG\r\n\x1a\n", "not a text file"),
        (b"x" * 100_001, "larger than 100 kB"),
    ],
)
def test_what_is_no_text_is_refused(tmp_path: Path, content: bytes, words: str) -> None:
    with pytest.raises(DataError, match=words):
        load_mission(write(tmp_path, content))


def test_what_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="file not found"):
        load_mission(tmp_path / "nowhere.yaml")
    with pytest.raises(DataError, match="is a folder"):
        load_mission(tmp_path)
    with pytest.raises(DataError, match="cannot be read"):
        load_mission(write(tmp_path, G) / "below")
    with pytest.raises(DataError, match="cannot be read"):
        load_mission("a\0b")


def test_a_mission_cannot_be_changed_and_is_checked_in_code_too() -> None:
    mission = Mission(goal=(1.0, 0.0))
    with pytest.raises(ValidationError, match="frozen"):
        mission.tolerance = 1.0  # type: ignore[misc]
    with pytest.raises(ValidationError, match="greater than or equal"):
        Mission(goal=(1.0, 0.0), tolerance=-1.0)
    assert mission.model_copy(update={"tolerance": 0.2}).tolerance == 0.2
