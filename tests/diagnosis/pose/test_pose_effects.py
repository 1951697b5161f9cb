"""Effects between the tracks and the ground: named from the pose, kept with the model, driven."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pose_cases import DT, driven, ground, hidden_mission, logs, two_tracks, wandering

from sysid.data.record import Array, Record
from sysid.diagnosis.pose import growth
from sysid.diagnosis.pose.diagnosis import PoseDiagnosis, diagnose_pose
from sysid.diagnosis.pose.ground_model import with_ground, without_sensor_effects
from sysid.effects.ground import Ground
from sysid.errors import ModelError, UsageError
from sysid.export.package import write_package
from sysid.plant.package import load_plant, read_description
from sysid.plant.selftest import selftest
from sysid.robot.calibration.ground_fit import PoseProblem, PoseSearch, every_candidate
from sysid.robot.calibration.windows import increments_noise, tracks_of
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.structures.augmented.structure import Augmented
from sysid.structures.model import Model
from sysid.structures.physics import ground_effects
from sysid.vehicle.kinematics import Geometry

EFFECTS = ("track-slip", "radius-mismatch", "track-width")


def found(estimation: Any, held: Any, **options: Any) -> PoseDiagnosis:
    told = diagnose_pose([estimation], [held], **options)
    assert told is not None
    return told


def true_value(truth: dict[str, Any]) -> float:
    (parameters,) = truth["effects"][0]["parameters"].values()
    value = float(next(iter(parameters.values())))
    return 1.0 / value if truth["effects"][0]["id"] == "track-width" else value


@pytest.mark.slow
@pytest.mark.parametrize("noise", ["low", "high"])
@pytest.mark.parametrize("effect", EFFECTS)
def test_a_hidden_effect_is_named_from_mission_logs(
    effect: str, noise: str, tmp_path: Path
) -> None:
    hidden = hidden_mission(effect, 3, noise)
    told = found(*logs(hidden, tmp_path), geometry=Geometry())
    (named,) = told.effects
    assert effect in (named.id, *named.indistinguishable)
    assert named.stage == "vehicle"
    assert told.candidates[0][0] == effect
    assert named.id == effect
    (number,) = named.parameters
    assert number.std_error is not None
    # 4 standard errors, and 1 % of the number for what the kinematics leave out
    allowed = 4.0 * number.std_error + 0.01
    assert number.value == pytest.approx(true_value(hidden.truth), abs=allowed)
    if noise == "low":
        assert told.gap.closed_percent > 90.0


@pytest.mark.parametrize("seed", range(1, 5))
def test_nothing_is_named_where_nothing_is_hidden(seed: int, tmp_path: Path) -> None:
    told = found(*logs(hidden_mission("", seed, "high" if seed % 2 else "low"), tmp_path))
    assert not told.effects
    assert not told.ground
    assert not told.warnings


@pytest.mark.parametrize(("left", "right", "side"), [(0.94, 1.0, "left"), (1.0, 1.05, "right")])
def test_the_odd_track_is_named(left: float, right: float, side: str) -> None:
    odd = ground("radius-mismatch", left, right)
    told = found(driven(wandering(), odd), driven(wandering(seed=6), odd, seed=2))
    assert [e.id for e in told.effects] == ["radius-mismatch"]
    assert told.effects[0].parameters[0].name == f"rho[{side}]"
    assert f"The {side} side" in told.effects[0].sentence
    np.testing.assert_allclose(
        told.ground.parameters["radius-mismatch"]["rho"], [left, right], atol=0.004
    )


def test_another_radius_of_both_tracks_is_no_mismatch() -> None:
    wide = Geometry(r=0.0225)
    parts = [driven(wandering(seed=s), seed=s, geometry=wide) for s in (5, 6)]
    told = found(*parts)
    assert not told.effects
    assert any("set vehicle.r" in w for w in told.warnings)
    assert not found(*parts, geometry=wide).warnings


def test_an_offset_of_the_speeds_is_no_effect_of_the_vehicle() -> None:
    parts = [driven(wandering(seed=s), seed=s) for s in (5, 6)]
    told = found(*(replace(r, y=r.y + np.array([0.8, 0.0]), sha256="") for r in parts))
    assert not told.effects
    assert any("at standstill" in w for w in told.warnings)


@pytest.mark.slow
def test_slip_and_width_are_a_tie_in_pure_turns() -> None:
    spin = np.abs(wandering()[:, :1]) * np.array([-1.0, 1.0])
    slip = ground("track-slip", 0.2)
    told = found(driven(spin, slip), driven(spin[::-1], slip, seed=2), geometry=Geometry())
    assert len(told.effects) == 1
    assert {told.effects[0].id, *told.effects[0].indistinguishable} == {"track-slip", "track-width"}


def test_two_effects_are_both_named() -> None:
    both = Ground(
        ("radius-mismatch", "track-slip"),
        {
            "track-slip": {"share": np.full(2, 0.2)},
            "radius-mismatch": {"rho": np.array([0.93, 1.0])},
        },
    )
    assert both.effects == ("track-slip", "radius-mismatch")  # as the chain of the ground has them
    told = found(driven(wandering(), both), driven(wandering(seed=6), both, seed=2))
    assert {e.id for e in told.effects} == {"track-slip", "radius-mismatch"}
    assert told.gap.closed_percent > 95.0


@pytest.mark.slow
def test_a_wrapped_heading_and_holes_do_no_harm() -> None:
    slip = ground("track-slip", 0.25)
    whole = [driven(wandering(seed=s), slip, seed=s) for s in (5, 6)]
    damaged = []
    for r in whole:
        assert r.pose is not None
        pose = r.pose.copy()
        pose[:, 2] = np.angle(np.exp(1j * pose[:, 2]))
        pose[100:110] = np.nan
        damaged.append(replace(r, pose=pose))
    first, second = found(*whole), found(*damaged)
    assert [e.id for e in second.effects] == ["track-slip"]
    assert second.windows < first.windows
    assert second.effects[0].parameters[0].value == pytest.approx(0.25, abs=0.02)


def test_without_pose_or_tracks_there_is_nothing_to_say() -> None:
    r = driven(wandering(200))
    assert diagnose_pose([replace(r, pose=None)], [replace(r, pose=None)]) is None
    assert diagnose_pose([r.select(["pwm_l"], ["omega_l"])], [r]) is None
    assert diagnose_pose([r.rows(0, 60)], [r.rows(60, 90)]) is None


@pytest.mark.slow
def test_one_log_is_judged_in_stretches() -> None:
    slip = ground("track-slip", 0.2)
    told = diagnose_pose([driven(wandering(), slip)], [])
    assert told is not None
    assert [e.id for e in told.effects] == ["track-slip"]
    assert min(told.windows) >= 20


def test_what_the_log_could_not_have_shown_is_said() -> None:
    straight = np.full((600, 2), 10.0) + 2.0 * np.sin(np.arange(600) / 30.0)[:, None]
    told = found(driven(straight), driven(straight, seed=2))
    # noise of the speeds looks like a little turning: a share beyond any real one is what is left
    slip = told.detectable["track-slip"]
    assert slip is not None
    assert slip > 0.3
    assert told.detectable["radius-mismatch"] is not None
    assert told.detectable["radius-mismatch"] < 0.05


# The model with its ground ------------------------------------------------------------------------


def slipping() -> Model:
    return with_ground(
        two_tracks(), ground("track-slip", 0.25), {"track-slip": {"share": np.full(2, 0.01)}}
    )


def test_a_model_keeps_its_ground() -> None:
    model = slipping()
    again = Model.from_json(json.loads(json.dumps(model.to_json())))
    assert ground_effects(again.structure, again.theta).effects == ("track-slip",)
    (row,) = [p for p in again.parameter_table() if p.name == "track-slip.share"]
    assert (row.value, row.std_error) == (0.25, pytest.approx(0.01))
    u = 15000.0 * np.sign(np.sin(np.arange(80)[:, None] / np.array([5.0, 7.0])))
    np.testing.assert_array_equal(again.simulate(u), two_tracks().simulate(u))


def test_sides_keep_their_numbers_in_a_model_whose_outputs_come_the_other_way_round() -> None:
    odd = ground("radius-mismatch", 0.9, 1.0)
    for tracks, expected in (((0, 1), [0.9, 1.0]), ((1, 0), [1.0, 0.9])):
        model = with_ground(two_tracks(), odd, {}, tracks)
        held = ground_effects(model.structure, model.theta)
        np.testing.assert_array_equal(held.parameters["radius-mismatch"]["rho"], expected)
        np.testing.assert_array_equal(
            held.ordered(tracks).parameters["radius-mismatch"]["rho"], [0.9, 1.0]
        )


def test_a_package_keeps_the_ground_and_its_selftest(tmp_path: Path) -> None:
    write_package(slipping(), tmp_path / "plant")
    assert selftest(tmp_path / "plant") < 1e-9
    assert read_description(tmp_path / "plant")["ground"] == {"track-slip": {"share": [0.25, 0.25]}}
    assert load_plant(tmp_path / "plant").ground(-4.0, 4.0) == pytest.approx((-3.0, 3.0))
    card = (tmp_path / "plant" / "README.md").read_text(encoding="utf-8")
    assert "track-slip" in card


def test_a_mission_slips_with_the_plant(tmp_path: Path) -> None:
    mission = Mission(goal=(2.0, 2.0), timeout=60.0)
    write_package(slipping(), tmp_path / "plant")
    runs = []
    for plant in (two_tracks().plant(), load_plant(tmp_path / "plant")):
        robot, notes = as_robot(plant, mission)
        assert not notes
        runs.append(simulate(mission, robot))
    plain, slipped = runs
    # navigation sees the wheels alone, so that both drive the same and end elsewhere
    np.testing.assert_allclose(plain.log["omega_l"], slipped.log["omega_l"])
    assert np.hypot(*np.subtract(plain.final[:2], slipped.final[:2])) > 0.1
    assert slipped.path_length_m < plain.path_length_m
    assert abs(slipped.final[2]) < abs(plain.final[2])


def test_wheels_without_what_only_the_sensor_does() -> None:
    base = two_tracks()
    structure = Augmented(1, 1, (20000.0, 20000.0), DT, ("sensor-bias",))
    theta = np.array([*base.theta, 1.0, 2.0])
    biased = replace(
        base,
        structure=structure,
        theta=theta,
        covariance=np.eye(6),
        parameters=structure.parameters(base.inputs, base.outputs),
    )
    u = np.full((20, 2), 8000.0)
    np.testing.assert_allclose(without_sensor_effects(biased).simulate(u), base.simulate(u))
    np.testing.assert_allclose(biased.simulate(u) - base.simulate(u), np.tile([1.0, 2.0], (20, 1)))


def test_refusals_say_what_to_do() -> None:
    with pytest.raises(UsageError, match="dead-zone does not act between"):
        Ground(("dead-zone",), {})
    with pytest.raises(ModelError, match="already"):
        with_ground(slipping(), ground("track-width", 0.9), {})


def noisier(record: Record, heading: float, seed: int) -> Record:
    """The same with more noise of the heading [rad]."""
    assert record.pose is not None
    more = np.random.default_rng(seed).normal(0.0, heading, len(record.pose))
    return replace(record, pose=record.pose + np.outer(more, [0.0, 0.0, 1.0]))


@pytest.mark.slow
@pytest.mark.parametrize("heading", [0.0, 0.03])
def test_standard_errors_hold_the_truth_whatever_the_heading_is_worth(heading: float) -> None:
    true = ground("radius-mismatch", 0.94, 1.0)
    z = []
    for seed in range(12):
        logs_ = [
            noisier(driven(wandering(600, 20 + k), true, seed=seed + k), heading, 50 + seed + k)
            for k in (0, 30)
        ]
        (named,) = found(*logs_).effects
        (number,) = named.parameters
        assert number.std_error is not None
        z.append((number.value - 0.94) / number.std_error)
    # of 12 normal z the root mean square is below 1.6 in 99.9 % of the cases; 25 % for what windows
    # that share a reading tell twice
    assert np.sqrt(np.mean(np.square(z))) < 2.0


@pytest.mark.slow
def test_a_small_effect_beside_a_large_one_is_named() -> None:
    both = Ground(
        ("track-slip", "radius-mismatch"),
        {
            "track-slip": {"share": np.full(2, 0.26)},
            "radius-mismatch": {"rho": np.array([1.0, 0.966])},
        },
    )
    told = found(driven(wandering(700, 3), both, seed=1), driven(wandering(500, 4), both, seed=2))
    values = {e.id: e.parameters[0].value for e in told.effects}
    assert values["track-slip"] == pytest.approx(0.26, abs=0.01)
    assert values["radius-mismatch"] == pytest.approx(0.966, abs=0.005)


def test_a_slope_gets_no_name_and_is_not_called_noise() -> None:
    def sliding(record: Record) -> Record:
        assert record.pose is not None
        down = 0.03 * DT * np.arange(len(record.pose))
        return replace(record, pose=record.pose + np.outer(down, [0.0, 1.0, 0.0]))

    told = found(sliding(driven(wandering(600, 3))), sliding(driven(wandering(500, 4), seed=2)))
    assert not told.effects
    assert told.residuals.structured
    assert "y" in told.residuals.above_noise
    assert "missing from the catalogue" in told.residuals.sentence
    clean = found(driven(wandering(600, 3)), driven(wandering(500, 4), seed=2))
    assert not clean.residuals.above_noise
    assert not clean.residuals.sentence


def test_sliding_sideways_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    slow = ("longitudinal-slip", "radius-mismatch", "scrub-lag")
    few = tuple(c for c in every_candidate() if c.id not in slow)
    monkeypatch.setattr(growth, "every_candidate", lambda: few)
    values = {"ahead": np.full(2, -0.02), "drift": np.zeros(2)}
    slides = Ground(("lateral-slip",), {"lateral-slip": values})
    told = found(*(driven(wandering(200, s), slides, s) for s in (5, 6)), geometry=Geometry())
    (effect,) = told.effects
    assert effect.id == "lateral-slip"
    assert "m behind the logged point" in effect.sentence
    (parameter,) = effect.parameters
    assert parameter.std_error
    assert abs(parameter.value + 0.02) < 3.0 * parameter.std_error
    assert told.gap.closed_percent > 90.0


def test_a_width_and_wheels_that_spin_at_starts_are_proven_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rivals = {"track-width", "longitudinal-slip spin", "lateral-slip ahead"}
    few = tuple(c for c in every_candidate() if c.key in rivals)
    monkeypatch.setattr(growth, "every_candidate", lambda: few)
    both = Ground(
        ("track-width", "longitudinal-slip"),
        {
            "track-width": {"ratio": np.full(2, 0.85)},
            "longitudinal-slip": {"spin": np.full(2, 0.05)},
        },
    )
    tracks = [tracks_of([driven(hard_turns(s), both, s)], (0, 1)) for s in (1, 2)]
    noise = increments_noise(sum(tracks, ()), Geometry())
    search = PoseSearch(*(PoseProblem(t, Geometry(), noise) for t in tracks))
    base = search.fit(())
    (width,) = [c for c in few if c.id == "track-width"]
    alone = growth.judged(search, base, [(width, search.fit([width], base))])
    pair = growth.together(search, base, alone, ())
    assert pair is not None
    assert [s.candidate.key for s in pair] == ["track-width", "longitudinal-slip spin"]


def hard_turns(seed: int) -> Array:
    """Turns on the spot of 0.4 s to 1.2 s and drives between them, all begun and ended at once."""
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(6):
        way = rng.choice([-1.0, 1.0]) * 8.0
        parts += [np.tile([-way, way], (int(rng.integers(4, 12)), 1)), np.tile([8.0, 8.0], (10, 1))]
    return np.concatenate(parts)
