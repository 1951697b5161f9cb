"""The improved field: obstacles that move repel earlier, and to the side on which one passes."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mission_cases import Robot, goal

from sysid.robot.mission.contracts import Body, Disc, Pose
from sysid.robot.mission.guidance.field import (
    BRAKING,
    PotentialField,
    braked_distance,
    moving_force,
)
from sysid.robot.mission.result import Outcome
from sysid.robot.mission.simulator import simulate
from sysid.runners import floats

GAINS = PotentialField()


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3, 3), st.floats(0, 0.5))
@settings(max_examples=50, deadline=None)
def test_an_obstacle_at_rest_repels_as_published(x: float, y: float, psi: float, v: float) -> None:
    body, still = Body(Pose(x, y, psi), v, 0.0), Disc(0.3, 0.2, 0.15)
    published = GAINS.repulsion(x, y, still, floats)
    force = moving_force(body, still, GAINS.eta, GAINS.rho0, floats)
    if math.hypot(x - 0.3, y - 0.2) > 0.01:  # nearer both are as good as infinite
        assert force == pytest.approx(published, rel=1e-9)


def test_the_distance_left_is_what_braking_leaves() -> None:
    """Robot at 0.3 m/s and obstacle at 0.2 m/s head on: 0.5²/2a of the 2 m go."""
    body, coming = Body(Pose(0.0, 0.0, 0.0), 0.3, 0.0), Disc(2.0, 0.0, 0.15, -0.2, 0.0)
    left, v, wx, wy = braked_distance(body, coming, floats)
    assert v == pytest.approx(0.5)
    assert left == pytest.approx(2.0 - 0.5**2 / (2 * BRAKING))
    assert (wx, wy) == pytest.approx((0.0, 0.0))
    leaving = coming._replace(vx=0.5)
    assert braked_distance(body, leaving, floats)[:2] == pytest.approx((2.0, 0.0))


def test_the_push_is_back_and_to_the_side_on_which_it_passes() -> None:
    body = Body(Pose(0.0, 0.0, 0.0), 0.3, 0.0)
    crossing = Disc(0.6, 0.0, 0.15, -0.1, -0.2)  # comes nearer and goes down: pass above it
    fx, fy = moving_force(body, crossing, GAINS.eta, GAINS.rho0, floats)
    assert fx < 0 < fy


@pytest.mark.parametrize("kind", ["field", "harmonic"])
@pytest.mark.parametrize("vy", [0.15, 0.22, 0.3])
def test_an_obstacle_that_crosses_is_avoided(kind: str, vy: float) -> None:
    """It would meet the robot on the straight line, or pass just before or behind it."""
    crossing = {"at": (1.5, -1.5), "velocity": (0.0, vy)}
    mission = goal(3, 0, obstacles=[crossing], guidance={"kind": kind})
    result = simulate(mission, Robot())
    assert result.outcome is Outcome.ARRIVED, result.sentence
    assert result.min_clearance_m is not None
    assert result.min_clearance_m > 0.1


def test_without_avoiding_it_is_hit() -> None:
    crossing = {"at": (1.5, -1.5), "velocity": (0.0, 0.27)}
    mission = goal(3, 0, obstacles=[crossing], guidance={"kind": "pure-pursuit"})
    assert simulate(mission, Robot()).outcome is Outcome.COLLISION
