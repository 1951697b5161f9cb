"""Skid steering in general: what it becomes when nothing turns, nothing shears, or all slides."""

import math

import numpy as np
import pytest

from sysid.errors import ModelError
from sysid.vehicle.ground.drawbar import Traction
from sysid.vehicle.ground.presets import soil_preset
from sysid.vehicle.ground.skid_steer import ground_forces, steady_turn
from sysid.vehicle.pressure import Distribution, Pressure
from sysid.vehicle.soil import Soil
from sysid.vehicle.tracked import TrackedVehicle

ROBOT = TrackedVehicle()
SAND = Traction(soil_preset("dry-sand"), ROBOT)
WHEELED = Traction(soil_preset("dry-sand"), ROBOT, Pressure(Distribution.WHEELS, 0.01, 4))


@pytest.mark.parametrize("traction", [SAND, WHEELED])
@pytest.mark.parametrize("slip", [0.02, 0.3, 1.0])
def test_straight_on_it_is_the_thrust(traction: Traction, slip: float) -> None:
    speed = 0.2
    forces = ground_forces(traction, ((1.0 - slip) * speed, 0.0, 0.0), (speed, speed))
    assert forces.left + forces.right == pytest.approx(traction.thrust(slip), rel=1e-9)
    assert (forces.lateral, forces.moment) == pytest.approx((0.0, 0.0), abs=1e-15)


def test_a_mirrored_motion_has_mirrored_forces() -> None:
    left = ground_forces(SAND, (0.1, 0.02, 0.5), (0.05, 0.2))
    right = ground_forces(SAND, (0.1, -0.02, -0.5), (0.2, 0.05))
    assert (right.left, right.right) == pytest.approx((left.right, left.left))
    assert (right.lateral, right.moment) == pytest.approx((-left.lateral, -left.moment))


def test_backwards_is_forwards_seen_from_behind() -> None:
    """The vehicle turned by 180°: speeds and forces change sign, the yaw rate and moment do not."""
    forth = ground_forces(SAND, (0.1, 0.02, 0.5), (0.05, 0.2))
    back = ground_forces(SAND, (-0.1, -0.02, 0.5), (-0.2, -0.05))
    assert (back.left, back.right) == pytest.approx((-forth.right, -forth.left))
    assert (back.lateral, back.moment) == pytest.approx((-forth.lateral, forth.moment))


def test_standing_tracks_dragged_sideways_have_coulombs_friction() -> None:
    """All slides one way: μ W, without moment; turned about the middle μ W L/4 where L ≫ B."""
    firm = Soil(0.0, math.atan(0.6), 1e-7)
    forces = ground_forces(Traction(firm, ROBOT), (0.0, 0.1, 0.0), (0.0, 0.0))
    assert forces.lateral == pytest.approx(-0.6 * ROBOT.weight, rel=1e-6)
    yaw, half = 0.1, 0.5 * ROBOT.geometry.B
    # tracks that run with the ground under their own lines slide sideways only
    spun = ground_forces(Traction(firm, ROBOT), (0.0, 0.0, yaw), (-yaw * half, yaw * half))
    assert spun.left == pytest.approx(0.0, abs=1e-9)
    wongs = 0.6 * ROBOT.weight * ROBOT.contact_length / 4.0
    assert -spun.moment == pytest.approx(wongs, rel=1e-3)  # K over the displacement at the ends


@pytest.mark.parametrize("name", ["concrete", "dry-sand", "clay", "snow", "ice"])
def test_a_steady_turn_is_in_balance_and_tight_ones_resist_most(name: str) -> None:
    traction = Traction(soil_preset(name), ROBOT)
    moments = []
    for radius in (0.3, 1.0, 3.0, 10.0):
        turn = steady_turn(traction, radius)
        resistance = float(traction.rolling() + traction.compaction())
        assert sum(turn.forces) == pytest.approx(resistance, abs=1e-5 * ROBOT.weight)
        half = 0.5 * ROBOT.geometry.B
        assert (turn.forces[1] - turn.forces[0]) * half == pytest.approx(turn.moment, abs=1e-5)
        # the sprockets drive the body, drag the tracks over the ground and lose nothing else
        assert turn.power > resistance * turn.yaw_rate * radius
        moments.append(turn.moment)
    assert moments == sorted(moments, reverse=True)


def test_forces_of_a_turn_depend_on_its_radius_not_on_its_pace() -> None:
    slow, slower = (steady_turn(SAND, 0.5, speed) for speed in (0.02, 0.01))
    # what is left is the centripetal force, m v²/R = 1e-3 N
    assert slow.forces == pytest.approx(slower.forces, abs=5e-3)
    assert slow.power == pytest.approx(2.0 * slower.power, rel=1e-2)


def test_on_the_spot_both_tracks_do_the_same() -> None:
    turn = steady_turn(SAND, 0.0)
    assert turn.tracks[0] == pytest.approx(-turn.tracks[1], rel=1e-5)
    assert turn.icr == pytest.approx(0.0, abs=1e-6)
    assert abs(turn.coefficient) < SAND.soil.friction + 2 * 0.0056 * SAND.soil.cohesion / 15.6


@pytest.mark.parametrize(
    ("radius", "speed", "sentence"),
    [(-1.0, 0.1, "radius of a turn is -1"), (1.0, 0.0, "speed of a turn is 0")],
)
def test_impossible_turns_are_refused(radius: float, speed: float, sentence: str) -> None:
    with pytest.raises(ModelError, match=sentence):
        steady_turn(SAND, radius, speed)


def test_ground_that_cannot_even_drive_it_says_so() -> None:
    stuck = Traction(Soil(0.0, 0.01, 0.01, rolling=0.2), ROBOT)
    with pytest.raises(ModelError, match=r"no steady turn on a radius of 0\.5 m"):
        steady_turn(stuck, 0.5)


def test_batches() -> None:
    speeds = np.array([0.05, 0.1, 0.2])
    many = ground_forces(SAND, (0.1, 0.0, speeds), (0.05 * speeds, speeds))
    one = ground_forces(SAND, (0.1, 0.0, 0.2), (0.01, 0.2))
    assert [v[2] for v in many] == pytest.approx(list(one))
