"""One drive tells all constants, with errors that hold the truth of an independent simulation."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench_rig import STEP, TRUE, drive_log, run, staircase

from sysid.errors import DataError
from sysid.testbench.motor.characterise import MotorBench, MotorOptions, characterise_motor
from sysid.testbench.motor.drive import motion
from sysid.testbench.motor.equations import MotorConstants
from sysid.testbench.motor.tables import columns_of, read_bench_table

COVERED = 4.0
"""Standard errors: 6e-5 of Gaussian estimates lie further out, six of them in each case."""


def worst(bench: MotorBench, truth: MotorConstants = TRUE) -> float:
    """Largest distance from the truth in standard errors."""
    rows = [p for p in bench.parameters if p.value is not None and p.name != "Kc"]
    assert len(rows) >= 5
    return max(abs(p.value - getattr(truth, p.name)) / p.std_error for p in rows)


def test_the_motion_between_rows_is_that_of_the_equations() -> None:
    """Stops, reversals and standstill included; the reference is cut at 0.1 ms."""
    voltage = staircase(2.0, 0.1, seed=5)
    every = 20
    ran = run(TRUE, voltage)[::every]
    current, speed, angle = motion(TRUE, voltage[::every], every * STEP, (0.0, 0.0))
    for result, truth in ((current, ran[:, 0]), (speed, ran[:, 1]), (angle, ran[:, 2])):
        # a stop is found by linear interpolation within 2 ms, a fiftieth of the time constant
        assert np.max(np.abs(result - truth)) < 3e-3 * np.max(np.abs(truth))


@pytest.mark.slow
def test_one_drive_with_an_encoder_tells_everything(tmp_path: Path) -> None:
    log = drive_log(tmp_path / "ticks.csv", TRUE, staircase(0.8, 0.1, 2), 0.002, ticks=500)
    options = MotorOptions(gear=60.0, units={"ticks": "counts=500/rev"})
    bench = characterise_motor([log], options)
    assert worst(bench) < COVERED
    relative = {p.name: p.std_error / p.value for p in bench.parameters if p.std_error}
    assert relative["R"] < 0.01
    assert relative["L"] < 0.1
    assert relative["J"] < 0.01
    assert any("Kc is set equal to Kem" in note for note in bench.notes)
    assert bench.method == "joint"


@pytest.mark.slow
def test_inductance_is_not_told_by_slow_sampling(tmp_path: Path) -> None:
    small = replace(TRUE, L=4e-4)
    log = drive_log(tmp_path / "slow.csv", small, staircase(3.0, 0.2, 3), 0.02)
    bench = characterise_motor([log], MotorOptions(gear=60.0))
    row = next(p for p in bench.parameters if p.name == "L")
    assert row.value is None
    assert any("sample faster than L/R" in note for note in bench.notes)
    assert worst(bench, small) < COVERED


def test_columns_beside_those_of_the_motor_are_passed_over(tmp_path: Path) -> None:
    """A supply, a set point, PWM counts and a switch beside voltage, current and speed."""
    path = tmp_path / "log.csv"
    head = "t,voltage_V,current_A,speed_rad_s,supply_V,speed_ref_rad_s,pwm_counts,torque_on"
    path.write_text(f"{head}\n{','.join('1' for _ in head.split(','))}\n")
    table = read_bench_table(path)
    assert [c.role for c in columns_of(table, {})] == ["time", "voltage", "current", "speed"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time_s,voltage_V,current_A\n0,1,1\n", "no speed (speed_rpm, ticks)"),
        ("time_s,current_A,speed_rpm\n0,1,1\n", "no voltage (voltage_V)"),
        ("time_s,voltage_V,current_A,ticks\n0,1,1,5\n", "units={'ticks': 'counts=N/rev'}"),
    ],
)
def test_a_log_that_lacks_a_column_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(DataError) as refused:
        characterise_motor([path])
    assert said in str(refused.value)
