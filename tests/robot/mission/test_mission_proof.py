"""The proof on a mission: replayed and driven again, with and without what was missing."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pose_cases import hidden_mission, logs, true_base

from sysid.diagnosis.pose.diagnosis import diagnose_pose
from sysid.diagnosis.pose.ground_model import with_ground
from sysid.diagnosis.validation.mission import not_this_mission, prove_on_mission
from sysid.errors import ModelError
from sysid.robot.mission.spec import load_mission


@pytest.fixture(scope="module", params=["track-slip", "radius-mismatch"])
def proof(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("mission")
    hidden = hidden_mission(request.param, 1)
    est, val = logs(hidden, folder)
    diagnosis = diagnose_pose([est], [val])
    assert diagnosis is not None
    before = true_base(hidden)
    after = with_ground(before, diagnosis.ground, diagnosis.std_errors)
    found = prove_on_mission(folder / "mission_val.yaml", [val], before, after)
    start = load_mission(folder / "mission_val.yaml").start
    return SimpleNamespace(facts=found, start=start)


def test_the_replayed_path_comes_near_the_measured_one(proof: Any) -> None:
    (replayed,) = proof.facts["open_loop"]
    assert replayed["rms_before_m"] > 0.2
    assert replayed["shrunk_percent"] > 85.0
    wheels = replayed["from_measured_speeds"]
    assert wheels["rms_after_m"] < 0.1 * wheels["rms_before_m"]
    (trace,) = proof.facts["traces"]
    assert len(trace["measured"]) == len(trace["before"]) == len(trace["after"])
    np.testing.assert_allclose(trace["before"][0], proof.start[:2], atol=5e-5)  # four decimals


def test_the_mission_driven_again_ends_where_the_robot_did(proof: Any) -> None:
    driven = proof.facts["closed_loop"]
    assert driven["after"]["path_error_end_m"] < 0.2 * driven["before"]["path_error_end_m"]
    assert driven["after"]["outcome"] == "missed"  # as the measured robot did
    assert abs(driven["after"]["time_error_s"]) < 1.0
    measured, after = driven["measured"]["path_length_m"], driven["after"]["path_length_m"]
    assert after == pytest.approx(measured, rel=0.02)
    assert set(driven) == {"measured", "before", "after"}


def test_the_facts_are_plain_json_and_say_it_in_words(proof: Any) -> None:
    assert json.loads(json.dumps(proof.facts, allow_nan=False)) == proof.facts
    assert "Under the logged commands" in proof.facts["sentence"]
    assert proof.facts["mission"] == "mission_val.yaml"


def test_obstacles_are_kept_clear_of_by_measure(tmp_path: Path) -> None:
    hidden = hidden_mission("", 2)
    est, _ = logs(hidden, tmp_path)
    file = tmp_path / "obstacle.yaml"
    text = (tmp_path / "mission_est.yaml").read_text(encoding="utf-8")
    file.write_text(text + "obstacles: [[-2.0, 0.0, 0.2]]\n", encoding="utf-8")
    plain = true_base(hidden)
    facts = prove_on_mission(file, [est], plain, plain)
    # it lies 2 m behind the start: nobody comes nearer
    assert facts["closed_loop"]["measured"]["min_clearance_m"] == pytest.approx(1.8, abs=0.02)
    assert facts["closed_loop"]["after"]["min_clearance_m"] == pytest.approx(1.8, abs=0.02)


def test_a_log_without_pose_is_refused(tmp_path: Path) -> None:
    hidden = hidden_mission("", 2)
    est, _ = logs(hidden, tmp_path)
    bare = est.__class__(est.u, est.y, est.dt, est.inputs, est.outputs)
    plain = true_base(hidden)
    with pytest.raises(ModelError, match="x, y, psi"):
        prove_on_mission(tmp_path / "mission_est.yaml", [bare], plain, plain)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("start: [1.5, 1.5, 0]", "begins"),
        ("goal: [-4, -4]", "comes no nearer than"),
        ("goal: [0.3, 0.1]", "strays up to"),
    ],
)
def test_a_log_of_another_mission_is_noticed(change: str, words: str, tmp_path: Path) -> None:
    """It used to be driven again all the same, and the models blamed for the way between."""
    hidden = hidden_mission("", 2)
    est, _ = logs(hidden, tmp_path)
    key = change.partition(":")[0]
    lines = (tmp_path / "mission_est.yaml").read_text(encoding="utf-8").splitlines()
    other = tmp_path / "other.yaml"
    kept = [line for line in lines if not line.startswith(f"{key}:")]
    other.write_text("\n".join([*kept, change]) + "\n", encoding="utf-8")
    plain = true_base(hidden)
    facts = prove_on_mission(other, [est], plain, plain)
    assert "was not driven on this mission" in facts["sentence"]
    assert words in facts["sentence"]
    assert set(facts["closed_loop"]) == {"measured"}


@pytest.mark.parametrize("effect", ["", "track-slip", "radius-mismatch"])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_log_of_this_mission_is_not_called_another(
    effect: str, seed: int, tmp_path: Path
) -> None:
    est, val = logs(hidden_mission(effect, seed), tmp_path)
    for log, name in ((est, "mission_est.yaml"), (val, "mission_val.yaml")):
        assert not_this_mission(log, load_mission(tmp_path / name), (0, 1)) == ""
