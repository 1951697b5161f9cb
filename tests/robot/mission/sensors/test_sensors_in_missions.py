"""Sensors of a mission: at the command line, in its log, in its navigation."""

import math
import re
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from command_line import Capture, run
from mission_cases import Robot, goal
from plant_models import robot_model
from pydantic import ValidationError

import sysid
from sysid.data.record import Array
from sysid.errors import UsageError
from sysid.robot.mission.registry import kinds
from sysid.robot.mission.sensors.encoders import Encoders
from sysid.robot.mission.sensors.inertial import Gyroscope
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import load_mission

EVERYTHING = "goal: [1, 0.3]\nsensors:\n" + "".join(f"  {kind}:\n" for kind in kinds("sensors"))


def columns(path: Path) -> dict[str, Array]:
    header = path.read_text().splitlines()[0].split(",")
    table = np.genfromtxt(path, delimiter=",", skip_header=1).T
    return dict(zip(header, table, strict=True))


def test_a_seed_at_the_command_line_draws_the_noise_of_all_sensors(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.yaml").write_text(EVERYTHING)
    sysid.write_package(robot_model("arx"), tmp_path / ".sysid" / "plant")

    def driven(*options: object) -> dict[str, Array]:
        facts = run(capsys, "simulate", "m.yaml", *options, "--json").document
        assert facts["seed"] == (options[1] if options else 0)
        return columns(Path(facts["log"]))

    zero, one = driven(), driven("--seed", 1)
    for name in ("gyro_z", "acc_x", "mag_y", "vo_psi", "fix_x"):
        assert not np.array_equal(zero[name][1:10], one[name][1:10])
    assert {"ticks_l", "true_omega_l"} <= zero.keys()

    log = Path(".sysid/missions/m.csv")
    record = sysid.read_log(log)  # as of a robot with encoders: what they read, not the truth
    assert [c.name for c in record.outputs] == ["omega_l", "omega_r"]
    np.testing.assert_allclose(record.y[:, 0], one["omega_l"], rtol=1e-12)
    refused = run(capsys, "simulate", log, "--seed", 1)
    assert refused.code == 2
    assert "is a log to replay; omit --seed" in refused.err


def test_the_mission_of_the_page_is_driven_past_its_iron(tmp_path: Path) -> None:
    page = (Path(__file__).parents[4] / "docs" / "sensors.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "m.yaml").write_text(example)
    result = simulate(load_mission(tmp_path / "m.yaml"), Robot(), seed=7)
    assert result.outcome == "arrived"
    field = np.hypot(result.log["mag_x"], result.log["mag_y"])
    near = np.hypot(result.log["x"] - 3, result.log["y"] - 2) < 0.7
    assert np.abs(field[near] - 20.0).max() > 5.0
    assert np.abs(field[~near & (result.log["x"] < 1)] - 20.0).max() < 5.0


def test_a_seed_in_python() -> None:
    with pytest.raises(UsageError, match="the seed is -1: give a whole number of at least 0"):
        simulate(goal(1, 0), Robot(), seed=-1)


def test_a_sensor_more_leaves_the_others_as_they_were() -> None:
    gyro = {"gyroscope": Gyroscope()}
    alone = simulate(goal(1, 0, sensors=gyro), Robot(), seed=5).log
    with_more = {"position_fixes": None, "magnetometer": None}
    both = simulate(goal(1, 0, sensors=with_more | gyro), Robot(), seed=5).log
    np.testing.assert_array_equal(both["gyro_z"], alone["gyro_z"])


@pytest.mark.parametrize("keys", [{}, {"rate": 4.0}, {"dropout": 0.3}])
def test_odometry_of_counted_ticks_stays_within_a_tick(keys: dict[str, float]) -> None:
    """Every tick is driven once: what remains is the last tick and the interval under way."""
    encoders = Encoders(**keys, noise=(0.0,))  # type: ignore[arg-type]
    mission = goal(2, 1, sensors={"encoders": encoders})
    result = simulate(mission, Robot(), seed=2)
    exact = simulate(goal(2, 1), Robot())
    assert result.outcome == exact.outcome
    log = result.log
    waits = np.diff(np.flatnonzero(~np.isnan(log["ticks_l"]))).max() * 0.1
    believed, driven = log["rho_goal"][-1], math.hypot(log["x"][-1] - 2, log["y"][-1] - 1)
    # A tick is 0.1 mm and 0.6 mrad of heading on a way of 2 m; 0.3 m/s while it waits.
    assert abs(believed - driven) < 0.003 + 0.3 * (waits - 0.1)


def test_without_sensors_a_mission_is_what_it_was() -> None:
    log = simulate(goal(1, 0), Robot(), seed=7).log
    assert not {"ticks_l", "gyro_z", "true_omega_l"} & log.keys()
    for name, column in simulate(goal(1, 0), Robot()).log.items():
        np.testing.assert_array_equal(column, log[name])


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("gyro_z", "gyro_z is read by sensors.gyroscope already: remove one of them"),
        ("psi", "a sensor reads psi, which is a column of every mission: rename it"),
    ],
)
def test_two_columns_of_one_name_are_refused(name: str, words: str) -> None:
    class Other(Gyroscope):
        measured: ClassVar[tuple[str, ...]] = (name,)

    with pytest.raises(ValidationError, match=words):
        goal(1, 0, sensors={"gyroscope": None, "encoders": Other()})
