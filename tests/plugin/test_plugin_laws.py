"""Laws of another package fly a mission, and are held to what our own are held to."""

import csv
import math
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, robot_log, run
from example_package import EXAMPLE, Installed
from mission_cases import check_law

LAWS = {
    "guidance": ("line_of_sight", "LineOfSight"),
    "control": ("rate_limited", "RateLimited"),
    "navigation": ("smoothed_odometry", "SmoothedOdometry"),
    "sensors": ("beacon", "Beacon"),
}


@pytest.mark.parametrize("role", LAWS)
def test_a_law_of_the_package_is_pure_and_runs_on_every_namespace(role: str, example: Path) -> None:
    module, name = LAWS[role]
    check_law(role, getattr(import_module(f"sysid_example.{module}"), name)())


def test_a_mission_is_flown_by_laws_of_another_package(
    installed: Installed, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    robot_log(tmp_path / "log.csv", noise=0.01)
    for command in (
        ("fit", "log.csv", "--structure", "arx", "--orders", "na=1 nb=1 nk=1"),
        ("export", "--format", "json"),
    ):
        assert run(capsys, *command).code == 0
    mission = EXAMPLE / "mission.yaml"

    here = run(capsys, "simulate", mission)
    assert here.code == 1
    assert (
        "mission.yaml:3: unknown kind 'line-of-sight' of guidance: the kinds are field" in here.err
    )

    facts = installed.document("simulate", mission, "-o", "flown.csv", folder=tmp_path)
    assert facts["outcome"] == "arrived"
    with (tmp_path / "flown.csv").open() as file:
        rows = [{k: float(v or "nan") for k, v in row.items()} for row in csv.DictReader(file)]
    log = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    # rate-limited: 0.8 drive/s over a period of 0.1 s, but for standing still at the end
    assert np.abs(np.diff(log["v_cmd"][:-1], prepend=0.0)).max() == pytest.approx(0.08)
    # line-of-sight: full speed until half a metre from the goal, then in proportion
    assert log["v_ref"] == pytest.approx(0.25 * np.minimum(1.0, log["rho_goal"] / 0.5))
    assert log["psi_ref"][0] == pytest.approx(math.atan2(0.5, 1.5))
    # smoothed-odometry lags: it believes the goal farther away than it is
    really = np.hypot(log["x"] - 1.5, log["y"] - 0.5)
    assert np.all(log["rho_goal"][5:] > really[5:] + 1e-4)
    assert facts["time_s"] == pytest.approx(len(rows) / 10 - 0.1)
    # beacon: five times a second, with σ = 0.02·√5 m
    assert np.isnan(log["beacon_distance"][1::2]).all()
    error = (log["beacon_distance"] - really)[::2]
    assert 0.5 < np.std(error) / (0.02 * math.sqrt(5)) < 1.5


def test_a_wrong_key_of_such_a_law_is_one_sentence_with_its_line(
    installed: Installed, tmp_path: Path
) -> None:
    mission = tmp_path / "m.yaml"
    mission.write_text("goal: [1, 0]\ncontrol:\n  kind: rate-limited\n  rat: 2\n")
    code = f"from sysid.robot.mission.spec import load_mission; load_mission({str(mission)!r})"
    done = installed.python("-c", code, folder=tmp_path)
    assert "m.yaml:4: unknown key 'rat' in control: did you mean 'rate'?" in done.stderr
