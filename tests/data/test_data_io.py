"""Reading logs: every way a log may be written, and every way it may be broken."""

import hashlib
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from data_io_cases import GOOD, put, table

from sysid.data.files import write_atomic
from sysid.data.finding import Severity
from sysid.data.io import read_file, read_log, read_logs
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import PWM_FULL_SCALE
from sysid.errors import DataError, UsageError

MEASURED = Path(os.environ.get("SYSID_DATA", "../shared/data"))

needs_measured = pytest.mark.skipif(
    not MEASURED.is_dir(), reason="the measured records are not there (../shared/data, SYSID_DATA)"
)


def rows_of(times: np.ndarray) -> list[tuple[object, ...]]:
    return [(f"{t:.6f}", k % 4, round(np.sin(k), 6)) for k, t in enumerate(times)]


LINES = [(0.1 * k, k % 3, 1.5 * k) for k in range(30)]


def formatted(sep: str, comma: bool = False) -> list[str]:
    rows = [sep.join(f"{c:.1f}" for c in row) for row in LINES]
    return [r.replace(".", ",") for r in rows] if comma else rows


LAYOUTS: dict[str, bytes] = {
    "comma": "\n".join(["t,u,y", *formatted(",")]).encode(),
    "comma and space": "\n".join(["t, u, y", *formatted(", ")]).encode(),
    "semicolon": "\n".join(["t;u;y", *formatted(";")]).encode(),
    "semicolon, decimal comma": "\n".join(["t;u;y", *formatted(";", comma=True)]).encode(),
    "tab, decimal comma": "\n".join(["t\tu\ty", *formatted("\t", comma=True)]).encode(),
    "tab": "\n".join(["t\tu\ty", *formatted("\t")]).encode(),
    "white space": "\n".join(["  t   u  y", *("  " + r for r in formatted("   "))]).encode(),
    "Windows line ends": "\r\n".join(["t,u,y", *formatted(",")]).encode(),
    "old Mac line ends": "\r".join(["t,u,y", *formatted(",")]).encode(),
    "byte order mark": "\n".join(["t,u,y", *formatted(",")]).encode("utf-8-sig"),
    "UTF-16": "\n".join(["t,u,y", *formatted(",")]).encode("utf-16"),
    "Latin-1": "\n".join(["t,u,y,tempé", *(r + ",1" for r in formatted(","))]).encode("latin-1"),
    "comments and hashed header": "\n".join(["# run 7", "# t,u,y", *formatted(",")]).encode(),
    "comments, plain header": "\n".join(["# run 7", "t,u,y", *formatted(",")]).encode(),
    "quoted": "\n".join(
        ['"t","u","y"', *(",".join(f'"{c}"' for c in r.split(",")) for r in formatted(","))]
    ).encode(),
    "trailing delimiters": "\n".join(["t,u,y,", *(r + "," for r in formatted(","))]).encode(),
    "trailing delimiters in rows": "\n".join(
        ["t,u,y", *(r + "," for r in formatted(","))]
    ).encode(),
    "blank lines": "\n\n".join(["t,u,y", *formatted(","), "", ""]).encode(),
    "units in brackets": "\n".join(["t [s],u [V],y (rad/s)", *formatted(",")]).encode(),
    "another order": "\n".join(["y,t,u", *(f"{y},{t},{u}" for t, u, y in LINES)]).encode(),
    "text column": "\n".join(["t,u,y,mode", *(r + ",auto" for r in formatted(","))]).encode(),
    "pandas index": "\n".join(
        [",t,u,y", *(f"{i}," + r for i, r in enumerate(formatted(",")))]
    ).encode(),
    "milliseconds": "\n".join(
        ["t_ms,u,y", *(f"{1000 * t:.0f},{u},{y}" for t, u, y in LINES)]
    ).encode(),
    "dates": "\n".join(
        ["time,u,y", *(f"2024-05-01T12:00:{t:04.1f}Z,{u},{y}" for t, u, y in LINES)]
    ).encode(),
}

# ------------------ the ways a log may be written


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_reads_alike(tmp_path: Path, layout: str) -> None:
    path = put(tmp_path, LAYOUTS[layout])
    record = read_log(path)
    expected = np.array(LINES)
    # The decimal digits are exact; 1e-12 is the rounding of 0.1·k and of the parser.
    np.testing.assert_allclose(record.u[:, 0], expected[:, 1], atol=1e-12)
    np.testing.assert_allclose(record.y[:, 0], expected[:, 2], atol=1e-12)
    assert record.dt == 0.1
    assert (record.input_names, record.output_names) == (("u",), ("y",))
    assert record.sha256 == hashlib.sha256(LAYOUTS[layout]).hexdigest()


def test_parquet_reads_like_csv(tmp_path: Path) -> None:
    frame = pd.DataFrame(np.array(LINES), columns=["t", "u", "y"])
    frame["u"] = frame["u"].astype("Int64")
    for name, content in {"a.parquet": frame, "b.parquet": frame.set_index("t")}.items():
        content.to_parquet(tmp_path / name)
        record = read_log(tmp_path / name)
        np.testing.assert_array_equal(record.u[:, 0], frame["u"].to_numpy(float))
        np.testing.assert_array_equal(record.y[:, 0], frame["y"])
        assert record.dt == 0.1


def test_parquet_with_dates_and_text(tmp_path: Path) -> None:
    frame = pd.DataFrame({"u": [1.0, 2.0] * 10, "y": range(20)})
    frame["time"] = pd.date_range("2024-05-01", periods=20, freq="50ms")
    frame["mode"] = "auto"
    frame.to_parquet(tmp_path / "log.parquet")
    record = read_log(tmp_path / "log.parquet")
    assert record.dt == 0.05
    frame["y"] = "fast"
    frame.to_parquet(tmp_path / "bad.parquet")
    with pytest.raises(DataError, match=r"row 1, column y: 'fast' is not a number"):
        read_log(tmp_path / "bad.parquet")


def test_columns_by_option(tmp_path: Path) -> None:
    path = put(tmp_path, table("a,b,c,d", [(k % 3, k, -k, 7 * k % 5) for k in range(30)]))
    record = read_log(path, ReadOptions(inputs=("d",), outputs=("c", "A"), ts=0.2))
    assert record.input_names == ("d",)
    assert record.output_names == ("c", "a")
    np.testing.assert_array_equal(record.y[:, 0], -np.arange(30))
    assert record.dt == 0.2


# ------------------ units and time


@pytest.mark.parametrize(
    ("options", "channel", "factor", "unit"),
    [
        ({"units": {"omega_l": "rpm"}}, "omega_l", 2 * np.pi / 60, "rad/s"),
        ({"units": {"omega_l": "deg/s"}}, "omega_l", np.pi / 180, "rad/s"),
        ({"units": {"OMEGA_L": "rev/s"}}, "omega_l", 2 * np.pi, "rad/s"),
        ({"units": {"omega_l": "ticks/360"}}, "omega_l", 2 * np.pi / 360 / 0.1, "rad/s"),
        ({"units": {"omega_l": "ticks/s/360"}}, "omega_l", 2 * np.pi / 360, "rad/s"),
        ({"units": {"pwm_l": "drive"}}, "pwm_l", PWM_FULL_SCALE, "µs"),
        ({"pwm_max": 255}, "pwm_l", PWM_FULL_SCALE / 255, "µs"),
        ({}, "pwm_l", 1.0, "µs"),
        ({}, "omega_l", 1.0, "rad/s"),
    ],
)
def test_units_convert_and_are_stored(
    tmp_path: Path, options: dict[str, object], channel: str, factor: float, unit: str
) -> None:
    rows = [(round(0.1 * k, 1), k % 5 * 4000, -(k % 3) * 900, k % 7, k % 4) for k in range(30)]
    path = put(tmp_path, table("t,pwm_l,pwm_r,omega_l,omega_r", rows))
    plain, record = read_log(path), read_log(path, ReadOptions(**options))  # type: ignore[arg-type]
    names = (*record.input_names, *record.output_names)
    i = names.index(channel)
    before, after = np.hstack([plain.u, plain.y])[:, i], np.hstack([record.u, record.y])[:, i]
    np.testing.assert_allclose(after, before * factor, rtol=1e-14)
    found = (*record.inputs, *record.outputs)[i]
    assert (found.unit, found.scale) == (unit, pytest.approx(factor, rel=1e-14))
    assert bool(found.file_unit) == (factor != 1.0)


def test_names_that_differ_in_case_are_different_channels(tmp_path: Path) -> None:
    path = put(tmp_path, table("t,u,U,y", [(k, k % 3, k % 5, k % 7) for k in range(20)]))
    options = ReadOptions(inputs=("u", "U"), units={"U": "mV"})
    assert [c.scale for c in read_log(path, options).inputs] == [1.0, 1e-3]


def test_suffixes_tell_units(tmp_path: Path) -> None:
    rows = [(k, k % 3, k % 5, k % 7) for k in range(20)]
    path = put(tmp_path, table("t_s,u_mV,y_rpm,omega_m", rows))
    log = read_file(path, ReadOptions(outputs=("y_rpm", "omega_m")))
    inputs, outputs = log.records[0].inputs, log.records[0].outputs
    assert (inputs[0].unit, inputs[0].scale) == ("V", 1e-3)
    assert (outputs[0].unit, outputs[0].file_unit) == ("rad/s", "rpm")
    assert outputs[1].unit == "rad/s"  # the motor's speed, not metres
    said = {d.what: d.value for d in log.records[0].read_as}
    assert said["in"] == "u_mV [mV → V]"
    assert said["out"] == "y_rpm [rpm → rad/s], omega_m [rad/s]"


def test_counter_and_missing_time(tmp_path: Path) -> None:
    rows = [(500 * k, k % 3, k % 5) for k in range(30)]
    path = put(tmp_path, table("sample,u,y", rows))
    log = read_file(path)
    assert log.records[0].dt == 1.0
    assert [f.severity for f in log.findings if f.code == "sample-time"] == [Severity.WARNING]
    timed = read_file(path, ReadOptions(ts=0.02))
    assert timed.records[0].dt == 0.02
    assert not timed.findings
    bare = put(tmp_path, table("u,y", [r[1:] for r in rows]), "bare.csv")
    assert read_log(bare, ReadOptions(ts=0.02)).dt == 0.02


def test_ts_overrules_the_time_column_aloud(tmp_path: Path) -> None:
    log = read_file(put(tmp_path, GOOD), ReadOptions(ts=0.5))
    assert log.records[0].dt == 0.5
    assert "`ts` was used" in " ".join(log.notes)


def test_rounded_stamps_are_a_uniform_grid(tmp_path: Path) -> None:
    times = np.round(np.arange(200) / 30, 3)  # 30 Hz written in milliseconds: 1.5 % off
    log = read_file(put(tmp_path, table("t,u,y", [(t, k % 2, k) for k, t in enumerate(times)])))
    assert not log.findings
    # Both ends are rounded by at most half a millisecond.
    assert log.records[0].dt == pytest.approx(1 / 30, abs=1e-3 / 199)


def test_jitter_is_resampled_with_a_warning(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    times = np.cumsum(0.1 + 0.015 * rng.uniform(-1, 1, 400))
    path = put(tmp_path, table("t,u,y", [(f"{t:.6f}", 1, 3 * t) for t in times]))
    log = read_file(path)
    record = log.records[0]
    assert [f.code for f in log.findings] == ["jitter"]
    # A straight line is what linear interpolation keeps; the input is constant.
    np.testing.assert_allclose(record.y[:, 0], 3 * record.t, atol=1e-5)
    np.testing.assert_allclose(record.u, 1.0, atol=1e-12)
    with pytest.raises(DataError, match="jitters by"):
        read_file(path, ReadOptions(resample="refuse"))


def test_held_input_keeps_its_integral(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    times = np.cumsum(0.1 + 0.02 * rng.uniform(-1, 1, 500))
    levels = rng.choice([-1.0, 1.0], 500)
    rows = [(f"{t:.6f}", u, np.cos(t)) for t, u in zip(times, levels, strict=True)]
    record = read_log(put(tmp_path, table("t,u,y", rows)))
    held = np.sum(levels[:-1] * np.diff(times))
    # The grid may end up to one interval before or after the last stamp.
    assert np.sum(record.u) * record.dt == pytest.approx(held, abs=2 * record.dt)


GAPPY = np.delete(np.arange(100) * 0.1, np.r_[40:52])


def test_long_gaps_are_refused_split_or_filled(tmp_path: Path) -> None:
    path = put(tmp_path, table("t,u,y", rows_of(GAPPY)))
    with pytest.raises(DataError, match=r"line 42: 1\.3 s without samples.*`resample='auto'`"):
        read_file(path, ReadOptions(resample="refuse"))
    split = read_file(path)
    parts = split.records
    assert [len(p) for p in parts] == [40, 48]
    assert any("cut into 2 experiments" in f.text for f in split.findings)
    assert parts[1].t0 == pytest.approx(5.2)
    with pytest.raises(DataError, match="2 experiments"):
        read_log(path)
    filled = read_log(path, ReadOptions(resample="fill"))
    assert len(filled) == 100
    np.testing.assert_array_equal(filled.u[40:52, 0], filled.u[39, 0])


def test_short_gaps_are_filled_aloud(tmp_path: Path) -> None:
    times = np.delete(np.arange(100) * 0.1, [40, 41])
    log = read_file(put(tmp_path, table("t,u,y", rows_of(times))))
    assert len(log.records[0]) == 100
    assert "2 missing samples were interpolated" in log.notes[0]


def test_missing_cells(tmp_path: Path) -> None:
    lines = GOOD.splitlines()
    lines[10] = "0.9,,3"
    path = put(tmp_path, "\n".join(lines) + "\n")
    with pytest.raises(DataError, match=r"line 11, column u: the cell is empty"):
        read_log(path, ReadOptions(resample="refuse"))
    filled = read_log(path)
    assert len(filled) == 30
    assert filled.y[9, 0] == pytest.approx((filled.y[8, 0] + filled.y[10, 0]) / 2)


def test_two_logs_in_one_file(tmp_path: Path) -> None:
    twice = GOOD + "".join(line + "\n" for line in GOOD.splitlines()[1:])
    path = put(tmp_path, twice)
    with pytest.raises(DataError, match=r"line 32.*several logs; `resample='auto'`"):
        read_log(path, ReadOptions(resample="refuse"))
    assert [len(r) for r in read_logs([path])] == [30, 30]


def test_a_last_line_cut_off_is_left_out(tmp_path: Path) -> None:
    log = read_file(put(tmp_path, GOOD + "3.0,1"))
    assert len(log.records[0]) == 30
    assert "cut off" in log.notes[0]


ROWS = {
    "ballbeam/ballbeam.csv": (1000, 1, 1, 0.1),
    "cascaded_tanks/est.csv": (1024, 1, 1, 4.0),
    "cdplayer_arm/cdplayer.csv": (2048, 2, 2, 1.0),
    "ced/unif_low.csv": (500, 1, 1, 0.02),
    "dryer/dryer.csv": (1000, 1, 1, 0.08),
    "emps/train.csv": (24841, 1, 1, 0.001),
    "hoop_motor/random_steps.csv": (8150, 1, 1, 0.1),
    "motor_generator/decim500.csv": (1000, 1, 1, 1.0),
    "mr_damper/damper.csv": (3499, 1, 1, 0.005),
    "silverbox/snls80mv.csv": (131072, 1, 1, 1 / 610.35),
    "tacho_motor/prbs_10hz.csv": (200, 1, 1, 0.1),
    "winding/winding.csv": (2500, 5, 2, 0.1),
}

# ------------------ the measured records


@needs_measured
@pytest.mark.parametrize("name", ROWS)
def test_measured_records_read_without_options(name: str) -> None:
    record = read_log(MEASURED / name)
    n, nu, ny, dt = ROWS[name]
    assert (len(record), record.nu, record.ny) == (n, nu, ny)
    assert record.dt == pytest.approx(dt, rel=1e-5)  # the Silverbox rate is printed with 5 digits
    assert record.sha256 == hashlib.sha256((MEASURED / name).read_bytes()).hexdigest()


# ------------------ writing


def test_write_atomic(tmp_path: Path) -> None:
    path = write_atomic(tmp_path / "new" / "deep" / "a.txt", "one\n")
    assert path.read_text() == "one\n"
    path.chmod(0o640)
    write_atomic(path, b"two\n")
    assert path.read_bytes() == b"two\n"
    assert path.stat().st_mode & 0o777 == 0o640
    assert [p.name for p in path.parent.iterdir()] == ["a.txt"]


def test_write_atomic_refuses_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="is a folder"):
        write_atomic(tmp_path, "x")
    (tmp_path / "file").write_text("x")
    with pytest.raises(UsageError, match="is not a folder"):
        write_atomic(tmp_path / "file" / "a.txt", "x")
    with pytest.raises(DataError, match="cannot be written"):
        write_atomic(tmp_path / ("n" * 300), "x")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_atomic(tmp_path / "a.txt", "old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(DataError, match="No space left"):
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
