"""A measured mission over its runs: a robot like them stays inside, another leaves, and why."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import Capture, run, write_log
from mission_cases import Robot, goal

from sysid.data.noise import white_noise
from sysid.data.record import Array, Record
from sysid.diagnosis.likely_cause import likely_cause
from sysid.effects.ground import Ground
from sysid.errors import DataError, UsageError
from sysid.estimation.pem import fit
from sysid.export.package import write_package
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.contracts import ROBOT_INPUTS, ROBOT_OUTPUTS
from sysid.robot.mission.measured.drive import MeasuredDrive
from sysid.robot.mission.measured.fan import Comparison, against_runs, compared
from sysid.robot.mission.monte_carlo.runs import RunPaths, run_paths
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.variation import Variation
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

NOISE = np.array([1e-3, 1e-3, 2e-3])
SHORT = goal(1.0, 0.5)
ROUND = goal(3.0, 1.5, obstacles=[(1.5, 0.9)])
RUNS = 60


@cache
def model() -> Model:
    """The plain robot's tracks, identified from a noisy log."""
    robot, rng = Robot(), np.random.default_rng(3)
    u = 12000.0 * np.sign(rng.normal(size=(500, 2))).repeat(3, axis=0)[:500]
    x, y = np.zeros(2), []
    for now in u:
        y.append(x)
        x = robot.step(x, now)[0]
    read = np.array(y) + 0.2 * rng.normal(size=u.shape)
    own = {"nb": [[1, 0], [0, 1]], "nf": [[1, 0], [0, 1]], "nk": 1}
    structure = structure_class("oe").from_orders(own, 2, 2)
    return fit(structure, [Record(u, read, 0.1, ROBOT_INPUTS, ROBOT_OUTPUTS)])


def driven(mission: Mission, robot: Robot | None = None, standing: int = 0) -> Record:
    """The log of a drive, its pose read with noise, after so many samples at rest."""
    robot = robot or Robot()
    log, rng = simulate(mission, robot).log, np.random.default_rng(standing)

    def columns(*names: str) -> Array:
        signals = np.column_stack([log[n] for n in names])
        rest = signals[:1] if "x" in names else np.zeros((1, len(names)))
        return np.vstack([np.repeat(rest, standing, axis=0), signals])

    pose = columns("x", "y", "psi")
    speeds = columns("omega_l", "omega_r")
    return Record(
        columns("pwm_l", "pwm_r"),
        speeds + 0.05 * rng.standard_normal(speeds.shape),
        robot.dt,
        ROBOT_INPUTS,
        ROBOT_OUTPUTS,
        pose + NOISE * rng.standard_normal(pose.shape),
        name="run7.csv",
    )


@cache
def short_runs(runs: int, seed: int) -> RunPaths:
    own = Variation().of(("parameters", "friction"))
    setup = Setup.of(SHORT.model_copy(update={"vary": own}), [model()])
    return run_paths(setup, runs, seed)


def judged(record: Record) -> Comparison:
    return compared(MeasuredDrive.of(record), short_runs(RUNS, 2), 0.0)


# The judgement ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_robots_like_the_runs_leave_in_few_drives() -> None:
    """5 % at most: of 60 drives 8 or more would be a chance below 1 in 100 at that."""
    others, t = short_runs(RUNS, 1), short_runs(RUNS, 2).t
    rng = np.random.default_rng(0)
    still = np.zeros((len(others.t), 2))
    u = still + 1000.0
    left = 0
    for path in others.pose:
        pose = path + NOISE * rng.standard_normal(path.shape)
        left += judged(Record(u, still, float(t[1]), pose=pose)).leaves is not None
    assert left < 8


def test_every_instant_alone_would_be_left_by_nearly_all() -> None:
    """Why a path is judged as a whole: 59 instants of three quantities, 90 % each."""
    fan, pose = judged(driven(SHORT)).fan, short_runs(RUNS, 1).pose[:, :59]
    read = pose + NOISE * np.random.default_rng(0).standard_normal(pose.shape)
    outside = (read < fan.low[:59, :3]) | (read > fan.high[:59, :3])
    assert np.mean(outside.any(axis=(1, 2))) > 0.9


def test_a_twin_stays_inside_whenever_it_set_off() -> None:
    comparison = against_runs(driven(SHORT, standing=13), SHORT, [model()], RUNS)
    assert comparison.leaves_at_s is None
    assert comparison.where is None
    assert comparison.inside_share == 1.0
    assert comparison.offset_s == pytest.approx(1.3)
    assert comparison.sentence == f"run7.csv stays inside the fan of {RUNS} runs."
    assert "first command, at 1.3 s" in comparison.notes[0]


def test_a_robot_that_is_carried_off_leaves_then() -> None:
    """From 2 s on it drifts sideways by 0.1 m/s: the fan is some centimetres wide at most."""
    record = driven(SHORT)
    assert record.pose is not None
    drift = 0.1 * np.maximum(record.t - 2.0, 0.0)
    comparison = judged(replace(record, pose=record.pose + np.outer(drift, (0.0, 1.0, 0.0))))
    assert comparison.leaves_at_s is not None
    assert 2.0 <= comparison.leaves_at_s <= 3.0
    assert comparison.quantity == "y"
    assert comparison.where is not None
    assert "m more than the median of the fan" in comparison.sentence


def test_one_wild_reading_is_no_leaving() -> None:
    record = driven(SHORT)
    assert record.pose is not None
    pose = record.pose.copy()
    pose[20] += (0.5, -0.5, 1.0)
    assert judged(replace(record, pose=pose)).leaves is None


def test_a_log_that_ends_early_is_judged_as_far_as_it_goes() -> None:
    comparison = judged(driven(SHORT).rows(0, 30))
    assert comparison.leaves is None
    assert "up to its end at 2.9 s, before the last run has ended" in comparison.sentence


def test_without_commands_time_counts_from_the_first_motion() -> None:
    record = driven(SHORT, standing=20)
    seen = Record(np.zeros((len(record), 0)), record.y, record.dt, pose=record.pose, name="cam.csv")
    comparison = against_runs(seen, SHORT, [model()], RUNS)
    assert 2.0 < comparison.offset_s < 2.6  # it takes a while to come 2 cm far
    assert comparison.leaves is None
    assert "first motion" in comparison.notes[0]


def test_the_runs_start_where_the_log_does() -> None:
    there = SHORT.model_copy(update={"start": (0.2, -0.1, 0.3)})
    comparison = against_runs(driven(there, standing=5), SHORT, [model()], RUNS)
    assert comparison.leaves is None
    assert "0.22 m and 0.3 rad from the mission's start" in " ".join(comparison.notes)


def test_noise_of_readings_is_seen_through_the_way() -> None:
    t = np.arange(400) * 0.05
    way = np.column_stack([np.sin(0.3 * t), np.cos(0.2 * t), 0.3 * t])
    noise = (0.004, 0.006, 0.01)
    read = way + noise * np.random.default_rng(1).standard_normal(way.shape)
    # the median of 400 differences, some of them alike: within a quarter
    np.testing.assert_allclose(white_noise([read]), noise, rtol=0.25)
    assert white_noise([way])[0] < 1e-4


# What cannot be -----------------------------------------------------------------------------------


def test_a_log_without_a_way_is_refused() -> None:
    record = driven(SHORT)
    with pytest.raises(
        DataError, match=r"run7.csv has fewer than 10 rows of a path \(columns x, y, psi"
    ):
        MeasuredDrive.of(Record(record.u, record.y, 0.1, name="run7.csv"))
    still = np.zeros((len(record), 3))
    with pytest.raises(DataError, match="the robot does not move"):
        MeasuredDrive.of(replace(record, pose=still))


def test_few_runs_are_no_fan() -> None:
    with pytest.raises(UsageError, match="20 runs are too few for a fan; give at least 40"):
        against_runs(driven(SHORT), SHORT, [model()], 20)


# The command --------------------------------------------------------------------------------------


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_package(model(), tmp_path / "plant")
    (tmp_path / "m.yaml").write_text("goal: [3.0, 1.5]\nobstacles: [[1.5, 0.9]]\n")
    return tmp_path


def saved(name: str, record: Record) -> Path:
    assert record.pose is not None
    names = ("pwm_l", "pwm_r", "omega_l", "omega_r", "x", "y", "psi")
    return write_log(Path(name), names, [*record.u.T, *record.y.T, *record.pose.T])


@pytest.mark.slow
def test_a_robot_that_slips_leaves_and_the_diagnosis_says_so(bench: Path, capsys: Capture) -> None:
    slips = Ground(("track-slip",), {"track-slip": {"share": np.array([0.15, 0.15])}})
    log = saved("slip.csv", driven(ROUND, Robot(ground=slips)))
    options = ("--plant", "plant", "--measured", log, "--plot", "fan.svg", "--json")
    result = run(capsys, "simulate", "m.yaml", *options).document
    measured = result["measured"]
    assert measured["cause"] == "track-slip"
    assert "Likely cause: track-slip" in measured["sentence"]
    assert 0.0 < measured["leaves_at_s"] < 6.0
    assert set(measured["where"]) == {"x", "y"}
    assert 0.0 < measured["inside_share"] < 0.9
    assert result["outcome"] == "arrived"  # the prediction itself is told as ever
    assert "leaves at" in Path("fan.svg").read_text(encoding="utf-8")


def test_a_log_of_another_robot_is_compared_but_not_explained(bench: Path, capsys: Capture) -> None:
    record = driven(ROUND, Robot(top_speed=0.3))
    assert record.pose is not None
    names = ("volts", "speed", "x", "y", "psi")
    columns = [record.u[:, 0], record.y[:, 0], *record.pose.T]
    log = write_log(Path("other.csv"), names, columns)
    result = run(capsys, "simulate", "m.yaml", "--plant", "plant", "--measured", log, "--json")
    measured = result.document["measured"]
    assert measured["cause"] is None
    assert "No cause can be named: other.csv has volts -> speed" in measured["sentence"]


def test_a_log_without_pose_is_refused_in_one_sentence(bench: Path, capsys: Capture) -> None:
    record = driven(SHORT)
    names = ("pwm_l", "pwm_r", "omega_l", "omega_r")
    log = write_log(Path("bare.csv"), names, [*record.u.T, *record.y.T])
    refused = run(capsys, "simulate", "m.yaml", "--plant", "plant", "--measured", log)
    assert refused.code == 1
    assert refused.err.startswith("bare.csv has fewer than 10 rows of a path")
    replayed = run(capsys, "simulate", log, "--plant", "plant", "--measured", log)
    assert replayed.code == 2
    assert "omit --measured" in replayed.err


@pytest.mark.parametrize(
    ("verdict", "words"),
    [
        ("no-missing-effect", "The plant explains the measured wheel speeds, so the cause lies in"),
        ("unexplained", "The plant does not explain the measured wheel speeds"),
    ],
)
def test_a_drive_outside_the_fan_is_never_said_to_miss_nothing(
    verdict: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = SimpleNamespace(effects=(), verdict=verdict, story="Nothing is missing.")
    monkeypatch.setattr("sysid.diagnosis.likely_cause.diagnose", lambda *_, **__: result)
    log = Record(np.zeros((50, 2)), np.zeros((50, 2)), 0.1, ROBOT_INPUTS, ROBOT_OUTPUTS)
    cause = likely_cause(log, model(), None)
    assert cause.name is None
    assert cause.sentence.startswith(words)
