"""The harmonic potential: no minimum but the goal, and it knows where no way leads."""

import jax
import numpy as np
import pytest
from mission_cases import Robot, goal

from sysid.errors import ModelError
from sysid.robot.mission.contracts import Pose, Wall
from sysid.robot.mission.guidance.harmonic import Harmonic
from sysid.robot.mission.guidance.harmonic_grid import solved
from sysid.robot.mission.plan import plan
from sysid.robot.mission.result import Outcome, StuckReason
from sysid.robot.mission.simulator import simulate
from sysid.runners import floats

KIND = {"kind": "harmonic"}
U = [[(1.0, 0.6), (2.0, 0.6), (2.0, -0.6), (1.0, -0.6)]]


def test_every_corner_is_the_mean_of_its_neighbours() -> None:
    grid = solved(((2.0, 0.0),), (), (Wall(((1.0, -0.5), (1.0, 0.5))),), 0.15, 0.1, 0.1)
    w = np.exp(-grid.heights[0])
    mean = 0.25 * (w[1:-1, 2:] + w[1:-1, :-2] + w[2:, 1:-1] + w[:-2, 1:-1])
    inner = w[1:-1, 1:-1]
    unknown = (inner > 0) & (inner < 1)
    assert unknown.sum() > 400
    np.testing.assert_allclose(inner[unknown], mean[unknown], rtol=1e-9)


def test_every_way_up_leads_to_the_goal() -> None:
    """From all over the map, dead end included; a few start inside the wall's margin."""
    route = plan(goal(3, 0, walls=U, guidance=KIND))
    assert route.arrives
    assert route.arriving_share == 1.0
    assert route.min_clearance_m is not None
    assert route.min_clearance_m > 0.15


def test_the_u_is_driven_around_at_once() -> None:
    result = simulate(goal(3, 0, walls=U, guidance=KIND), Robot())
    assert result.outcome is Outcome.ARRIVED
    assert result.path_length_m < 5.0  # around the nearer arm; the straight line has 3 m
    assert result.min_clearance_m is not None
    assert result.min_clearance_m > 0.15


def test_a_long_passage_does_not_lose_the_potential() -> None:
    """w falls by e^(−πL/width), here to e^−120: far below what is left of 1 − w in a float."""
    walls = [[(0.0, 0.25), (15.0, 0.25), (15.0, -0.25), (0.0, -0.25)]]
    grid = solved(((14.5, 0.0),), (), tuple(Wall(tuple(w)) for w in walls), 0.11, 0.05, 0.1)
    x = np.linspace(0.5, 12.0, 60)
    gx, gy, _, _ = grid.direction(0, x, np.zeros(60), np)
    assert grid.height(0, 0.5, 0.0, np) > 100.0
    np.testing.assert_allclose(np.arctan2(gy, gx), 0.0, atol=1e-6)


def test_where_no_way_leads_the_mission_ends_at_once() -> None:
    ring = [[(2.3, -0.7), (3.7, -0.7), (3.7, 0.7), (2.3, 0.7), (2.3, -0.7)]]
    result = simulate(goal(3, 0, walls=ring, guidance=KIND), Robot())
    assert (result.outcome, result.time_s) == (Outcome.STUCK, 0.0)
    assert result.stuck is not None
    assert result.stuck.reason is StuckReason.NO_WAY_THROUGH
    assert "lower margin (now 0.15 m)" in result.sentence
    # A passage that is narrower than the margin asks for is no way; with less margin it is one.
    gate = [[(1.5, 5.0), (1.5, 0.13), (1.5, 5.0)], [(1.5, -5.0), (1.5, -0.13)]]
    room = [[(-1, -2), (4, -2), (4, 2), (-1, 2), (-1, -2)]]
    for margin, outcome in ((0.15, Outcome.STUCK), (0.1, Outcome.ARRIVED)):
        law = KIND | {"margin": margin}
        result = simulate(goal(3, 0, walls=gate + room, guidance=law), Robot())
        assert result.outcome is outcome, result.sentence


def test_a_goal_inside_the_margin_of_a_wall_is_reached() -> None:
    result = simulate(goal(2, 0, walls=[[(2.05, -1), (2.05, 1)]], guidance=KIND), Robot())
    assert result.outcome is Outcome.ARRIVED


def test_waypoints_have_a_potential_each() -> None:
    mission = goal(3, 0, walls=U, waypoints=[(1.5, 0.0), (0.0, 1.0)], guidance=KIND)
    result = simulate(mission, Robot())
    assert result.outcome is Outcome.ARRIVED
    for x, y in mission.waypoints:
        near = np.hypot(result.log["x"] - x, result.log["y"] - y)
        assert near.min() < 0.1 + 0.03


def test_the_way_to_go_shrinks_on_the_way() -> None:
    """Around the U the straight distance to the goal grows for a while; the way to go does not."""
    mission = goal(3, 0, start=(1.5, 0.0), walls=U, guidance=KIND)
    law, scene = mission.complete_guidance, mission.scene()
    log = simulate(mission, Robot()).log
    state = law.start(scene, floats)
    left = [
        law.to_go(state, Pose(x, y, 0.0), scene, floats)
        for x, y in zip(log["x"].tolist(), log["y"].tolist(), strict=True)
    ]
    straight = np.hypot(log["x"] - 3, log["y"])
    assert straight.max() > straight[0] + 0.3
    assert left[0] > 1.5 * straight[0]
    second = np.array(left)[::10]  # the path is not exactly that of the corners
    assert np.all(np.diff(second) < 0.1)


def test_what_cannot_be_solved_is_refused() -> None:
    with pytest.raises(ModelError, match=r"raise guidance\.cell \(now 0\.001 m\)"):
        simulate(goal(3, 0, guidance=KIND | {"cell": 0.001}), Robot())
    scene = goal(3, 0, obstacles=[(1.5, 0.5)]).scene()

    @jax.jit
    def start(x: float) -> int:
        moved = scene._replace(obstacles=(scene.obstacles[0]._replace(x=x),))
        Harmonic().start(moved, jax.numpy)
        return 0

    with pytest.raises(ModelError, match="is solved before the run"):
        start(1.4)
