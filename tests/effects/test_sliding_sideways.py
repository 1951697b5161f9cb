"""A vehicle that slides sideways: its path, and a mission."""

import numpy as np
import pytest
from pose_cases import DT, two_tracks, wandering

from sysid.data.record import Array
from sysid.diagnosis.pose.ground_model import with_ground
from sysid.effects.ground import Ground
from sysid.robot.calibration.windows import path_of
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.vehicle.kinematics import Geometry


def sliding(ahead: float = 0.0, drift: float = 0.0) -> Ground:
    numbers = {"ahead": np.full(2, ahead), "drift": np.full(2, drift)}
    return Ground(("lateral-slip",), {"lateral-slip": numbers})


def driven(omega: Array, ground: Ground) -> Array:
    return path_of(omega, DT, ground, Geometry())


@pytest.mark.parametrize("ahead", [0.03, -0.02])
def test_the_point_about_which_it_turns_rolls(ahead: float) -> None:
    omega = wandering(300)
    slid, rolled = driven(omega, sliding(ahead)), driven(omega, Ground())
    front = ahead * np.column_stack([np.cos(slid[:, 2]) - 1.0, np.sin(slid[:, 2])])
    np.testing.assert_allclose(slid[:, :2] + front, rolled[:, :2], atol=1e-12)
    np.testing.assert_array_equal(slid[:, 2], rolled[:, 2])


def test_in_an_arc_it_drifts_outwards() -> None:
    geometry, drift = Geometry(), 0.2
    omega = np.tile([6.0, 9.0], (400, 1))
    slid = driven(omega, sliding(drift=drift))
    speed, rate = geometry.r * 7.5, geometry.r / geometry.B * 3.0
    # a circle, wider as the speed is now v √(1 + (β ψ̇)²)
    centre = slid[:, :2].max(axis=0) / 2.0 + slid[:, :2].min(axis=0) / 2.0
    radius = np.linalg.norm(slid[:, :2] - centre, axis=1)
    # the extremes of a circle sampled every 2.7° are within 3e-4 of it
    np.testing.assert_allclose(radius, speed / rate * np.hypot(1.0, drift * rate), rtol=1e-3)
    assert sliding(drift=drift).lateral(speed, rate) == pytest.approx(-drift * speed * rate)
    assert Ground().lateral(speed, rate) == 0


def test_a_mission_slides_with_the_ground() -> None:
    ground = sliding(0.02, 0.15)
    robot, notes = as_robot(
        with_ground(two_tracks(), ground, {}).plant(), Mission(goal=(1.5, 1.5), timeout=60.0)
    )
    assert not notes
    log = simulate(Mission(goal=(1.5, 1.5), timeout=60.0), robot).log
    omega = np.column_stack([log["omega_l"], log["omega_r"]])
    path = path_of(omega, robot.dt, ground, Geometry(), np.zeros(3))
    there = np.column_stack([log["x"], log["y"], np.unwrap(log["psi"])])
    np.testing.assert_allclose(there, path, atol=1e-6)
    rolled = path_of(omega, robot.dt, Ground(), Geometry(), np.zeros(3))
    assert np.abs(rolled - path).max() > 0.01
