"""Many runs at once: they are the single runs, drawn as their figures say, told honestly."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from mission_cases import Robot, goal
from plant_models import robot_record
from pose_cases import two_tracks

from benchmarks.agreement import TOLERANCE, agreement
from sysid.diagnosis.pose.ground_model import with_ground
from sysid.effects.ground import Ground
from sysid.errors import DataError, ModelError, UsageError
from sysid.estimation.pem import fit
from sysid.export.package import write_package
from sysid.robot.mission.batch.runner import BatchRunner
from sysid.robot.mission.batch.sampler import Sampler, run_seeds
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.batch.varied_plant import ModelPlant
from sysid.robot.mission.monte_carlo.mission_runs import MissionRuns, wilson
from sysid.robot.mission.monte_carlo.runs import paths_of, simulate_runs
from sysid.robot.mission.monte_carlo.variance_shares import moments, shares
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import load_mission
from sysid.robot.mission.variation import Spread, Variation
from sysid.structures.model import Model
from sysid.structures.registry import structure_class
from sysid.structures.special_runs import stable_parts

SHORT = goal(1.2, 0.5, obstacles=[(0.7, 0.0)])


@cache
def robot_model() -> Model:
    """A model without a parameter too many: none of its draws is unstable."""
    orders = {"na": 1, "nb": 1, "nk": 1}
    return fit(structure_class("arx").from_orders(orders, 2, 2), [robot_record()])


@cache
def batch() -> MissionRuns:
    return simulate_runs(SHORT, [robot_model()], 1500, seed=4)


# The same runs as one after the other ------------------------------------------------------------


@pytest.mark.slow
def test_runs_at_once_are_runs_alone() -> None:
    """Two or three commands a sample, a sensor, everything varied."""
    mission = goal(
        0.5, 0.2, obstacles=[(0.3, 0.6)], sensors={"gyroscope": None}, control={"period": 0.04}
    )
    setup = Setup.of(mission, [robot_model()])
    assert setup.varied == ("parameters", "noise", "start", "obstacles", "friction")
    seeds = run_seeds(1, 12)
    samples = setup.plant_variants[0].sampler.draw(seeds)
    figures = BatchRunner(setup, 0, 16).of(samples).figures
    agreed = agreement(setup, seeds, figures)
    assert agreed.apart == ()
    assert agreed.largest < TOLERANCE
    assert len(set(figures.x.tolist())) == len(seeds)  # the padding is not among them
    moved = figures._replace(x=figures.x + 1e-6)
    assert len(agreement(setup, seeds, moved).apart) == len(seeds)  # it can fail


@pytest.mark.parametrize("kind", ["odometry", "compass"])
def test_a_plant_that_is_no_model_runs_at_once_too(kind: str) -> None:
    setup = Setup.of(goal(0.4, 0, navigation={"kind": kind}), [Robot()])
    noise = ("noise",) if kind == "compass" else ()
    assert setup.varied == (*noise, "start", "friction")
    seeds = run_seeds(0, 4)
    figures = BatchRunner(setup, 0, 4).of(setup.plant_variants[0].sampler.draw(seeds)).figures
    assert agreement(setup, seeds, figures).apart == ()


# What is drawn ------------------------------------------------------------------------------------


def test_a_ground_that_remembers_and_slides_is_the_same_in_a_batch() -> None:
    slides = {"ahead": np.full(2, 0.02), "drift": np.full(2, 0.1)}
    numbers = {"scrub-lag": {"lag": np.full(2, 0.3)}, "lateral-slip": slides}
    ground = Ground(tuple(numbers), numbers)
    setup = Setup.of(SHORT, [with_ground(two_tracks(), ground, {})])
    seeds = run_seeds(1, 3)
    figures = BatchRunner(setup, 0, 4).of(setup.plant_variants[0].sampler.draw(seeds)).figures
    assert agreement(setup, seeds, figures).apart == ()


def sampler(**vary: object) -> Sampler:
    mission = SHORT.model_copy(update={"vary": Variation.model_validate(vary)})
    return Setup.of(mission, [robot_model()]).plant_variants[0].sampler


def test_draws_have_the_covariance_of_the_estimate() -> None:
    model = robot_model()
    samples = sampler(friction=False).draw(run_seeds(0, 4000))
    assert samples.redrawn.sum() == 0
    error = np.sqrt(np.diag(model.covariance))
    standardised = (samples.theta - model.theta) / error
    # 4000 draws give a correlation within 4/√4000 = 0.063
    np.testing.assert_allclose(
        np.cov(standardised.T), model.covariance / np.outer(error, error), atol=0.07
    )
    np.testing.assert_allclose(samples.start.std(axis=0), (0.02, 0.02, 0.03), rtol=0.05)


def test_what_is_left_out_changes_nothing_else() -> None:
    seeds = run_seeds(3, 5)
    every, few = sampler().draw(seeds), sampler(obstacles=False, parameters=False).draw(seeds)
    np.testing.assert_array_equal(every.start, few.start)
    np.testing.assert_array_equal(every.slip, few.slip)
    np.testing.assert_array_equal(few.theta, np.tile(robot_model().theta, (5, 1)))
    np.testing.assert_array_equal(few.obstacles, np.tile((0.7, 0.0), (5, 1, 1)))
    alone = sampler().draw(seeds[2:3])
    np.testing.assert_array_equal(alone.theta[0], every.theta[2])


def test_draws_that_nobody_could_drive_are_made_again() -> None:
    far = sampler(obstacles=0.4, start=False).draw(run_seeds(0, 300))
    gap = np.hypot(*(far.obstacles[:, 0] - (0.0, 0.0)).T)
    assert far.redrawn.sum() > 0
    assert gap.min() > 0.15  # the obstacle's radius
    around = goal(1.2, 0.5, obstacles=[(0.7, 0.0, 0.69)], vary={"obstacles": [-0.5, -0.5]})
    hopeless = Setup.of(around, [robot_model()]).plant_variants[0].sampler
    with pytest.raises(ModelError, match="inside an obstacle"):
        hopeless.draw([1])


class Narrow(ModelPlant):
    """A plant that is only feasible where its first parameter is nearly as estimated."""

    def feasible(self, thetas: np.ndarray) -> np.ndarray:
        error = np.sqrt(self.model.covariance[0, 0])
        return np.asarray(np.abs(thetas[:, 0] - self.theta[0]) < 1e-3 * error)


def test_a_direction_that_leads_nowhere_is_drawn_less_far() -> None:
    plant = Narrow(robot_model())
    samples = Sampler(SHORT, plant, SHORT.vary).draw(run_seeds(0, 200))
    assert samples.pulled.mean() > 0.9
    assert plant.feasible(samples.theta).all()
    last = plant.theta.size - 1  # of the other track, which the first one hardly is tied to
    error = np.sqrt(plant.model.covariance[last, last])
    assert 0.8 < np.std(samples.theta[:, last]) / error < 1.2


def test_a_path_that_would_be_unstable_stays_as_estimated() -> None:
    """Poles of paths that do nothing are unknown: what else is drawn of such a plant is kept."""
    alone = structure_class("oe").from_orders({"nb": 1, "nf": 1, "nk": 1}, 2, 2)
    plant = ModelPlant(fit(alone, [robot_record()]))
    z, dry = np.random.default_rng(0).standard_normal((300, plant.size)), np.ones(300)
    drawn = plant.drawn(z, dry)
    settled = plant.settled(drawn)
    unstable = ~plant.feasible(drawn)
    assert unstable.mean() > 0.1
    assert plant.feasible(settled).all()
    np.testing.assert_array_equal(settled[~unstable], drawn[~unstable])
    for part in stable_parts(plant.model.structure):
        kept = (settled[:, part] == drawn[:, part]).all(axis=1)
        assert (kept | (settled[:, part] == plant.theta[part]).all(axis=1)).all()
    samples = Sampler(SHORT, plant, SHORT.vary).draw(run_seeds(0, 200))
    assert samples.redrawn.sum() == 0
    assert 0.1 < samples.pulled.mean() < 1.0


def test_a_range_is_drawn_evenly() -> None:
    spread = Spread.model_validate([-1.0, 3.0])
    result = spread.deviation(np.random.default_rng(0).standard_normal(4000))
    assert result.min() > -1.0
    assert result.max() < 3.0
    np.testing.assert_allclose(np.quantile(result, (0.25, 0.5, 0.75)), (0, 1, 2), atol=0.1)


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ("vary: {start: {x: -1}}", "m.yaml:2: vary.start.x"),
        ("vary: {obstacles: [3, 1]}", "m.yaml:2: vary.obstacles"),
        ("vary: {wind: 1}", "unknown key 'wind' in vary: the keys are parameters"),
        ("vary: {start: {phi: 1}}", "unknown key 'phi' in vary.start: did you mean 'psi'"),
        ("vary: {friction: {slip: true}}", "vary.friction.slip"),
    ],
)
def test_a_mistake_in_what_varies_is_named_with_its_line(
    section: str, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(f"goal: [1, 0]\n{section}\n")
    with pytest.raises(DataError) as caught:
        load_mission(path)
    assert words in str(caught.value)


# What is told -------------------------------------------------------------------------------------


def test_intervals_are_wilsons() -> None:
    # Newcombe 1998, table I: 81 of 263, and 0 of 20
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert wilson(20, 20) == pytest.approx((0.8389, 1.0), abs=5e-5)


def test_shares_of_variance_are_found() -> None:
    """y = 3a + (b² − 1) + 2ab + noise: 9, 2, 4 and 1 of 16."""
    rng = np.random.default_rng(2)
    z = rng.standard_normal((8000, 12))
    y = 3 * z[:, 0] + z[:, 1] ** 2 + 2 * z[:, 0] * z[:, 1] + rng.standard_normal(8000)
    varying = (("a", (0,)), ("b", (1,)), ("many", tuple(range(2, 12))))
    counts = np.ones(8000, dtype=bool)
    halves = [moments(z[s], varying, y[s], counts[s]) for s in (slice(4000), slice(4000, None))]
    ranking = shares(sum(halves), varying)
    assert ranking is not None
    assert [d.name for d in ranking.ranked] == ["a", "b", "many"]
    shown = [d.share_of_variance for d in ranking.ranked]
    # shares of 8000 runs are known to a hundredth or two
    assert shown == pytest.approx([9 / 16, 2 / 16, 0.0], abs=0.03)
    assert ranking.remainder == pytest.approx(5 / 16, abs=0.04)
    few = moments(z[:40], varying, y[:40], counts[:40])
    assert shares(few, varying) is None


def test_a_batch_tells_what_its_runs_came_to() -> None:
    runs = batch()
    summary = runs.summary()
    assert sum(o["count"] for o in summary["outcomes"].values()) == summary["n"] == 1500
    assert summary["time_s"]["p05"] <= summary["time_s"]["p50"] <= summary["time_s"]["p95"]
    assert "of 1 500 runs" in runs.sentence
    said = replace(runs, redrawn=300).sentence  # 300 of 1 800 draws
    assert "1 500 runs (16.7 % of the draws could not be driven and were replaced)" in said
    assert {d["name"] for d in summary["drivers"]} == {
        "parameters", "start.x", "start.y", "start.psi", "obstacles[1]", "friction.slip",
    }  # fmt: skip


def replayed(setup: Setup, seed: int) -> MissionResult:
    """A run of a batch, alone."""
    mission, robot, noise = setup.alone(seed)
    return simulate(mission, robot, noise, setup.known(seed))


def test_paths_are_those_of_the_runs() -> None:
    setup, runs = Setup.of(SHORT, [robot_model()]), batch()
    for path, seed in zip(paths_of(setup, runs.seeds[:2]), runs.seeds, strict=False):
        log = replayed(setup, seed).log
        np.testing.assert_allclose(path, np.column_stack([log["x"], log["y"]]), atol=TOLERANCE)


def test_a_worst_run_replays_alone() -> None:
    setup, runs = Setup.of(SHORT, [robot_model()]), batch()
    worst = runs.worst[0]
    alone = replayed(setup, worst.seed)
    assert (alone.outcome.value, alone.time_s) == (worst.outcome, worst.time_s)
    assert worst.time_s == max(runs.time_s)


@pytest.mark.parametrize(("runs", "vary"), [(0, None), (10, ["wind"])])
def test_numbers_and_names_without_sense_are_refused(runs: int, vary: list[str] | None) -> None:
    with pytest.raises(UsageError):
        simulate_runs(SHORT, [robot_model()], runs, vary=vary)


# On the command line ------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_drives_many_and_replays_one(tmp_path: Path, capsys: Capture) -> None:
    mission = tmp_path / "short.yaml"
    write_package(robot_model(), tmp_path / "plant")
    mission.write_text("goal: [0.6, 0.2]\nvary: {start: {x: 0.05, psi: 0.1}}\n")
    place = ("--plant", tmp_path / "plant", "--workspace", tmp_path / "w")
    batch = ("simulate", mission, "--runs", 40, "--seed", 5, *place)
    many = run(capsys, *batch, "--plot", tmp_path / "fan.svg", "--json").document
    assert (tmp_path / "fan.svg").read_text().startswith("<?xml")
    runs = many["runs"]
    assert set(runs["outcomes"]) == {"arrived", "missed", "collision", "stuck", "timeout"}
    assert set(runs["outcomes"]["arrived"]) == {"count", "share", "interval"}
    assert set(runs["time_s"]) == {"p05", "p50", "p95"}
    assert runs["vary"] == ["parameters", "start", "friction"]
    rows = Path(many["log"]).read_text().splitlines()
    assert len(rows) == 41
    worst = runs["worst"][0]
    alone = run(capsys, "simulate", mission, "--seed", worst["seed"], *place, "--json").document
    assert (alone["outcome"], alone["time_s"]) == (worst["outcome"], worst["time_s"])
    shown = run(capsys, *batch, "--vary", "parameters,start,friction")
    assert "of 40 runs" in shown.out
    assert "--vary parameters,start,friction" in shown.out
    refused = run(capsys, "simulate", mission, "--vary", "start", *place)
    assert refused.code == 2


def test_runs_of_several_models_have_one_each() -> None:
    other = fit(structure_class("oe").from_orders({"nb": 1, "nf": 1}, 2, 2), [robot_record()])
    mission = goal(0.3, 0.1, vary={"models": True, "parameters": False})
    setup = Setup.of(mission, [robot_model(), other])
    seeds = run_seeds(0, 200)
    # each as likely as the other: 200 tosses lie within four standard deviations of 100
    assert 72 <= sum(setup.choice(s) for s in seeds) <= 128
    assert setup.varied == ("start", "friction", "models")
    assert {type(setup.plants[setup.choice(s)].model.structure).__name__ for s in seeds} == {
        "ARX",
        "OE",
    }
