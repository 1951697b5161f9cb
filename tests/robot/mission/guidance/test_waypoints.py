"""Waypoints are passed in their order by every law, and a mission has the time that it needs."""

import re
from pathlib import Path

import numpy as np
import pytest
from mission_cases import Robot, check_law, goal

from sysid.errors import DataError
from sysid.robot.mission.guidance.around_law import PassingWaypoints
from sysid.robot.mission.guidance.field import PotentialField
from sysid.robot.mission.result import MissionResult, Outcome
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import load_mission

WAY = [(1.0, 1.0), (2.0, 0.0), (1.0, -1.0)]


def passed_at(result: MissionResult, place: tuple[float, float], tolerance: float = 0.1) -> float:
    """The instant at which the robot first was at a place."""
    near = np.hypot(result.log["x"] - place[0], result.log["y"] - place[1]) <= tolerance
    assert near.any(), f"never at {place}"
    return float(result.log["t"][near][0])


def test_waypoints_are_passed_in_their_order() -> None:
    """The third leg turns right round; the goal, passed early on, counts only at the end."""
    result = simulate(goal(0.5, 0.5, waypoints=WAY), Robot())
    assert result.outcome is Outcome.ARRIVED
    # At a control instant it may have come a sample's way past the place where that counts.
    times = [passed_at(result, place, 0.1 + 0.03) for place in WAY]
    assert times == sorted(times)
    assert result.time_s > times[-1]
    assert result.final.x == pytest.approx(0.5, abs=0.11)


def test_a_way_without_waypoints_is_the_law_itself() -> None:
    assert goal(1, 0).complete_guidance == PotentialField()


def test_the_law_of_waypoints_fulfils_the_contract() -> None:
    check_law("guidance", PassingWaypoints(PotentialField()))


def test_the_way_to_go_is_that_of_all_legs() -> None:
    mission = goal(0.5, 0.5, waypoints=WAY)
    law, scene = mission.complete_guidance, mission.scene()
    state = law.start(scene, np)
    legs = 3 * np.sqrt(2.0) + np.hypot(0.5, 1.5)
    assert law.to_go(state, scene.start, scene, np) == pytest.approx(legs)


BAD = {
    "no time": (
        "goal: [5, 0]\ntimeout: 3\n",
        r"m.yaml:2: timeout is 3 s, but the way of 4.9 m takes 16.3 s at the largest speed of 0.3",
    ),
    "no time for the way": (
        "goal: [0.5, 0]\nwaypoints: [[3, 0]]\ntimeout: 12\n",
        r"m.yaml:3: timeout is 12 s, but the way of 5.2 m takes",
    ),
    "two ways": (
        "goal: [1, 0]\npath: [[0.5, 0]]\nwaypoints: [[0.5, 0]]\n",
        "m.yaml:3: a path leads past its own points: keep one of them",
    ),
}


@pytest.mark.parametrize(("text", "words"), BAD.values(), ids=BAD)
def test_a_way_that_cannot_be_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(text)
    with pytest.raises(DataError) as caught:
        load_mission(path)
    assert re.search(words, str(caught.value)), caught.value


def test_a_path_is_for_laws_that_follow_one() -> None:
    mission = goal(2, 0, path=[(1.0, 1.0)])
    with pytest.raises(DataError, match="pure-pursuit"):
        simulate(mission, Robot())
