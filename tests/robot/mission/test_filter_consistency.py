"""Errors of filters against what they believe: inside χ² bounds where the model is right."""

from typing import Any

import numpy as np
import pytest
from mission_cases import goal

from studies.filter_truth import own_run
from sysid.robot.mission.contracts import Scene
from sysid.robot.mission.navigation.consistency import Consistency, consistency
from sysid.robot.mission.navigation.ekf import ExtendedKalman
from sysid.robot.mission.registry import law_class

RUNS, SAMPLES = 100, 12
RIGHT = ExtendedKalman(gate=1.0, q={"speed": 0.02, "yaw_rate": 0.2, "slip": 0.0})


def scene(law: ExtendedKalman) -> Scene:
    kinds = {k: law_class("sensors", k)() for k in ("encoders", "gyroscope", "position_fixes")}
    return goal(1, 0, navigation=law, sensors=kinds).scene()


def judged(law: ExtendedKalman) -> Consistency:
    where = scene(law)
    return consistency([own_run(law, where, SAMPLES, seed, RIGHT) for seed in range(RUNS)])


def test_a_filter_whose_model_is_right_is_consistent() -> None:
    """Bounds of 99 %: one seed in a hundred would lie outside."""
    comparison = judged(RIGHT)
    assert comparison.runs == RUNS
    assert comparison.nis is not None
    assert comparison.nees is not None
    assert (comparison.nis.verdict, comparison.nees.verdict) == ("consistent", "consistent")
    assert "is consistent" in comparison.sentence


@pytest.mark.parametrize(
    ("keys", "verdict"),
    [
        ({"r": {"fix_x": 1e-6, "fix_y": 1e-6}}, "over-confident"),
        ({"sigma_position": 0.01, "sigma_heading": 0.02}, "too cautious"),
    ],
)
def test_a_filter_whose_noise_is_wrong_is_told_so(keys: dict[str, Any], verdict: str) -> None:
    """Fixes believed ten times too well; a start believed ten times too badly."""
    wrong = RIGHT.model_copy(update=keys)
    comparison = judged(wrong)
    assert comparison.nees is not None
    assert comparison.nees.verdict == verdict
    assert verdict in comparison.sentence


def test_without_the_truth_there_is_no_nees() -> None:
    run = {"nis": np.array([0.0, 1.0, np.nan]), "nis_dof": np.array([0.0, 2.0, 0.0])}
    consistency_result = consistency([run])
    assert consistency_result.nees is None
    assert consistency_result.nis is not None
    assert consistency_result.nis.mean == 0.5
