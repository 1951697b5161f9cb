"""A camera's pose and a robot's wheels in two files with two clocks: one log of both."""

import sys
import types
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import quick_diagnosis
from command_line import Capture, run
from scipy.signal import lfilter

from sysid.data.io import read_file
from sysid.data.joining.clock_offset import clock_shift, travelled, way_and_turn
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Array
from sysid.errors import DataError, UsageError

RADIUS, TRACK = 0.05, 0.3
WHEELS, CAMERA = 0.02, 1.0 / 120.0


@dataclass(frozen=True, eq=False)
class Drive:
    """Commands and wheels on one clock, the pose on another; t_log = t_camera + offset."""

    t: Array
    u: Array
    omega: Array
    t_camera: Array
    pose: Array
    true_pose: Array


def driven(
    offset: float, drift: float = 0.0, seed: int = 1, seconds: float = 30.0, noise: float = 1.0
) -> Drive:
    """Two wheels of a first-order lag, a camera that sees all but the first 2 and last 3 s."""
    rng = np.random.default_rng(seed)
    fine = 1e-3
    t = np.arange(round(seconds / fine)) * fine
    u = np.repeat(rng.uniform(-10.0, 10.0, (round(seconds / 0.75) + 1, 2)), 750, axis=0)[: len(t)]
    a = np.exp(-fine / 0.15)
    w = lfilter([0.0, 1.0 - a], [1.0, -a], u, axis=0)
    psi = np.cumsum(RADIUS * (w[:, 1] - w[:, 0]) / TRACK) * fine
    v = RADIUS * w.mean(axis=1)
    path = np.column_stack([np.cumsum(v * np.cos(psi)), np.cumsum(v * np.sin(psi)), psi / fine])
    path *= fine
    rows = np.arange(0.0, seconds - 0.1, WHEELS)
    seen = np.arange(2.0 - offset, seconds - 3.0 - offset, CAMERA)
    on_log = seen + offset + drift * (seen - seen.mean())

    def at(when: Array, what: Array) -> Array:
        return np.column_stack([np.interp(when, t, c) for c in what.T])

    return Drive(
        rows,
        at(rows, u),
        at(rows, w) + noise * rng.normal(0.0, 0.1, (len(rows), 2)),
        seen,
        at(on_log, path) + noise * rng.normal(0.0, 1.0, (len(seen), 3)) * [1e-3, 1e-3, 3e-3],
        at(rows, path),
    )


@pytest.mark.parametrize("offset", [0.0, 3.2137, -41.25, 0.004])
@pytest.mark.parametrize("drift", [0.0, 3e-4])
def test_the_clocks_are_found_to_a_fraction_of_a_sample(offset: float, drift: float) -> None:
    d = driven(offset, drift)
    found = clock_shift(d.t, travelled(d.t, d.omega), d.t_camera, way_and_turn(*d.pose.T))
    assert found.agreement > 0.95
    assert found.rival is None
    # half a per cent of the 20 ms between wheel readings would be 0.1 ms; the truth is made in
    # steps of 1 ms
    assert found.seconds == pytest.approx(offset, abs=2e-3)
    # a drift that moves the clocks by less than a fifth of a row is not told from none
    assert found.drift == pytest.approx(drift, abs=1.5e-4)
    np.testing.assert_allclose(
        found.to_log(d.t_camera),
        d.t_camera + offset + drift * (d.t_camera - d.t_camera.mean()),
        atol=5e-3,
    )


def test_wheels_may_be_swapped_turned_round_and_in_any_unit() -> None:
    d = driven(1.5)
    odd = np.column_stack([-400.0 * d.omega[:, 1], 60.0 * d.omega[:, 0]])
    found = clock_shift(d.t, travelled(d.t, odd), d.t_camera, way_and_turn(*d.pose.T))
    assert found.seconds == pytest.approx(1.5, abs=2e-3)


def write(path: Path, names: tuple[str, ...], *columns: Array) -> Path:
    """A CSV of the columns."""
    rows = [",".join(f"{v:.9g}" for v in row) for row in np.column_stack(columns)]
    path.write_text("\n".join([",".join(names), *rows]) + "\n")
    return path


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path, Drive]:
    """Wheels at 50 Hz; a camera at 120 Hz in millimetres and degrees that fold at ±180."""
    d = driven(3.2137, seed=4)
    log = write(tmp_path / "run.csv", ("t", "u_l", "u_r", "omega_l", "omega_r"), d.t, d.u, d.omega)
    folded = np.degrees(np.angle(np.exp(1j * d.pose[:, 2])))
    names = ("time", "x [mm]", "y [mm]", "yaw [deg]")
    camera = write(tmp_path / "mocap.csv", names, d.t_camera, 1e3 * d.pose[:, :2], folded)
    return log, camera, d


def test_a_pose_of_another_file_comes_onto_the_rows_of_the_log(
    files: tuple[Path, Path, Drive],
) -> None:
    log, camera, d = files
    read = read_file(log, ReadOptions(join=(str(camera),)))
    (record,) = read.records
    assert record.pose is not None
    assert record.dt == pytest.approx(WHEELS)
    first = round(record.t0 / WHEELS)
    truth = d.true_pose[first : first + len(record)]
    np.testing.assert_allclose(record.y[:, 0], d.omega[first : first + len(record), 0], rtol=1e-6)
    # noise of the camera (1 mm, 3 mrad: four of its standard deviations), and 2 ms at 0.5 m/s
    assert np.max(np.abs(record.pose[:, :2] - truth[:, :2])) < 5e-3
    turned = record.pose[:, 2] - truth[:, 2]
    assert np.max(np.abs(turned - 2 * np.pi * np.round(turned.mean() / (2 * np.pi)))) < 3e-2
    text = " ".join(f.text for f in read.findings)
    assert "mocap.csv: its clock is 3.21" in text
    assert "s behind that of run.csv" in text
    plain = read_file(log, ReadOptions())
    assert record.sha256 != plain.records[0].sha256


def test_every_command_joins_and_a_model_can_read_its_data_again(
    files: tuple[Path, Path, Drive], capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, camera, _ = files
    monkeypatch.chdir(log.parent)
    shown = run(capsys, "inspect", log.name, "--join", camera.name, "--json").document
    assert shown["records"][0]["has_pose"]
    fitted = run(
        capsys,
        *("fit", log.name, "--join", camera.name, "--output", "omega_l", "--input", "u_l"),
        *("--structure", "arx", "--orders", "na=1 nb=1 nk=1"),
    )
    assert fitted.code == 0, fitted.err
    compared = run(capsys, "compare", "--folds", "2")
    assert compared.code == 0, compared.err


@pytest.mark.slow
def test_every_command_says_what_reading_did_to_the_numbers(
    files: tuple[Path, Path, Drive], capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, camera, _ = files
    monkeypatch.chdir(log.parent)
    stub = types.ModuleType("sysid.diagnosis.diagnose")
    stub.diagnose = quick_diagnosis.diagnose  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, stub.__name__, stub)
    joined = (log.name, "--join", camera.name)
    inspected = run(capsys, "inspect", *joined, "--json").document["findings"]
    codes = ("join", "reading")  # what the reader did, not what checks of the signals found
    said = [f["sentence"] for f in inspected if f["severity"] == "note" and f["code"] in codes]
    assert any("its clock is 3.21" in s for s in said)
    fit = ("fit", *joined, "--structure", "arx", "--orders", "na=1 nb=1 nk=1")
    compare = ("compare", "--val", *joined)
    for command in (fit, compare, ("diagnose", *joined)):
        shown = run(capsys, *command, *(("--full",) if command is not compare else ()))
        assert shown.code == 0, shown.err
        told = " ".join(shown.out.split())
        if command is compare:  # of a screen's length: what comes first, on a line
            assert "Read as: time" in told
            continue
        for sentence in said:
            assert sentence in told, command[0]
    assert set(run(capsys, "diagnose", *joined, "--json").document["reading"]) >= set(said)


def test_an_output_may_come_from_the_joined_file(files: tuple[Path, Path, Drive]) -> None:
    log, _, d = files
    names = ("t", "lift")
    other = write(log.parent / "extra.csv", names, d.t[::2] + 0.005, d.omega[::2, 0])
    read = read_file(log, ReadOptions(inputs=("u_l",), outputs=("lift",), join=(str(other),)))
    assert read.records[0].output_names == ("lift",)
    assert any("was read on the clock of run.csv" in f.text for f in read.findings)


def test_what_cannot_be_joined_is_refused_in_a_sentence(files: tuple[Path, Path, Drive]) -> None:
    log, camera, _ = files
    with pytest.raises(UsageError, match="file not found"):
        read_file(log, ReadOptions(join=("nowhere.csv",)))
    with pytest.raises(DataError, match="both cover 0 rows"):
        read_file(log, ReadOptions(join=(str(camera),), join_offset=900.0))
    other = driven(0.0, seed=99)
    strange = write(log.parent / "strange.csv", ("t", "x", "y", "psi"), other.t_camera, other.pose)
    with pytest.raises(DataError, match="at no shift of the clocks"):
        read_file(log, ReadOptions(join=(str(strange),)))
    with pytest.raises(UsageError, match="join one file to a log"):
        read_file(log, ReadOptions(join=(str(camera), str(strange))))
    named = ReadOptions(join=(f"run.csv={camera}", "other.csv=nowhere.csv"))
    assert read_file(log, named).records[0].pose is not None
