"""Where a robot was: the navigation of a mission over a log of its sensors."""

from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from mission_cases import Robot

from sysid.errors import DataError
from sysid.robot.mission.localize import localize
from sysid.robot.mission.result import write_columns, write_log
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, load_mission

MISSION = """goal: [3, 1]
navigation: {kind: ekf}
sensors:
  encoders:
  gyroscope:
  position_fixes: {rate: 2}
"""


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Mission]:
    """A mission with sensors: its file, its log, and what it is."""
    folder = tmp_path_factory.mktemp("estimate")
    path, log = folder / "m.yaml", folder / "log.csv"
    path.write_text(MISSION)
    mission = load_mission(path)
    write_log(simulate(mission, Robot(), seed=4), log)
    return path, log, mission


def columns(log: Path) -> dict[str, np.ndarray]:
    table = np.genfromtxt(log, delimiter=",", names=True)
    return {name: table[name] for name in table.dtype.names}


def test_the_log_of_a_mission_gives_the_estimate_of_its_loop(
    driven: tuple[Path, Path, Mission],
) -> None:
    _, log, mission = driven
    localization, loop = localize(log, mission), columns(log)
    for name in ("x_est", "y_est", "psi_est", "P_xx", "P_psi"):
        # The same filter on numbers that went through a file, which keeps all their digits.
        np.testing.assert_allclose(localization.columns[name], loop[name], rtol=1e-9, atol=1e-12)
    assert localization.errors["position_rms_m"] < 0.02  # fixes of 1 cm and wheels
    assert {"gyro_z", "fix_x", "omega_l"} <= set(localization.used)


def test_columns_of_other_names_and_units_are_found(
    driven: tuple[Path, Path, Mission], tmp_path: Path
) -> None:
    _, log, mission = driven
    own, other = localize(log, mission), tmp_path / "other.csv"
    table = columns(log)
    renamed = {
        "time [ms]": table["t"] * 1e3,
        "speed_left [rpm]": table["omega_l"] * 30 / np.pi,
        "speed_right [rpm]": table["omega_r"] * 30 / np.pi,
        "imu_wz [deg/s]": -np.degrees(table["gyro_z"]),
        "fix_x": table["fix_x"],
        "fix_y": table["fix_y"],
        "pwm_l": table["pwm_l"],
        "pwm_r": table["pwm_r"],
    }
    write_columns(renamed, other)
    localization = localize(other, mission, {"gyro_z": "-imu_wz"})
    assert localization.errors == {}  # no pose, no truth
    np.testing.assert_allclose(localization.columns["x_est"], own.columns["x_est"], atol=1e-9)
    np.testing.assert_allclose(localization.columns["psi_est"], own.columns["psi_est"], atol=1e-9)
    over = localize(other, mission, {"gyro_z": "imu_wz"})
    assert any("upside-down sensor" in note for note in over.notes)
    assert not any("upside-down sensor" in note for note in localization.notes)


def test_a_filter_that_believes_too_much_is_told_so(driven: tuple[Path, Path, Mission]) -> None:
    _, log, mission = driven
    sure = mission.navigation.model_copy(update={"r": {"fix_x": 1e-6, "fix_y": 1e-6}, "gate": 1.0})
    localization = localize(log, mission.model_copy(update={"navigation": sure})).consistency
    assert localization["nis_mean"] > localization["nis_bounds"][1]
    assert localization["nees_mean"] > localization["nees_bounds"][1]


def test_the_heading_is_judged_as_the_position_is(
    driven: tuple[Path, Path, Mission], tmp_path: Path
) -> None:
    _, log, mission = driven
    right = localize(log, mission).consistency
    assert right["nees_heading_mean"] < right["nees_heading_bounds"][1]
    turned = tmp_path / "turned.csv"
    table = columns(log)
    table["psi"][1:] += 0.1  # the truth, elsewhere than the filter believes
    write_columns(table, turned)
    wrong = localize(turned, mission)
    assert wrong.consistency["nees_mean"] == right["nees_mean"]
    assert wrong.consistency["nees_heading_mean"] > wrong.consistency["nees_heading_bounds"][1]
    assert wrong.errors["heading_end_rad"] == pytest.approx(0.1, abs=0.02)


def test_the_command_writes_the_pose_with_its_covariance(
    driven: tuple[Path, Path, Mission], tmp_path: Path, capsys: Capture
) -> None:
    mission, log, _ = driven
    target, picture = tmp_path / "pose.csv", tmp_path / "pose.svg"
    line = ("localize", log, "--mission", mission, "-o", target, "--plot", picture)
    facts = run(capsys, *line, "--navigation", "ekf", "--json").document
    assert facts["navigation"] == "ekf"
    assert facts["output"] == str(target)
    assert set(facts["consistency"]) == {
        f"{of}_{n}" for of in ("nis", "nees", "nees_heading") for n in ("mean", "bounds")
    }
    assert {"t", "x_est", "P_xx", "P_xy", "P_yy"} <= set(columns(target))
    assert "<svg" in picture.read_text()
    text = run(capsys, *line[:4], "--workspace", tmp_path / "w").out
    assert "innovations (NIS)" in text


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--sensor", "gyro_z=nothing"), "has no column 'nothing' for gyro_z"),
        (("--sensor", "gyro=gyro_z"), "'gyro' is not a known measurement; known are omega_l"),
        (("--sensor", "gyro_z"), "--sensor cannot read 'gyro_z'; write NAME=COLUMN"),
        (("--navigation", "x"), "unknown kind 'x' of navigation"),
        (("--unit", "gyro_z=m"), "gyro_z is in m, but gyro_z needs rad/s"),
    ],
)
def test_mistakes_are_one_sentence(
    driven: tuple[Path, Path, Mission], more: tuple[str, ...], words: str, capsys: Capture
) -> None:
    mission, log, _ = driven
    result = run(capsys, "localize", log, "--mission", mission, *more)
    assert result.code == 2
    assert words in result.err
    assert len(result.err.strip().splitlines()) == 1


def test_a_log_without_measurements_is_refused(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t,temperature\n0,20\n1,21\n2,22\n")
    with pytest.raises(DataError, match="holds none of the measurements omega_l, omega_r"):
        localize(log, Mission(goal=(1.0, 0.0)))
    log.write_text("t,omega_l,omega_r\n0,1,1\n2,1,1\n1,1,1\n")
    with pytest.raises(DataError, match=r"log\.csv, line 4"):
        localize(log, Mission(goal=(1.0, 0.0)))
