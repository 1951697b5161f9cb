"""Following a path: close to it, in its order, to its end."""

import math
from itertools import pairwise

import numpy as np
import pytest
from mission_cases import Robot, goal

from sysid.robot.mission.clearance import distance_to_segment
from sysid.robot.mission.contracts import Body, GuidanceInputs, Pose
from sysid.robot.mission.guidance.pure_pursuit import OnCourse, PurePursuit
from sysid.robot.mission.result import MissionResult, Outcome
from sysid.robot.mission.simulator import simulate
from sysid.runners import floats

KIND = {"kind": "pure-pursuit"}
CIRCLE = [(math.sin(a), 1 - math.cos(a)) for a in np.linspace(0, 2 * math.pi, 41)[1:].tolist()]


def off_the_line(result: MissionResult, line: list[tuple[float, float]]) -> float:
    places = zip(result.log["x"].tolist(), result.log["y"].tolist(), strict=True)
    return max(min(distance_to_segment(p, a, b, floats) for a, b in pairwise(line)) for p in places)


def test_a_circle_is_driven_all_around_before_the_goal_counts() -> None:
    result = simulate(goal(0, 0, path=CIRCLE, guidance=KIND), Robot())
    assert result.outcome is Outcome.ARRIVED
    assert result.path_length_m == pytest.approx(2 * math.pi, rel=0.07)
    # The chord of the lookahead lies L²/8R = 1 cm inside; the tracks differ by 20 %.
    assert off_the_line(result, [(0.0, 0.0), *CIRCLE]) < 0.08


def test_without_a_path_it_keeps_to_the_straight_line() -> None:
    result = simulate(goal(4, 0, start=(0, 0, 0.6), guidance=KIND), Robot(difference=0.0))
    assert result.outcome is Outcome.ARRIVED
    assert abs(result.log["y"][result.log["x"] > 1.5]).max() < 0.02


def test_it_heads_for_the_point_ahead() -> None:
    law, scene = PurePursuit(lookahead=0.5), goal(2, 0, path=[(1.0, 0.0), (1.0, 1.0)]).scene()
    seen = GuidanceInputs(0.0, Body(Pose(0.7, 0.1, 0.0), 0.0, 0.0), scene)
    state, wanted = law.step(OnCourse(0.6, 0.0, 0.0), seen, 0.1, floats)
    assert state.done == pytest.approx(0.7)
    # 0.5 m on from (0.7, 0) along the course: 0.3 m to the corner and 0.2 m up.
    assert wanted.psi == pytest.approx(math.atan2(0.2 - 0.1, 1.0 - 0.7))


def test_waypoints_of_a_law_that_follows_lines_are_passed() -> None:
    result = simulate(goal(2, 0, waypoints=[(1.0, 1.0)], guidance=KIND), Robot())
    assert result.outcome is Outcome.ARRIVED
    assert np.hypot(result.log["x"] - 1, result.log["y"] - 1).min() < 0.1 + 0.03
