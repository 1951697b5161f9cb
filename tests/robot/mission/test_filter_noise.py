"""Noise of a filter from a log of its sensors."""

from dataclasses import replace
from pathlib import Path

import pytest
from mission_cases import Robot

from sysid.errors import DataError
from sysid.robot.mission.result import write_log
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tuning.filter_noise import RULE, tuned_filter

QUICK = replace(RULE, rows=60, sweeps=1)


def mission(noise: float, kind: str = "odometry") -> Mission:
    sensors = {"position_fixes": {"noise": noise, "rate": 10.0}}
    return Mission.model_validate(
        {"goal": (2, 1), "navigation": {"kind": kind}, "sensors": sensors}
    )


@pytest.mark.slow
def test_the_variance_of_fixes_is_found_where_the_file_is_wrong(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    driven = mission(0.05)
    write_log(simulate(driven, Robot(), seed=6), log)
    tuning = tuned_filter(log, mission(0.002, "ekf"), rule=QUICK)
    samples = QUICK.rows
    assert len(tuning.before.log.t) > samples
    # A variance of n normal numbers is known to √(2/n) of itself; x and y share one: 4 σ.
    true = 0.05**2 * 10.0  # the density, over ten fixes a second
    assert tuning.r["fix_x"] == pytest.approx(true, rel=4 * (1 / samples) ** 0.5)
    assert tuning.r["fix_x"] == tuning.r["fix_y"]
    before, after = tuning.log_likelihood
    assert after > before + 100
    # Two wheels and two fixes a sample: the most likely noise makes innovations as large as
    # believed; those of the wheels, which are read exactly here, may stay below.
    assert 1.9 < tuning.after.consistency["nis_mean"] < 4.8
    assert tuning.before.consistency["nis_mean"] > 100
    assert tuning.after.errors["position_rms_m"] < tuning.before.errors["position_rms_m"]
    assert "rose by" in tuning.sentence
    assert tuning.summary()["r"] == tuning.r


def test_a_navigation_without_noise_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no noise to tune: name a filter"):
        tuned_filter(tmp_path / "log.csv", mission(0.01))
