"""Gains by driving: what is tried, judged and proposed, and the mission that is written of it."""

import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Capture, run
from mission_cases import Robot, goal
from plant_models import robot_record

import sysid
from sysid.errors import ModelError, UsageError
from sysid.estimation.pem import fit
from sysid.export.package import write_package
from sysid.robot.mission.batch.figures import Driven, Figures
from sysid.robot.mission.batch.runner import BatchRunner
from sysid.robot.mission.batch.sampler import Numbers
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.contracts import ControlInputs
from sysid.robot.mission.control.axes import AxisController
from sysid.robot.mission.control.linear import PD, P
from sysid.robot.mission.control.pi_p import SpeedPIYawP
from sysid.robot.mission.loop import Verdict
from sysid.robot.mission.result import write_log
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import load_mission
from sysid.robot.mission.tuning.criteria import SHOWN, Criteria, StepTest, criteria
from sysid.robot.mission.tuning.front import front, non_dominated
from sysid.robot.mission.tuning.gain_space import GainSpace
from sysid.robot.mission.tuning.search import SearchOptions, tune
from sysid.robot.mission.tuning.tuned import Tuning
from sysid.robot.mission.tuning.written import replaced, section, write_mission
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

SHORT = goal(1.0, 0.4, obstacles=[(0.5, 0.8)])
FEW = SearchOptions(trials=24, robust=3)


@cache
def model() -> Model:
    orders = {"na": 1, "nb": 1, "nk": 1}
    return fit(structure_class("arx").from_orders(orders, 2, 2), [robot_record(200)])


@cache
def found() -> Tuning:
    return tune(SHORT, model(), FEW)


def objectives(tuning: Tuning) -> np.ndarray:
    rows = [{n: np.array([v]) for n, v in s.criteria.items()} for s in tuning.front]
    tables = [Criteria(**row, arrives=np.ones(1)).objectives(True) for row in rows]
    return np.concatenate(tables)


def test_no_set_of_the_front_beats_another() -> None:
    tuning = found()
    assert len(tuning.front) > 2
    assert non_dominated(objectives(tuning)).all()
    assert all(s.arrives and all(m.stable for m in s.margins.values()) for s in tuning.front)


def test_the_proposed_set_is_no_worse_than_any_that_was_tried() -> None:
    """And it beats most of them in most criteria."""
    tuning = found()
    best = {n: v for n, v in tuning.best.criteria.items() if v is not None}
    sign = {n: -1.0 if n == "min_clearance_m" else 1.0 for n in best}
    better = 0
    for other in tuning.tried:
        values = [(sign[n] * best[n], sign[n] * v) for n, v in other.items() if v is not None]
        assert not all(b <= a for a, b in values) or dict(other) == dict(tuning.best.criteria)
        better += sum(a <= b for a, b in values) > len(values) / 2
    assert better > len(tuning.tried) / 2


@pytest.mark.slow
def test_a_search_is_that_of_its_seed_and_of_its_plants() -> None:
    again = sysid.tune(SHORT, model(), trials=24, robust=3)
    nominal = tune(SHORT, model(), SearchOptions(24, 1))
    assert again.front == found().front
    assert (nominal.plants, found().plants) == (1, 3)
    # The estimated plant is among the drawn ones: the worst of them is nowhere better.
    for name, value in nominal.present.criteria.items():
        worst = found().present.criteria[name]
        assert value is not None
        assert worst is not None
        assert (worst <= value) if name == "min_clearance_m" else (worst >= value)
    assert nominal.present.criteria != found().present.criteria


def test_rules_stand_beside_the_front() -> None:
    rules = {r.name: r for r in found().rules}
    assert set(rules) >= {"ziegler-nichols", "cohen-coon", "lambda", "simc"}
    assert rules["lambda"].axes == ("speed", "yaw")
    assert rules["cohen-coon"].axes == ("speed",)  # which has no rule for an integrator
    assert rules["cohen-coon"].gains["kp_yaw"] == SHORT.control.kp_yaw
    assert rules["lambda"].margins["speed"].stable


def test_runs_side_by_side_are_runs_one_by_one() -> None:
    """With a sensor's noise, and two or three commands a sample."""
    sensors = {"encoders": None}
    mission = goal(0.4, 0.1, obstacles=[(0.2, 0.5)], sensors=sensors, control={"period": 0.04})
    setup = Setup.of(mission, [Robot()], ["parameters"], GainSpace.of(mission.control).names)
    gains = np.array([[2.0, 1.85, 0.4], [0.5, 0.0, 1.5], [9.0, 9.0, 0.1]])
    nominal = setup.plant_variants[0].nominal
    numbers = Numbers(*(np.array([v] * 3) for v in nominal))._replace(gains=gains)
    together, single = (
        BatchRunner(setup, 0, 4, SHOWN, alone=alone).drive(numbers, (0, 7, 7), recorded=True)
        for alone in (False, True)
    )
    for one, other in zip(together.figures, single.figures, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9)
    rows = int(together.figures.time_s.min() / 0.1)
    # hundreds of steps, each rounded otherwise
    np.testing.assert_allclose(together.rows[:rows], single.rows[:rows], rtol=0, atol=1e-9)


class Branching(SpeedPIYawP):
    """A law that asks ``if`` of a number, which nothing that compiles can answer."""

    def step(self, state: Any, inputs: ControlInputs, dt: Any, xp: Any) -> Any:
        return super().step(state, inputs, dt if inputs.estimate.speed < 9 else 0.0, xp)


def test_a_law_that_cannot_be_compiled_is_driven_run_by_run_and_said_so() -> None:
    branching = SHORT.model_copy(update={"control": Branching()})
    few = SearchOptions(8, 1)
    alone, together = tune(branching, model(), few), tune(SHORT, model(), few)
    assert any("the law of control cannot be compiled" in note for note in alone.notes)
    assert not any("compiled" in note for note in together.notes)
    assert [s.gains for s in alone.front] == [s.gains for s in together.front]
    for one, other in zip(alone.front, together.front, strict=True):
        assert one.criteria == pytest.approx(other.criteria, abs=1e-9)


def test_rise_and_overshoot_are_those_of_the_answers() -> None:
    """A first-order lag of the speed; a yaw that goes over by a tenth, and back without."""
    test = StepTest(0.3, 1.0, 5.0, 10.0, 15.0)
    t = np.arange(1500) * 0.01
    v = 0.3 * -np.expm1(-t / 0.5)
    psi = np.where(t < 5, 0.05, np.where(t < 10, np.minimum(0.05 + (t - 5), 1.15), 1.0))
    psi = np.where(t >= 10, np.maximum(1.0 - (t - 10), -1.0), psi)
    ended = Figures(*(np.array([f]) for f in (Verdict.ARRIVED, 15.0, 0, 0, 0, 0, np.inf, 0, 3.0)))
    runs = Driven(ended, t, np.stack([v, psi], axis=1)[:, :, None])
    seen = criteria(test, runs, ended)
    # Lines between samples of 0.01 s are off by a tenth of a millisecond.
    assert seen.rise_speed_s[0] == pytest.approx(0.5 * np.log(9.0), abs=1e-3)
    assert seen.overshoot_speed[0] == 0.0
    assert seen.rise_yaw_s[0] == pytest.approx(0.8, abs=1e-3)
    assert seen.overshoot_yaw[0] == pytest.approx(10.0, abs=1e-6)
    assert seen.error_speed[0] == pytest.approx(0.0, abs=0.02)  # e⁻⁹
    assert seen.error_yaw[0] == pytest.approx(15.0)  # it ended at 1.15 of 1
    slow = criteria(test, runs._replace(rows=runs.rows * [[0.8], [1.0]]), ended)
    assert slow.error_speed[0] == pytest.approx(20.0, abs=0.02)
    assert np.isinf(slow.rise_speed_s[0])


def test_sets_that_nobody_could_tell_apart_are_one() -> None:
    values = np.array([[1.0, 2.0], [1.01, 1.99], [2.0, 1.0], [3.0, 3.0]])
    assert non_dominated(values).tolist() == [True, True, True, False]
    assert len(front(values, np.array([0.5, 0.5])).members) == 2


def test_gains_fill_their_bounds_in_the_logarithm() -> None:
    space = GainSpace.of(AxisController(speed=PD()))
    assert space.names == ("speed.kp", "speed.kd", "yaw.kp")
    points = np.random.default_rng(0).random((400, 3))
    values = space.values(points)
    assert np.all((values >= space.low) & (values <= space.high))
    assert 0.05 < np.mean(values[:, 1] == 0.0) < 0.15  # one in ten goes without it
    assert np.median(values[:, 0]) == pytest.approx(1.0, rel=0.3)  # of 0.1 to 10
    np.testing.assert_allclose(space.values(space.points(values)), values, rtol=1e-2)


def test_a_mission_that_no_gains_can_drive_is_told_in_a_sentence() -> None:
    blocked = SHORT.model_copy(update={"timeout": 2.0})
    with pytest.raises(ModelError, match="none of 8 sets of gains brings the robot to the goal"):
        tune(blocked, model(), SearchOptions(8, 1))
    with pytest.raises(UsageError, match="trials"):
        SearchOptions(trials=3)


def test_a_file_keeps_its_comments_and_gets_the_gains(tmp_path: Path) -> None:
    source, target = tmp_path / "m.yaml", tmp_path / "new.yaml"
    source.write_text(
        "# a mission\ngoal: [1, 0.4]\ncontrol:  # ours\n  kp_yaw: 0.3\n  v_cmd_max: 0.9\n"
        "# what is in the way\nobstacles: [[0.5, 0.8]]\n"
    )
    mission = load_mission(source)
    tuned = AxisController(speed=P(kp=3.0), v_cmd_max=0.9)
    write_mission(source, target, mission.model_copy(update={"control": tuned}))
    text = target.read_text()
    assert text.startswith("# a mission\ngoal: [1, 0.4]\ncontrol:\n")
    assert text.endswith("# what is in the way\nobstacles: [[0.5, 0.8]]\n")
    assert load_mission(target) == mission.model_copy(update={"control": tuned})
    flow = replaced("{goal: [1, 0]}", {"goal": [1.0, 0.0]}, "control", section("control", tuned))
    (tmp_path / "flow.yaml").write_text(flow)
    assert load_mission(tmp_path / "flow.yaml").control == tuned
    with pytest.raises(UsageError, match="itself"):
        write_mission(source, source, mission)


@pytest.mark.slow
def test_the_command_tells_writes_and_draws(tmp_path: Path, capsys: Capture) -> None:
    write_package(model(), tmp_path / "plant")
    source = tmp_path / "m.yaml"
    source.write_text("goal: [1, 0.4]  # near\nobstacles: [[0.5, 0.8]]\n")
    tuned, picture = tmp_path / "tuned.yaml", tmp_path / "front.svg"
    asked = ["tune", source, "--plant", tmp_path / "plant", "--trials", 24, "--plants", 3]
    document = run(capsys, *asked, "-o", tuned, "--plot", picture, "--json").document
    assert {"gains", "front", "margins", "rules", "present"} <= set(document)
    assert document["front"][document["proposed"]]["gains"] == document["gains"]
    assert load_mission(tuned).control.kp_yaw == document["gains"]["kp_yaw"]
    assert picture.stat().st_size > 10_000
    refused = run(capsys, *asked, "-o", source)
    assert (refused.code, refused.err.count("\n")) == (2, 1)


@pytest.mark.slow
def test_the_noise_of_a_filter_is_tuned_to_a_log(tmp_path: Path, capsys: Capture) -> None:
    source, log, tuned = tmp_path / "m.yaml", tmp_path / "log.csv", tmp_path / "new.yaml"
    source.write_text(
        "goal: [0.5, 0.2]\nnavigation:\n  kind: ekf\n  q: {speed: 0.1}\n"
        "sensors: {position_fixes: {noise: 0.05, rate: 10}}  # motion capture\n"
    )
    write_log(simulate(load_mission(source), Robot(), seed=6), log)
    asked = ["tune", source, "--noise-from", log]
    document = run(capsys, *asked, "-o", tuned, "--json").document
    assert {"q", "r", "consistency"} <= set(document)
    law = load_mission(tuned).navigation
    assert law.r["fix_x"] == document["r"]["fix_x"]
    assert "# motion capture" in tuned.read_text()
    refused = run(capsys, *asked, "--control", "pid")
    assert (refused.code, refused.err.count("\n")) == (2, 1)
    refused = run(capsys, "tune", source, "--sensor", "gyro_z=w")
    assert "--noise-from" in refused.err


@pytest.mark.slow
def test_the_page_shows_a_command_that_runs(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (Path(__file__).parents[3] / "docs" / "control.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^sysid (tune .*)$", page, re.MULTILINE)
    monkeypatch.chdir(tmp_path)
    write_package(model(), tmp_path / ".sysid" / "plant")
    (tmp_path / "mission.yaml").write_text("goal: [0.5, 0.2]\n")
    done = run(capsys, *shlex.split(line))
    assert done.code == 0, done.err
    assert (tmp_path / "tuned.yaml").exists()
    assert "proposed" in done.out
    assert "simc" in done.out
