"""How missions end, on which clock, and what is written of them."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mission_cases import Robot, goal

from sysid.data.record import Array, Channel
from sysid.errors import ModelError, UsageError
from sysid.robot.mission.contracts import ROBOT_INPUTS, Body, NavigationInputs, Scene
from sysid.robot.mission.ending import ending
from sysid.robot.mission.loop import COLUMNS
from sysid.robot.mission.monte_carlo.runs import simulate_runs
from sysid.robot.mission.navigation.dead_reckoning import Odometry
from sysid.robot.mission.result import MissionResult, Outcome, write_log
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.runners import floats
from sysid.vehicle.kinematics import Geometry


# Endings ------------------------------------------------------------------------------------------
def test_driving_into_an_obstacle_is_a_collision() -> None:
    mission = goal(2, 0, obstacles=[(1, 0.05)], guidance={"eta": 0, "Ki": 0})
    result = simulate(mission, Robot())
    assert result.outcome is Outcome.COLLISION
    assert result.min_clearance_m is not None
    assert -0.03 < result.min_clearance_m <= 0.0  # less than the way of one sample at 0.3 m/s
    assert result.final[0] == pytest.approx(0.86, abs=0.03)


def test_an_obstacle_is_not_jumped_over_between_two_samples() -> None:
    mission = goal(
        20, 0, obstacles=[(2.0, 0, 0.01)], guidance={"eta": 0, "Ki": 0}, control={"period": 1}
    )
    result = simulate(mission, Robot(dt=1.0, difference=0.0))
    assert result.outcome is Outcome.COLLISION
    assert result.final[0] > 2.0


def test_the_clearance_of_a_miss_is_to_the_surface() -> None:
    mission = goal(2, 0, obstacles=[(1, 1, 0.4)])
    result = simulate(mission, Robot(difference=0.0))
    assert result.min_clearance_m == pytest.approx(0.6)
    assert simulate(goal(2, 0), Robot()).min_clearance_m is None


def test_time_runs_out() -> None:
    result = simulate(goal(5, 0, timeout=3), Robot())
    assert result.outcome is Outcome.TIMEOUT
    assert result.time_s == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("mission", "robot"),
    [
        (goal(2, 0, obstacles=[(1, 0), (1, 0.4), (1, -0.4), (0.7, 0.7), (0.7, -0.7)]), Robot()),
        (goal(1, 0), Robot(top_speed=0.0)),
        (goal(-1, 0), Robot(top_speed=0.0)),
    ],
    ids=["local minimum behind a cup", "dead plant", "dead plant that should turn"],
)
def test_no_progress_is_stuck(mission: Mission, robot: Robot) -> None:
    result = simulate(mission, robot)
    assert result.outcome is Outcome.STUCK
    assert 10.0 <= result.time_s < 40.0


@pytest.mark.parametrize(
    ("mission", "robot", "words", "not_words"),
    [
        (
            goal(2, 0, obstacles=[(1, 0), (1, 0.4), (1, -0.4), (0.7, 0.7), (0.7, -0.7)]),
            Robot(),
            "local minimum of the field; move the goal or lower eta",
            "past",
        ),
        (goal(1, 0), Robot(top_speed=0.0), "stands still 1 m from the goal", "eta"),
        (goal(1, 0, tolerance=0.002, timeout=300), Robot(), "drove past it", "eta"),
        (goal(3, 0, control={"kp_yaw": 0.0}), Robot(difference=0.6), "does not lead there", "eta"),
    ],
    ids=["cup", "dead plant", "past the goal", "off course"],
)
def test_stuck_says_why(mission: Mission, robot: Robot, words: str, not_words: str) -> None:
    result = simulate(mission, robot)
    assert result.outcome is Outcome.STUCK
    assert words in result.sentence
    assert not_words not in result.sentence
    assert result.summary()["sentence"] == result.sentence


def test_a_slow_turn_on_the_spot_is_progress() -> None:
    """Turning at 0.06 rad/s takes 25 s, during which the distance to the goal stands still."""
    mission = goal(-0.3, 0.1, control={"psi_cmd_max": 0.013})
    result = simulate(mission, Robot(difference=0.0))
    first_move = result.log["t"][result.log["v_ref"] > 0][0]
    assert first_move > 20.0


def test_a_start_at_the_goal_has_arrived() -> None:
    result = simulate(goal(0.05, 0), Robot())
    assert (result.outcome, result.time_s, result.path_length_m) == (Outcome.ARRIVED, 0.0, 0.0)
    assert simulate(goal(0, 0), Robot()).max_deviation_m == 0.0


def test_every_outcome_has_a_sentence() -> None:
    result = simulate(goal(5, 0, timeout=12), Robot())
    said = [ending(outcome, goal(5, 0), result.log)[0] for outcome in Outcome]
    assert all(text.endswith(".") for text in said)
    assert len(set(said)) == len(said)


@dataclass(frozen=True)
class Exploding(Robot):
    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        return (state + u) * 1e60, state


@pytest.mark.parametrize(
    ("mission", "plant", "words"),
    [
        (goal(1, 0), Exploding(), "run away at t = 0.1 s"),
        (goal(1, 0), replace(Robot(), inputs=ROBOT_INPUTS[::-1]), "as_robot"),
        (goal(1, 0), replace(Robot(), outputs=(Channel("y"),)), "omega_l"),
        (goal(1, 0), Robot(dt=1e-6), "plant's sample time of 1e-06 s makes 1.2e[+]08 steps"),
        (goal(1, 0, timeout=1e4, control={"period": 1e-4}), Robot(), "control period of 0.0001 s"),
        (goal(1, 0), replace(Robot(), dt=0.0), "sample time"),
    ],
)
def test_plants_that_cannot_fly_are_refused(mission: Mission, plant: Robot, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        simulate(mission, plant)


# Clocks -------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("dt", "period", "rel"),
    # A command that waits for the plant's next sample, or a measurement that is old, costs part of
    # the longer of both clocks; 0.25 s is beyond the plant's lag of 0.2 s.
    [(0.02, 0.1, 0.03), (0.1, 0.02, 0.03), (0.03, 0.1, 0.03), (0.07, 0.05, 0.03), (0.25, 0.1, 0.1)],
)
def test_clocks_of_any_ratio_fly_the_same_mission(dt: float, period: float, rel: float) -> None:
    mission = goal(2, 1, control={"period": period})
    result = simulate(mission, Robot(dt=dt))
    same = simulate(goal(2, 1), Robot())
    assert result.outcome is Outcome.ARRIVED
    assert result.time_s == pytest.approx(same.time_s, rel=rel, abs=0.15)
    np.testing.assert_allclose(np.diff(result.log["t"]), dt, rtol=1e-9)


@pytest.mark.parametrize(
    ("dt", "period", "changes"),
    [
        (0.1, 0.1, [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]),
        (0.05, 0.2, [0.0, 0.2, 0.4, 0.6]),
        (0.1, 0.25, [0.0, 0.3, 0.5]),  # the first sample at or after 0.25 and 0.5
        (0.3, 0.1, [0.0, 0.3, 0.6]),
    ],
)
def test_a_command_is_held_until_the_first_sample_after_the_next_instant(
    dt: float, period: float, changes: list[float]
) -> None:
    log = simulate(goal(5, 0, control={"period": period}), Robot(dt=dt)).log
    changed = np.flatnonzero(np.diff(log["pwm_r"], prepend=-1.0))
    times = log["t"][changed]
    np.testing.assert_allclose(times[times < 0.75], changes, atol=1e-9)


def test_the_controller_sees_the_reading_of_its_own_instant() -> None:
    log = simulate(goal(1, 0), Robot()).log
    # With no integral step yet undone: V_cmd(k) = K_p e(k) + Σ K_i e T, e from v of the same row.
    error = (log["v_ref"] - log["v"])[:10]
    expected = 2.0 * error + 1.85 * 0.1 * np.cumsum(error)
    np.testing.assert_allclose(log["v_cmd"][:10], expected, rtol=1e-12)


# Navigation and the log ---------------------------------------------------------------------------
def test_navigation_decides_when_the_robot_believes_to_have_arrived() -> None:
    optimist = goal(1, 0, navigation={"r": 1.1 * Geometry().r})
    result = simulate(optimist, Robot(difference=0.0))
    assert result.outcome is Outcome.MISSED
    assert result.final[0] == pytest.approx(0.9 / 1.1, abs=0.03)  # one sample at 0.2 m/s
    assert result.believed_off_goal_m <= 0.1
    assert result.off_goal_m == 1.0 - result.final[0]
    batch = simulate_runs(optimist, [Robot(difference=0.0)], 1, vary=["noise"]).sentence
    assert "believes that it has arrived in 100 %; in 100 % it is not there, 0.18 m off" in batch
    nearly = goal(1, 0, navigation={"r": 1.03 * Geometry().r})  # millimetres decide nothing
    result = simulate(nearly, Robot(difference=0.0))
    assert result.outcome is Outcome.ARRIVED
    assert result.off_goal_m > 0.1
    assert result.log["rho_goal"][-1] <= 0.1 < 1.0 - result.final[0]


class Counted(NamedTuple):
    """Odometry's state, and how many measurements it has seen."""

    inner: Body
    measurements: int


class CountingOdometry:
    """A filter in Python alone: any state, no section of a file."""

    def __init__(self) -> None:
        self.last = 0

    def start(self, scene: Scene, xp: Any) -> Counted:
        return Counted(Odometry().start(scene, xp), 0)

    def step(
        self, state: Counted, inputs: NavigationInputs, dt: float, xp: Any
    ) -> tuple[Counted, Body]:
        inner, estimate = Odometry().step(state.inner, inputs, dt, xp)
        self.last = state.measurements + 1
        return Counted(inner, self.last), estimate


def test_navigation_may_carry_more_than_the_pose() -> None:
    navigator = CountingOdometry()
    result = simulate(goal(1, 0, navigation=navigator), Robot())
    assert navigator.last == len(result.log["t"])
    assert result.summary() == simulate(goal(1, 0), Robot()).summary()


@pytest.mark.parametrize("direct", [0.0, 2e-4])
def test_a_plant_can_be_identified_from_the_log(direct: float) -> None:
    """The columns are consistent to rounding: y(k) belongs to u(k), u acts from its own row on."""
    robot = Robot(direct=direct)
    log = simulate(goal(2, 1), robot).log
    for pulse, omega, b in (("pwm_l", "omega_l", robot.b[0]), ("pwm_r", "omega_r", robot.b[1])):
        u, y = log[pulse], log[omega]
        # y(k) = a y(k−1) + d u(k) + (b − a d) u(k−1)
        regressors = np.column_stack((y[:-1], u[1:], u[:-1]))
        result = np.linalg.lstsq(regressors, y[1:], rcond=None)[0]
        wanted = (robot.a, direct, b - robot.a * direct)
        np.testing.assert_allclose(result, wanted, rtol=1e-6, atol=1e-9)


def test_the_pose_of_the_log_is_the_dead_reckoning_of_its_speeds() -> None:
    result = simulate(goal(-1, -1), Robot())
    log, nav, scene = result.log, Odometry(), goal(-1, -1).scene()
    estimate, length = nav.start(scene, floats), 0.0
    for k, t in enumerate(log["t"].tolist()):
        measurements = {name: float(log[name][k]) for name in ("omega_l", "omega_r")}
        dt = 0.1 if k else 0.0
        _, moved = nav.step(estimate, NavigationInputs(t, measurements, scene), dt, floats)
        length += 0.5 * dt * abs(estimate.speed + moved.speed)
        estimate = moved
        assert (log["x"][k], log["y"][k], log["psi"][k]) == pytest.approx(estimate.pose)
    assert result.final == pytest.approx(estimate.pose)
    assert result.path_length_m == pytest.approx(length)


def read(path: Path) -> dict[str, Array]:
    header = path.read_text().splitlines()[0].split(",")
    columns = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2).T
    return dict(zip(header, columns, strict=True))


@pytest.fixture(scope="module")
def result() -> MissionResult:
    return simulate(goal(1, 0), Robot())


def test_a_written_log_reads_back_unrounded(result: MissionResult, tmp_path: Path) -> None:
    path = write_log(result, tmp_path / "mission.csv")
    assert path.read_bytes().startswith(b"t,pwm_l,pwm_r,omega_l,omega_r,x,y,psi,")
    back = read(path)
    assert tuple(back) == COLUMNS
    for name in COLUMNS:
        np.testing.assert_array_equal(back[name], result.log[name])
    assert [p.name for p in tmp_path.iterdir()] == ["mission.csv"]
    np.testing.assert_allclose(np.diff(back["t"]), 0.1, rtol=1e-9)


def test_a_log_that_cannot_be_written_leaves_nothing_behind(
    result: MissionResult, tmp_path: Path
) -> None:
    occupied = tmp_path / "taken"
    occupied.mkdir()
    (occupied / "content").touch()
    (tmp_path / "file").touch()
    for path in (tmp_path / "file" / "m.csv", occupied):
        with pytest.raises(UsageError, match=r"cannot be written|is a folder"):
            write_log(result, path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "taken"]


def test_the_log_is_read_only_and_the_summary_is_plain(result: MissionResult) -> None:
    with pytest.raises(ValueError, match="read-only"):
        result.log["x"][0] = 1.0
    with pytest.raises(TypeError):
        result.log["x"] = np.zeros(1)  # type: ignore[index]
    summary = result.summary()
    assert summary["outcome"] == "arrived"
    assert summary["min_clearance_m"] is None
    assert summary["final"] == dict(zip(("x", "y", "psi"), result.final, strict=True))
