"""Walls, polygons and moving obstacles: read, kept clear of, collided with between samples too."""

import math
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mission_cases import Robot, goal

from sysid.errors import DataError
from sysid.robot.mission.clearance import (
    distance_between_segments,
    distance_to_segment,
    nearest_point,
    step_clearance,
)
from sysid.robot.mission.contracts import Disc, Pose, Wall
from sysid.robot.mission.result import Outcome
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import load_mission
from sysid.runners import floats
from sysid.vehicle.floor import Polygon

BLIND = {"eta": 0, "Ki": 0}
"""A field that obstacles do not act on: it drives straight at the goal."""

NUMBER = st.floats(-3, 3)
POINT = st.tuples(NUMBER, NUMBER)


def write(folder: Path, text: str) -> Path:
    path = folder / "m.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_everything_around_is_read(tmp_path: Path) -> None:
    text = """\
        goal: [4, 2]
        obstacles: [[2, 3.5], {at: [3, 1], radius: 0.2, velocity: [0, -0.1]}]
        walls: [[[1, 1], [2, 1], [2, 2]]]
        polygons: [[[2.5, -0.5], [3.5, -0.5], [3, 0.4]]]
        waypoints: [[1, 0.2], [2.6, 1]]
        """
    scene = load_mission(write(tmp_path, text)).scene()
    assert scene.obstacles[1] == Disc(3, 1, 0.2, 0, -0.1)
    assert scene.obstacles[1].at(5.0)[:2] == (3, 0.5)
    corners = (2.5, -0.5), (3.5, -0.5), (3.0, 0.4)
    assert scene.walls == (Wall(((1, 1), (2, 1), (2, 2))), Wall((*corners, corners[0])))
    assert scene.way == ((1, 0.2), (2.6, 1))


G = "goal: [1, 0]\n"
BAD = {
    "walls a number": (G + "walls: 5\n", 2, r"walls is 5: write walls: \[\[\[x, y\]"),
    "walls one line": (G + "walls: [[1, 2], [1, 3]]\n", 2, r"walls\[1\] holds 1 where a point"),
    "wall of one point": (G + "walls:\n  - [[1, 2]]\n", 2, r"walls\[1\] has 1 points and needs 2"),
    "wall with a word": (G + "walls: [[[1, 2], [1, a]]]\n", 2, r"walls\[1\]\[2\]\[2\] is the text"),
    "polygon of two": (G + "polygons: [[[1, 2], [1, 3]]]\n", 2, "2 points and needs 3"),
    "waypoints flat": (G + "waypoints: [1, 2]\n", 2, "holds 1 where a point should be"),
    "waypoint of three": (G + "waypoints: [[1, 2, 3]]\n", 2, r"waypoints\[1\] has 3 numbers"),
    "velocity a number": (G + "obstacles: [{at: [3, 3], velocity: 2}]\n", 2, "velocity is 2"),
    "goal in a polygon": (
        "start: [-1, 0]\n" + G + "polygons: [[[0.5, -1], [2, -1], [2, 1], [0.5, 1]]]\n",
        2,
        r"the goal \(1, 0\) lies inside polygons\[1\]: move one of them",
    ),
    "start on a wall": (
        G + "start: [0, 0]\nwalls: [[[0, -1], [0, 1]]]\n",
        2,
        r"the start \(0, 0\) lies on the wall that begins with \(0, -1\), \(0, 1\)",
    ),
    "waypoint in an obstacle": (
        G + "obstacles: [[0.5, 1]]\nwaypoints:\n  - [0.5, 0]\n  - [0.5, 1.1]\n",
        5,
        r"the waypoint \(0.5, 1.1\) lies inside the obstacle",
    ),
    "start in a moving obstacle": (
        G + "start: [0, 0]\nobstacles: [{at: [0.1, 0], velocity: [1, 0]}]\n",
        2,
        "lies inside the obstacle",
    ),
}


@pytest.mark.parametrize(("text", "line", "words"), BAD.values(), ids=BAD)
def test_what_cannot_be_is_refused_with_its_line(
    tmp_path: Path, text: str, line: int, words: str
) -> None:
    with pytest.raises(DataError) as caught:
        load_mission(write(tmp_path, text))
    message = str(caught.value)
    assert message.startswith(f"m.yaml:{line}: ")
    assert re.search(words, message), message


def test_a_goal_that_an_obstacle_leaves_again_is_no_fault() -> None:
    goal(1, 0, obstacles=[{"at": (1.0, 0.0), "velocity": (0.0, 0.5)}])


# Distances ----------------------------------------------------------------------------------------


@given(POINT, POINT, POINT, POINT)
@settings(max_examples=60, deadline=None)
def test_the_distance_between_ways_is_the_smallest_of_their_points(
    a: tuple[float, float], b: tuple[float, float], c: tuple[float, float], d: tuple[float, float]
) -> None:
    share = np.linspace(0, 1, 201)[:, None]
    on_first = np.array(a) + share * (np.array(b) - a)
    on_second = np.array(c) + share * (np.array(d) - c)
    gaps = np.linalg.norm(on_first[:, None] - on_second[None], axis=2)
    step = max(math.dist(a, b), math.dist(c, d)) / 200
    result = distance_between_segments(a, b, c, d, floats)
    # Points on the ways cannot be nearer than the ways; they miss them by a step of each at most.
    assert gaps.min() - step - 1e-12 <= result <= gaps.min() + 1e-12


@given(POINT, st.lists(POINT, min_size=2, max_size=5))
@settings(max_examples=60, deadline=None)
def test_the_nearest_point_of_a_wall_lies_on_it_at_its_distance(
    p: tuple[float, float], points: list[tuple[float, float]]
) -> None:
    near = nearest_point(Wall(tuple(points)), *p, floats)
    pieces = list(pairwise(points))
    distance = min(distance_to_segment(p, a, b, floats) for a, b in pieces)
    # Numbers up to 6, a handful of roundings; near-zero pieces square what is below the ulp.
    assert math.dist(p, near) == pytest.approx(distance, abs=1e-7)
    assert min(distance_to_segment(near, a, b, floats) for a, b in pieces) < 1e-7


def test_a_corner_belongs_inside_of_a_dented_area() -> None:
    dented = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 1.0), (0.0, 4.0))
    area = Polygon(dented)
    assert area.contains(1.0, 1.0, np)
    assert not area.contains(2.0, 2.0, np)
    assert not area.contains(5.0, 1.0, np)


def test_an_obstacle_that_moves_is_met_between_two_samples() -> None:
    """Both are half a metre past each other after the sample, and touched on the way."""
    scene = goal(9, 9, obstacles=[{"at": (1.0, 0.0), "velocity": (-1.0, 0.0)}]).scene()
    a, b = Pose(0.0, 0.0, 0.0), Pose(0.5, 0.0, 0.0)
    assert step_clearance(scene, a, b, 1.0, 1.0, floats) == pytest.approx(-0.15)
    still = scene._replace(obstacles=(scene.obstacles[0]._replace(vx=0.0),))
    assert step_clearance(still, a, b, 1.0, 1.0, floats) == pytest.approx(0.35)


# Missions -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "around",
    [
        {"walls": [[(1.0, -0.5), (1.0, 0.5)]]},
        {"polygons": [[(1.0, -0.5), (1.2, -0.5), (1.2, 0.5), (1.0, 0.5)]]},
    ],
    ids=["wall", "polygon"],
)
def test_driving_through_a_wall_is_a_collision(around: dict[str, object]) -> None:
    mission = goal(3, 0, guidance=BLIND, control={"period": 1}, **around)
    result = simulate(mission, Robot(dt=1.0, difference=0.0))
    assert (result.outcome, result.min_clearance_m) == (Outcome.COLLISION, 0.0)
    # The wall is crossed within a sample of at most 0.3 m.
    assert 1.0 <= result.final[0] < 1.3


def test_a_moving_obstacle_collides_only_where_it_then_is() -> None:
    def driven(vy: float) -> Outcome:
        crossing = {"at": (1.0, -1.0), "velocity": (0.0, vy)}
        mission = goal(2, 0, obstacles=[crossing], guidance=BLIND)
        return simulate(mission, Robot(difference=0.0)).outcome

    # The robot passes x = 1 m after about 4.5 s, which is when the first one gets there.
    assert driven(1 / 4.5) is Outcome.COLLISION
    assert driven(1.0) is driven(0.0) is Outcome.ARRIVED


def test_a_wall_pushes_as_one_obstacle_however_it_is_drawn() -> None:
    whole = goal(3, 0, walls=[[(0.8, 0.4), (2.0, 0.4)]])
    pieces = goal(3, 0, walls=[[(0.8, 0.4), (1.1, 0.4), (1.5, 0.4), (2.0, 0.4)]])
    one, other = simulate(whole, Robot()), simulate(pieces, Robot())
    assert one.min_clearance_m is not None
    assert one.min_clearance_m > 0.4  # it was pushed away from the straight line
    np.testing.assert_allclose(one.log["y"], other.log["y"], atol=1e-9)  # rounding alone
