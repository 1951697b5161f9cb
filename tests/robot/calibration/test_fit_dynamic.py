"""Mass, inertia and friction of a vehicle from its drive: judged on a multibody simulation."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log
from sysid_datasets.multibody import Machine, columns, drive, random_schedule, schedule, scrub

from sysid.data.record import Channel, Record
from sysid.errors import DataError, ModelError, UsageError
from sysid.robot.calibration.dynamic_estimate import DynamicFit
from sysid.robot.calibration.dynamic_fit import fit_dynamics
from sysid.robot.calibration.dynamic_motion import fit_weighed
from sysid.robot.calibration.dynamic_motors import (
    motors_of_bench,
    motors_of_model,
    read_motors,
    torque_only,
)
from sysid.robot.calibration.judged import whole
from sysid.robot.calibration.numbers import VehicleNumber
from sysid.robot.calibration.trajectory import Part, Trajectories, trajectories_of
from sysid.robot.calibration.vehicle_fit import fit_vehicle
from sysid.vehicle.kinematics import Geometry
from sysid.vehicle.motors import Bench

DT = 0.05
STRAIGHT = 10.0
MACHINE = Machine()

FAR = 4.0
"""Standard errors: of five numbers one is off by as many in three thousand draws."""


def made() -> Record:
    """A log of the engine: straight starts and stops first, then everything."""
    rng = np.random.default_rng(3)
    ahead = schedule([(1.0, 6.0, 6.0), (0.8, 0.0, 0.0), (1.0, -5.0, -5.0), (0.8, 0.0, 0.0)] * 3, DT)
    rest = random_schedule(20.0, DT, rng, 7.0)
    done = drive(MACHINE, np.concatenate([ahead[: round(STRAIGHT / DT)], rest]), DT)
    log = columns(done, rng, (0.05, 0.001, 0.002))
    return Record(
        np.column_stack([log["u_l"], log["u_r"]]),
        np.column_stack([log["omega_l"], log["omega_r"]]),
        DT,
        (Channel("u_l", "V"), Channel("u_r", "V")),
        (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")),
        np.column_stack([log["x"], log["y"], log["psi"]]),
        name="engine.csv",
    )


@pytest.fixture(scope="module")
def trajectories() -> Trajectories:
    pytest.importorskip("mujoco", reason="the extra physics is not installed")
    return trajectories_of([made()], Geometry())


@pytest.fixture(scope="module")
def weighed(trajectories: Trajectories) -> DynamicFit:
    """One fit for all tests here: it is compiled for some seconds."""
    motors = motors_of_bench(Bench(), {"inertia": 1e-9})
    return fit_weighed(
        whole(trajectories.each), Geometry(), [made()], trajectories, Geometry(), motors
    )


def named(numbers: tuple[VehicleNumber, ...]) -> dict[str, VehicleNumber]:
    return {n.name: n for n in numbers}


@pytest.mark.slow
def test_it_weighs_the_vehicle_of_another_engine(weighed: DynamicFit) -> None:
    numbers = named(weighed.numbers())
    moment, _ = scrub(MACHINE)
    truth = {
        "mass": MACHINE.mass,
        "rolling_resistance": MACHINE.rolling * MACHINE.mass * 9.81,
        "turning_resistance": moment,
    }
    for name, value in truth.items():
        number = numbers[name]
        assert number.identifiable, number.sentence
        # contacts that sink in and lift leave a hundredth beside the error of the measurements
        assert abs(number.value - value) < FAR * np.hypot(number.std_error, 0.01 * value), name
    # isotropic points creep, which the model holds as a wider vehicle only: within a fifth
    assert numbers["yaw_inertia"].value == pytest.approx(MACHINE.yaw_inertia, rel=0.2)
    assert "1 % of that is" in numbers["mass"].sentence


@pytest.mark.slow
def test_errors_of_the_bench_are_errors_of_the_mass(weighed: DynamicFit) -> None:
    """A hundredth of the rotors' 2J/r² is a twentieth of this mass, whatever the log says."""
    rotors = 2.0 * MACHINE.motor.inertia / MACHINE.r**2
    assert named(weighed.numbers())["mass"].std_error > 0.9 * 0.01 * rotors


@pytest.mark.slow
def test_straight_runs_do_not_tell_what_turns_would(
    weighed: DynamicFit, trajectories: Trajectories
) -> None:
    windows = trajectories.each[0].windows()
    ahead = windows[trajectories.each[0].at[windows[:, 1]] <= STRAIGHT]
    part = Part(trajectories.each[0], ahead)
    numbers = named(fit_dynamics([part], weighed.geometry, weighed.powered).numbers())
    assert numbers["mass"].identifiable
    for name, manoeuvre in (
        ("yaw_inertia", "quick turns on the spot"),
        ("turning_resistance", "slow, steady turns on the spot"),
        ("centre_of_mass", "turns on the spot"),
    ):
        assert not numbers[name].identifiable, name
        assert manoeuvre in numbers[name].sentence


@pytest.mark.slow
def test_without_a_torque_only_ratios_are_told(weighed: DynamicFit) -> None:
    powered = replace(weighed.powered, torque_known=False)
    numbers = named(replace(weighed, powered=powered).numbers())
    assert not numbers["mass"].identifiable
    assert "`motors`" in numbers["mass"].sentence
    assert numbers["mass"].in_model is False
    m = MACHINE.motor
    lag = (m.inertia + 0.5 * MACHINE.mass * MACHINE.r**2) / m.damping
    assert numbers["straight_lag"].value == pytest.approx(lag, rel=0.03)


@pytest.mark.slow
def test_paths_are_foretold_better_than_by_rolling_wheels(
    weighed: DynamicFit, trajectories: Trajectories
) -> None:
    parts = whole(trajectories.each)
    after = weighed.errors(parts)
    # pose noise at both ends of a window, and no more than twice that
    assert np.sqrt(np.mean(after[:, :2] ** 2)) < 2.0 * np.sqrt(2.0) * 0.001 * 2.0
    read = weighed.predicted_pose(trajectories.each[0])
    assert read.shape == trajectories.each[0].pose.shape


# What is known of the motors ---------------------------------------------------------------------


def test_bench_constants_come_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "motor.yaml"
    path.write_text("resistance: [3.1, 0.031]\ngear: 100\n")
    known = read_motors(path)
    assert known.motors[0] == Bench(gear=100.0).motor(1.0)
    assert known.spreads[0] == pytest.approx(0.01, rel=0.02)  # one over R, to first order
    assert known.counting_in("", 6.0) == known.motors
    in_pwm = known.counting_in("µs", 2e4)[0]
    assert in_pwm.torque * 20000.0 == pytest.approx(known.motors[0].torque * 7.5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("resistanc: 3.1\n", "motor.yaml:1: 'resistanc' is not a motor constant"),
        ("gear: 120\nback_emf: many\n", "motor.yaml:2: back_emf is 'many'"),
        ("gear: 0\n", "number above 0"),
    ],
)
def test_a_file_of_constants_is_refused_with_its_line(
    tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "motor.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match=words):
        read_motors(path)


def test_units_that_nothing_connects_are_refused() -> None:
    known = motors_of_bench(Bench(), {})
    for unit, largest in (("rad/s", 5.0), ("", 1.0)):
        with pytest.raises(UsageError, match="torque constant"):
            known.counting_in(unit, largest)


def test_a_torque_is_a_positive_number() -> None:
    assert torque_only(0.03).counting_in("A", 1.0)[0].torque == 0.03
    with pytest.raises(UsageError, match="above 0"):
        torque_only(-1.0)


def test_a_model_of_speeds_is_no_motor() -> None:
    from pose_cases import two_tracks

    with pytest.raises(ModelError, match="has speeds and no torque"):
        motors_of_model(two_tracks())


@pytest.mark.slow
def test_commands_of_both_motors_are_needed() -> None:
    pytest.importorskip("mujoco", reason="the extra physics is not installed")
    record = replace(made(), u=made().u[:, :1], inputs=(Channel("u_l", "V"),))
    with pytest.raises(DataError, match="no commands of both motors"):
        fit_vehicle([record], motion="dynamic")


def test_motors_go_with_a_vehicle_that_has_mass(tmp_path: Path, capsys: Capture) -> None:
    log = write_log(tmp_path / "a.csv", ["u_l", "u_r", "omega_l", "omega_r"], [[0.0, 1.0]] * 4)
    one = run(capsys, "fit-vehicle", log, "--motors", "m.yaml", "--torque-constant", "0.1")
    assert one.code == 2
    assert "the same meaning" in one.err
    with pytest.raises(UsageError, match="motors need"):
        fit_vehicle([], motion="slip", motors=torque_only(0.1))
