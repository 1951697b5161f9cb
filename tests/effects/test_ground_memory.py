"""Ground with a memory: a record at once, sample by sample, and in the loop of a mission."""

import numpy as np
import pytest
from pose_cases import DT, two_tracks, wandering

from sysid.diagnosis.pose.ground_model import with_ground
from sysid.effects.ground import Ground
from sysid.errors import UsageError
from sysid.robot.calibration.windows import path_of
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.vehicle.kinematics import Geometry

GROUNDS = {
    "scrub-lag": {"lag": np.full(2, 0.3)},
    "longitudinal-slip": {
        "share": np.full(2, 0.1),
        "growth": np.full(2, 0.005),
        "lag": np.full(2, 0.2),
        "spin": np.full(2, 0.03),
    },
}


def stepped(ground: Ground, omega: np.ndarray) -> np.ndarray:
    """The record sample by sample from rest."""
    state, out = ground.start(), []
    for k, (left, right) in enumerate(omega.tolist()):
        speeds, state = ground.step(state, (left, right), DT if k else 0.0)
        out.append(speeds)
    return np.array(out)


@pytest.mark.parametrize("id", GROUNDS)
def test_a_record_at_once_is_its_samples_one_after_the_other(id: str) -> None:
    ground = Ground((id, "track-slip"), {id: GROUNDS[id], "track-slip": {"share": np.full(2, 0.2)}})
    omega = np.concatenate([np.zeros((1, 2)), wandering(200)])
    np.testing.assert_allclose(ground.rolled(omega, DT), stepped(ground, omega), atol=1e-6)


def test_only_turning_lags_and_reaches_what_the_wheels_say() -> None:
    ground = Ground(("scrub-lag",), {"scrub-lag": GROUNDS["scrub-lag"]})
    omega = np.concatenate([np.zeros((1, 2)), np.tile([2.0, 6.0], (60, 1))])
    rolled = ground.rolled(omega, DT)
    np.testing.assert_allclose(rolled.sum(axis=1), omega.sum(axis=1))
    difference = rolled[:, 1] - rolled[:, 0]
    # the exact answer to a ramp of one sample and a step behind it
    t = DT * np.arange(60)
    start = 4.0 * (1.0 - (0.3 / DT) * (1.0 - np.exp(-DT / 0.3)))
    np.testing.assert_allclose(difference[1:], 4.0 + (start - 4.0) * np.exp(-t / 0.3), rtol=1e-9)


def test_slip_in_straight_drive_takes_its_share_of_way_and_turn() -> None:
    numbers = {"share": np.full(2, 0.1), "growth": np.full(2, 0.01), "lag": np.zeros(2)}
    ground = Ground(("longitudinal-slip",), {"longitudinal-slip": numbers})
    np.testing.assert_allclose(ground(10.0, 10.0), (8.0, 8.0))
    np.testing.assert_allclose(ground(-4.0, 4.0), (-3.44, 3.44))


def test_a_ground_carries_each_side_along_no_faster_than_it_can() -> None:
    ground = Ground(("longitudinal-slip",), {"longitudinal-slip": {"spin": np.full(2, 0.05)}})
    omega = np.concatenate([np.zeros((1, 2)), np.tile([3.0, 8.0], (20, 1)), np.zeros((20, 2))])
    rolled = ground.rolled(omega, DT)
    gained = np.diff(rolled, axis=0) / DT
    np.testing.assert_allclose(np.abs(gained).max(axis=0), 20.0)
    assert rolled[:21].max(axis=0) == pytest.approx([3.0, 8.0])
    assert rolled[-1] == pytest.approx([0.0, 0.0])


def test_a_ground_that_remembers_asks_for_the_time_between_samples() -> None:
    ground = Ground(("scrub-lag",), {"scrub-lag": GROUNDS["scrub-lag"]})
    assert ground.remembers
    assert not Ground().remembers
    with pytest.raises(UsageError, match="the time between two samples"):
        ground.rolled(np.ones((5, 2)))


def test_a_batch_steps_as_a_single_run() -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    ground = Ground(tuple(GROUNDS), GROUNDS)
    omega = np.concatenate([np.zeros((1, 2)), wandering(30)])
    times = np.where(np.arange(len(omega)) > 0, DT, 0.0)

    def sample(state, now):  # type: ignore[no-untyped-def]
        speeds, state = ground.step(state, (now[0], now[1]), now[2])
        return state, jax.numpy.stack(speeds)

    start = jax.tree.map(jax.numpy.asarray, ground.start())
    _, rolled = jax.lax.scan(sample, start, np.column_stack([omega, times]))
    np.testing.assert_allclose(rolled, stepped(ground, omega), atol=1e-9)


def test_a_mission_turns_late_with_the_ground() -> None:
    ground = Ground(("scrub-lag",), {"scrub-lag": GROUNDS["scrub-lag"]})
    model = with_ground(two_tracks(), ground, {})
    mission = Mission(goal=(2.0, 2.0), timeout=60.0)
    robot, notes = as_robot(model.plant(), mission)
    assert not notes
    log = simulate(mission, robot).log
    omega = np.column_stack([log["omega_l"], log["omega_r"]])
    path = path_of(omega, robot.dt, ground, Geometry(), np.zeros(3))
    driven = np.column_stack([log["x"], log["y"], np.unwrap(log["psi"])])
    np.testing.assert_allclose(driven, path, atol=1e-6)
    plain = path_of(omega, robot.dt, Ground(), Geometry(), np.zeros(3))
    assert np.abs(plain - path).max() > 0.01
