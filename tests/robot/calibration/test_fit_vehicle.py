"""What a log tells of a vehicle: its numbers, with errors that hold, and what it cannot tell."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run
from skid_steer_logs import Skid, columns, wheels, written

from sysid.data.io import read_log
from sysid.data.preparation import Preparation
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Array, Record
from sysid.robot.calibration.logs import read_vehicle_logs
from sysid.robot.calibration.vehicle_fit import VehicleFit, fit_vehicle
from sysid.robot.mission.motion.slip import Slip
from sysid.robot.mission.spec import load_mission
from sysid.vehicle.kinematics import Geometry

NOMINAL = Geometry(0.15, 0.6)
SKID = Skid((0.15, 0.152), 0.9, (0.12, -0.05), 0.03, 0.137, 0.061)
TURNING = Skid((0.14, 0.14), 1.2, lag=0.4, heading_lag=0.4, slip_turning=0.2)
WHEELS = ("omega_l", "omega_r")
FAR = 4.0
"""Standard errors: of some twenty numbers in a test one is off by as many in a thousand tests."""


def record(skid: Skid, folder: Path, seconds: float = 60.0, straight: bool = False) -> Record:
    """A log of a drive as the command reads it."""
    log = written(folder / "drive.csv", columns(skid, wheels(seconds, straight=straight)))
    return read_log(log, ReadOptions(held="keep", inputs=("none",)))


@cache
def _fitted(skid: Skid, folder: Path) -> VehicleFit:
    return fit_vehicle([record(skid, folder)], geometry=NOMINAL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for the logs of all tests here."""
    return tmp_path_factory.mktemp("drives")


def test_it_finds_every_number_of_the_vehicle(folder: Path) -> None:
    fitted = _fitted(SKID, folder)
    truth = {
        "radius_left": 0.15,
        "radius_right": 0.152,
        "effective_width": 0.9,
        "marker_x": 0.12,
        "marker_y": -0.05,
        "heading_offset": 0.03,
        "pose_lag": 0.137,
        "heading_lag": 0.061,
        "icr_x": -0.12,
        "icr_y_left": 0.5,
        "icr_y_right": -0.4,
        "width_ratio": 1.5,
    }
    for name, value in truth.items():
        number = fitted.number(name)
        assert number.identifiable
        assert abs(number.value - value) < FAR * number.std_error, name
        assert number.std_error < 0.02, name
    # lags of 137 and 61 ms in rows of 50 ms: known far better than a row
    assert fitted.number("pose_lag").std_error < 0.01


def test_lost_readings_of_the_wheels_are_no_turns(folder: Path) -> None:
    """Zeros in place of 2 % of the speeds had made all errors eight times as large, in silence."""
    whole = record(SKID, folder)
    y = whole.y.copy()
    y[np.random.default_rng(5).random(y.shape) < 0.02] = 0.0
    fitted = fit_vehicle([replace(whole, y=y)], geometry=NOMINAL)
    assert any("far from their neighbours" in note for note in fitted.notes)
    for name, value in (("radius_left", 0.15), ("radius_right", 0.152), ("effective_width", 0.9)):
        number, plain = fitted.number(name), _fitted(SKID, folder).number(name)
        assert abs(number.value - value) < FAR * number.std_error, name
        assert number.std_error < 3.0 * plain.std_error, name


def test_it_foretells_paths_that_it_was_not_fitted_to(folder: Path) -> None:
    fitted = _fitted(SKID, folder)
    assert fitted.after.heading < 0.1 * fitted.before.heading
    assert fitted.after.path < 0.2 * fitted.before.path
    assert all(f.after.heading < 0.1 * f.before.heading for f in fitted.folds)
    assert fitted.drift[1].per_metre is not None
    assert fitted.drift[1].per_metre < 0.05  # noise of the pose and speeds between rows


def test_slip_in_turns_is_told_from_a_width(folder: Path) -> None:
    fitted = _fitted(TURNING, folder)
    for name, value in (("slip_turning", 0.2), ("effective_width", 1.2), ("pose_lag", 0.4)):
        number = fitted.number(name)
        assert number.in_model
        assert abs(number.value - value) < FAR * number.std_error, name
    curve = fitted.curves["turning"]
    assert curve[-1].slip > curve[0].slip + 0.05


def test_what_a_straight_drive_does_not_tell_is_said(folder: Path) -> None:
    fitted = fit_vehicle([record(SKID, folder, straight=True)], geometry=NOMINAL)
    shown = {n.name: n for n in fitted.numbers}
    assert shown["radius_left"].identifiable or shown["radius_right"].identifiable
    for name in ("effective_width", "marker_y", "icr_y_left"):
        assert not shown[name].identifiable
    assert "turns on the spot" in shown["effective_width"].sentence


def test_a_pose_that_jumps_is_left_out(folder: Path) -> None:
    log = record(SKID, folder)
    assert log.pose is not None
    pose = log.pose.copy()
    pose[500:, 0] += 3.0
    jumped = Record(log.u, log.y, log.dt, log.inputs, log.outputs, pose, name="jumped.csv")
    fitted = fit_vehicle([jumped], geometry=NOMINAL)
    assert any("jumps 1 time" in n for n in fitted.notes)
    assert fitted.after.path < 1.5 * _fitted(SKID, folder).after.path


def test_readings_that_repeat_are_no_measurements(folder: Path) -> None:
    log = record(SKID, folder)
    assert log.pose is not None
    rows = np.arange(len(log))
    pose, omega = log.pose[rows - rows % 5], log.y[rows - rows % 4]
    held = Record(log.u, omega, log.dt, log.inputs, log.outputs, pose, name="held.csv")
    fitted = fit_vehicle([held], geometry=NOMINAL)
    # speeds between measurements every 0.2 s are no better than a line: 1 % and a tenth of a row
    assert fitted.number("effective_width").value == pytest.approx(0.9, rel=0.02)
    assert fitted.number("pose_lag").value == pytest.approx(0.137, abs=0.02)


@pytest.mark.slow
def test_the_command_writes_a_document_a_vehicle_and_a_mission(
    capsys: Capture, tmp_path: Path
) -> None:
    named = columns(TURNING, wheels(40.0))
    log = written(tmp_path / "drive.csv", named)
    mission = tmp_path / "m.yaml"
    mission.write_text("goal: [1, 0]\nvehicle:\n  B: 0.6  # by tape\n", encoding="utf-8")
    target, section = tmp_path / "new.yaml", tmp_path / "vehicle.yaml"
    options = ("--geometry", "r=0.15,B=0.6", "--mission", mission, "-o", target)
    document = run(capsys, "fit-vehicle", log, *options, "--json").document
    fields = {"name", "value", "std_error", "unit", "identifiable", "sentence", "in_model"}
    assert all(set(p) == fields for p in document["parameters"])
    for key in ("path_error_m", "heading_error_rad"):
        assert document[key]["after"] < 0.4 * document[key]["before"]
    assert document["vehicle"]["B"] == pytest.approx(1.2, rel=0.3)
    driven = load_mission(target)
    assert pytest.approx(1.2, rel=0.1) == driven.vehicle.B
    assert isinstance(driven.motion, Slip)
    assert driven.motion.turning == pytest.approx(0.2, abs=0.05)
    alone = ("--geometry", "r=0.15,B=0.6", "-o", section)
    assert run(capsys, "fit-vehicle", log, *alone, "--json").code == 0
    again = run(capsys, "fit-vehicle", log, "--geometry", section, "--json").document
    assert again["heading_error_rad"]["before"] < 0.5 * document["heading_error_rad"]["before"]


def test_wheels_and_pose_may_stand_in_two_files(capsys: Capture, tmp_path: Path) -> None:
    named = columns(Skid(width=0.9), wheels(40.0))
    log = written(tmp_path / "wheels.csv", {k: named[k] for k in ("t", *WHEELS)})
    late = {"t": named["t"] + 5.0} | _pose(named)
    pose = written(tmp_path / "pose.csv", late)
    result = run(capsys, "fit-vehicle", log, "--join", pose, "--json").document
    width = next(p for p in result["parameters"] if p["name"] == "effective_width")
    assert abs(width["value"] - 0.9) < FAR * width["std_error"]
    assert "compare with plain" in result["before"]


@pytest.mark.parametrize(
    "names",
    [
        ("v_left [m/s]", "v_right [m/s]"),
        ("omega_fl", "omega_rl", "omega_fr", "omega_rr"),
        ("cmd_left_rad_s", "cmd_right_rad_s"),
    ],
)
def test_speeds_go_by_many_names(tmp_path: Path, names: tuple[str, ...]) -> None:
    named = columns(Skid(width=0.9), wheels(30.0))
    scale = 0.15 if "m/s" in names[0] else 1.0
    speeds = {n: scale * named[WHEELS[k * 2 // len(names)]] for k, n in enumerate(names)}
    log = written(tmp_path / "log.csv", {"t": named["t"], **speeds, **_pose(named)})
    records, _ = read_vehicle_logs([log], ReadOptions(), Preparation())
    fitted = fit_vehicle(records, geometry=NOMINAL)
    width = fitted.number("effective_width")
    assert abs(width.value - 0.9) < FAR * width.std_error
    assert any("commanded" in n for n in fitted.notes) == ("cmd" in names[0])


def _pose(named: Mapping[str, Array]) -> dict[str, Array]:
    return {k: named[k] for k in ("x", "y", "psi")}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "needs a LOG: time, the speeds"),
        (("0.3", "1.08"), "0.3: file not found"),
        (("{log}", "--motion", "sliding"), "motion is one of"),
        (("{log}", "--mission", "m.yaml"), "add -o FILE"),
        (("{log}", "--geometry", "r=0.3"), "gives no B"),
        (("{bare}",), "lacks a pose"),
        (("{pwm}",), "lacks the wheel speeds of the left"),
        (("{still}",), "never turn"),
        (("{short}",), "are needed"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(
    capsys: Capture, tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    named = columns(SKID, wheels(6.0))
    pwm = {f"pwm_{side}": 1000.0 * named[f"omega_{side}"] for side in "lr"}
    logs = {
        "log": written(tmp_path / "log.csv", columns(SKID, wheels(30.0))),
        "bare": written(tmp_path / "bare.csv", {k: named[k] for k in ("t", *WHEELS)}),
        "still": written(tmp_path / "still.csv", named | dict.fromkeys(WHEELS, 0 * named["t"])),
        "pwm": written(tmp_path / "pwm.csv", {"t": named["t"], **pwm, **_pose(named)}),
        "short": written(tmp_path / "short.csv", named),
    }
    result = run(capsys, "fit-vehicle", *(a.format(**logs) for a in arguments))
    assert result.code in (1, 2)
    assert words in result.err
