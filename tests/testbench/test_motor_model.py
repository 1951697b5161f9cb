"""The motor of the bench as a model: it compares, exports, drives missions and takes effects."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sysid_datasets
from bench_rig import drive_log, staircase
from command_line import Capture, run

from sysid.report.bench import motor_picture
from sysid.structures.grey_box.dc_motor.structure import DCMotor
from sysid.structures.model import Model
from sysid.testbench.motor.characterise import MotorOptions, characterise_motor
from sysid.testbench.motor.equations import (
    PUBLISHED,
    MotorConstants,
    steady_state,
    step_response,
    torque_speed,
)
from sysid.testbench.motor.model import NAMES, bench_model

TABLES = sorted(sysid_datasets.folder("bench").glob("motor_*.csv"))


def bench_of(files: list[Path]) -> Model:
    bench = bench_model(characterise_motor(files))
    assert bench is not None
    return bench


def constants_of(model: Model) -> MotorConstants:
    """The motor that a model of the bench describes."""
    assert isinstance(model.structure, DCMotor)
    p = model.structure.physics.unpack(np, model.theta)
    values = {name: float(np.ravel(p[own])[0]) for name, own in NAMES.items()}
    return MotorConstants(**values, gear=float(p["gear"]))


@pytest.fixture(scope="module")
def model() -> Model:
    return bench_of(TABLES)


def test_a_model_runs_as_the_equations_of_the_bench(model: Model) -> None:
    """A step of 3 V from standstill, and the steady state of every voltage."""
    c = constants_of(model)
    t, speed, _ = step_response(c, 3.0, seconds=2.0, points=21)
    run_ = model.simulate(np.full((21, 1), 3.0))
    assert model.dt == pytest.approx(t[1])
    # the structure's friction is that of the mean speed of a step, hardly another than C0
    assert np.max(np.abs(run_[:, 0] - speed)) < 1e-6 * speed[-1]
    for volts in (0.2, 2.0, -5.0):
        end = model.simulate(np.full((60, 1), volts))[-1, 0]
        assert end == pytest.approx(float(steady_state(c, np.array([volts]))[0][0]), abs=1e-9)


def test_a_model_tells_constants_with_errors_and_correlations(model: Model) -> None:
    rows = {p.name: p for p in model.parameter_table()}
    assert rows["torque_constant"].value == pytest.approx(8.648e-4, abs=5e-8)
    assert rows["motor_friction"].value == pytest.approx(1.0e-4, abs=5e-7)
    assert not rows["motor_inertia"].fixed
    assert rows["gear"].fixed
    values = np.linalg.eigvalsh(model.covariance / np.trace(model.covariance))
    assert np.all(values > -1e-12)


def test_a_characteristic_ends_at_the_steady_speed_and_the_stall_torque() -> None:
    speed, torque, current = torque_speed(PUBLISHED, 4.0)
    assert torque[-1] == pytest.approx(0.0, abs=1e-12)
    assert current[0] == pytest.approx(4.0 / 3.1)
    assert speed[-1] == pytest.approx(float(steady_state(PUBLISHED, np.array([4.0]))[0][0]))
    _, loaded, _ = step_response(PUBLISHED, 3.0, 0.017, seconds=5.0)
    assert loaded[-1] < speed[-1]


def test_the_four_commands_in_a_row_after_the_bench(tmp_path: Path, capsys: Capture) -> None:
    """bench, compare on a log, export, and a mission with a copy of the motor for each track."""
    place = ("--workspace", tmp_path / "w")
    motor = replace(constants_of(bench_of(TABLES)), L=3e-3)
    log = drive_log(tmp_path / "log.csv", motor, staircase(3.0, 0.15, 6, lowest=-5.0), 0.05)
    columns = ("--input", "voltage_V", "--output", "speed_rad_s")
    line = ("bench", "motor", *TABLES, "--ts", 0.05, *columns)
    made = run(capsys, *line, "--json", *place).document
    ranked = run(capsys, "compare", "--val", log, *columns, "--json", *place).document
    assert ranked["best"] == made["model"]
    assert ranked["ranking"][0]["fit_percent"]["speed_rad_s"] > 98.0
    assert run(capsys, "export", "--json", *place).document
    mission = tmp_path / "m.yaml"
    mission.write_text("goal: [1, 0]\nvehicle: {command_scale: 6, speed_scale: 1}\n")
    drove = run(capsys, "simulate", mission, "--json", *place).document
    assert drove["outcome"] == "arrived"


def test_pictures_of_tables_and_drives(tmp_path: Path, capsys: Capture) -> None:
    picture = motor_picture(characterise_motor(TABLES))
    assert [p.title for p in picture.panels] == [
        "torque and speed", "current and torque", "steady speed", "steady current",
        "stall torque", "step to 3 V",
    ]  # fmt: skip
    place = ("--workspace", tmp_path / "w")
    done = run(capsys, "bench", "motor", *TABLES, "--plot", tmp_path / "m.svg", *place)
    assert done.code == 0
    assert (tmp_path / "m.svg").read_text().startswith("<?xml")


def test_without_inertia_there_are_constants_but_no_model(tmp_path: Path, capsys: Capture) -> None:
    table = sysid_datasets.path("motor_no_load")
    place = ("--workspace", tmp_path / "w")
    result = run(capsys, "bench", "motor", table, "--known", "R=3.1", "--json", *place).document
    assert result["model"] is None
    known = characterise_motor([table], MotorOptions(known={"R": 3.1, "J": 1e-7}))
    assert bench_model(known) is not None
