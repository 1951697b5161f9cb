"""Reading logs: every way a log may be written, and every way it may be broken."""

import contextlib
import hashlib
import os
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid.data.files import write_atomic
from sysid.data.finding import Severity
from sysid.data.io import ReadOptions, read_file, read_files, read_log, read_logs
from sysid.data.reading.columns import choose_columns
from sysid.data.record import PWM_FULL_SCALE
from sysid.errors import DataError, SysidError, UsageError

MEASURED = Path(os.environ.get("SYSID_DATA", "../shared/data"))
needs_measured = pytest.mark.skipif(
    not MEASURED.is_dir(), reason="the measured records are not there (../shared/data, SYSID_DATA)"
)
GOOD = "t,u,y\n" + "".join(f"{0.1 * k:.1f},{k % 3},{k * k % 7}.5\n" for k in range(30))


def put(folder: Path, content: str | bytes, name: str = "log.csv") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def table(header: str, rows: list[tuple[object, ...]], sep: str = ",") -> str:
    return "\n".join([header, *(sep.join(str(c) for c in row) for row in rows)]) + "\n"


def rows_of(times: np.ndarray) -> list[tuple[object, ...]]:
    return [(f"{t:.6f}", k % 4, round(np.sin(k), 6)) for k, t in enumerate(times)]


# ---------------------------------------------------------------- the ways a log may be written

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
    with pytest.raises(DataError, match=r"row 1, column y: 'fast' is no number"):
        read_log(tmp_path / "bad.parquet")


@pytest.mark.parametrize(
    ("names", "inputs", "outputs", "pose"),
    [
        ("t pwm_l pwm_r omega_l omega_r", "pwm_l pwm_r", "omega_l omega_r", ""),
        (
            "omega_r t x pwm_r y psi omega_l pwm_l v_ref",
            "pwm_l pwm_r",
            "omega_l omega_r",
            "x y psi",
        ),
        ("t pwm_l omega_l x y psi", "pwm_l", "omega_l", "x y psi"),
        ("t_s u_V y_speed_V", "u_V", "y_speed_V", ""),
        ("sample u1 u2 y1 y2", "u1 u2", "y1 y2", ""),
        ("t_s u1 u2 u3 u4 u5 y1_tension y2_tension", "u1 u2 u3 u4 u5", "y1_tension y2_tension", ""),
        ("t_s u_vir_V y_qm_m ref_qg_m", "u_vir_V", "y_qm_m", ""),
        ("time cmd_l cmd_r speed_l speed_r speed_ref", "cmd_l cmd_r", "speed_l speed_r", ""),
        ("Time Input Output", "Input", "Output", ""),
        ("index inertia voltage w_rad_s", "voltage", "w_rad_s", ""),
        ("t in1 out1 omega_ref", "in1", "out1", ""),
    ],
)
def test_columns_by_convention(names: str, inputs: str, outputs: str, pose: str) -> None:
    choice = choose_columns(names.split())
    assert choice.inputs == tuple(inputs.split())
    assert choice.outputs == tuple(outputs.split())
    assert choice.pose == tuple(pose.split())


def test_columns_by_option(tmp_path: Path) -> None:
    path = put(tmp_path, table("a,b,c,d", [(k % 3, k, -k, 7 * k % 5) for k in range(30)]))
    record = read_log(path, ReadOptions(inputs=("d",), outputs=("c", "A"), ts=0.2))
    assert record.input_names == ("d",)
    assert record.output_names == ("c", "a")
    np.testing.assert_array_equal(record.y[:, 0], -np.arange(30))
    assert record.dt == 0.2


# ------------------------------------------------------------------------------- units and time


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
    log = read_file(put(tmp_path, table("t_s,u_mV,y_rpm,omega_m", rows)))
    inputs, outputs = log.records[0].inputs, log.records[0].outputs
    assert (inputs[0].unit, inputs[0].scale) == ("V", 1e-3)
    assert (outputs[0].unit, outputs[0].file_unit) == ("rad/s", "rpm")
    assert outputs[1].unit == "rad/s"  # the motor's speed, not metres
    assert any("converted from rpm" in n for n in log.notes)


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
    with pytest.raises(DataError, match=r"line 42: 1\.3 s without samples.*`resample='split'`"):
        read_file(path)
    parts = read_logs([path], ReadOptions(resample="split"))
    assert [len(p) for p in parts] == [40, 48]
    assert parts[1].t0 == pytest.approx(5.2)
    with pytest.raises(DataError, match="2 experiments"):
        read_log(path, ReadOptions(resample="split"))
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
        read_log(path)
    filled = read_log(path, ReadOptions(resample="fill"))
    assert len(filled) == 30
    assert filled.y[9, 0] == pytest.approx((filled.y[8, 0] + filled.y[10, 0]) / 2)


def test_two_logs_in_one_file(tmp_path: Path) -> None:
    twice = GOOD + "".join(line + "\n" for line in GOOD.splitlines()[1:])
    path = put(tmp_path, twice)
    with pytest.raises(DataError, match=r"line 32.*several logs: `resample='split'`"):
        read_log(path)
    assert [len(r) for r in read_logs([path], ReadOptions(resample="split"))] == [30, 30]


def test_a_last_line_cut_off_is_left_out(tmp_path: Path) -> None:
    log = read_file(put(tmp_path, GOOD + "3.0,1"))
    assert len(log.records[0]) == 30
    assert "cut off" in log.notes[0]


# --------------------------------------------------------------------------------- broken files

BAD_FILES: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", "is empty"),
    "blank": ("\n \n\n", "is empty"),
    "only a mark": (b"\xef\xbb\xbf", "is empty"),
    "header only": ("t,u,y\n", "header but no rows"),
    "no header": ("0,1,2\n0.1,2,3\n", "line 1 holds numbers.*header row"),
    "no header, commas": ("0;1,5;2\n0,1;2;3\n", "line 1 holds numbers"),
    "duplicate names": ("t,u,u\n0,1,2\n", "two columns named u"),
    "nameless column": ("t,u,,y\n0,1,2,3\n", "column 3 has no name"),
    "one column": ("y\n1\n2\n", "only the column y"),
    "text cell": ("t,u,y\n0,1,2\n0.1,fast,3\n", "line 3, column u: 'fast' is no number"),
    "words below the header": (
        "t,u,y\nred,green,blue\n0,1,2\n",
        "line 2, column u: .green. is no number; write numbers",
    ),
    "long row": ("t,u,y\n0,1,2\n0.1,1,2,9\n0.2,1,2\n", "line 3 has 4 cells where the header has 3"),
    "short row": ("t,u,y\n0,1,2\n0.1,1\n0.2,1,2\n", "line 3 has 2 cells"),
    "decimal commas": ("t,u,y\n0,0,1,5,2,0\n0,1,1,5,2,0\n", "line 2 has 6 cells.*decimal comma"),
    "thousands": ("t;u;y\n0;1.234,5;1\n1;2;3\n", "1.234,5.*thousands"),
    "hex": ("t,u,y\n0,0x10,1\n1,2,3\n", "'0x10' is no number"),
    "underscores": ("t,u,y\n0,1_000,1\n1,2,3\n", "'1_000' is no number"),
    "infinity": ("t,u,y\n0,1,2\n1,inf,3\n", "line 3, column u: infinity"),
    "too large": ("t,u,y\n0,1,2\n1,1e999,3\n", "line 3, column u: infinity"),
    "binary": (bytes(range(256)) * 8, "no text"),
    "control signs": (b"t,u\x01\x02\x03\xff\x04\x05\n" * 20, "no text but binary"),
    "UTF-16 without mark": ("t,u,y\n0,1,2\n".encode("utf-16-le"), "UTF-16 text without its mark"),
    "half UTF-16": ("t,u,y\n0,1,2\n".encode("utf-16")[:-1], "damaged UTF-16"),
    "zip": (b"PK\x03\x04rest", "spreadsheet or zip"),
    "gzip": (b"\x1f\x8b\x08rest", "gzip"),
    "damaged parquet": (b"PAR1 but nothing else", "not a Parquet file"),
    "open quote": ('t,u,y\n0,"1,2\n0.1,1,2\n0.2,3,4\n', "line 2 has 2 cells"),
    "JSON": ('{"t": [0, 1], "u": [1, 2]}', "is JSON"),
    "web page": ("<html><body>404</body></html>", "a web page"),
    "emoji": ("t,u,y\n0,1,😀\n1,2,3\n", "line 2, column y: '😀' is no number; mend"),
    "endless text": ("t,u,y\n0,1," + "x" * 5000 + "\n1,2,3\n", "line 2, column y: 'xxx"),
    "many columns": (
        ",".join(f"c{i}" for i in range(300)) + "\n" + ",".join("1" * 300) + "\n",
        "c14 and 285 more",
    ),
    "absurd value": ("t,u,y\n0,1,2\n1,1e300,3\n", "line 3, column u: 1e.300 is no measurement"),
    "absurd time step": ("t,u,y\n0,1,2\n1e-30,2,3\n2e-30,2,3\n", "not credible"),
    "mixed decimals": ("t;u;y\n0;1,5;2.5\n1;2;3\n", "'1,5' is no number.*decimal comma"),
    "strange names": (
        "a,b,c\n0,1,2\n1,2,3\n",
        "cannot tell which column is input and which output among a, b, c.*`inputs=NAME`",
    ),
    "two columns without names": ("left,right\n0,1\n1,2\n", "cannot tell which column"),
    "no output": ("t,u1,u2\n0,1,2\n1,2,3\n", "no column left for the output"),
    "time backward": ("t,u,y\n2,1,2\n1,2,3\n0,2,3\n", "backward all along"),
    "time not increasing": (GOOD + "2.5,1,1\n3.0,1,2\n", "line 32: time does not increase"),
    "time twice": (GOOD + "2.9,1,1\n3.0,1,2\n", "line 32: time 2.9 is there twice"),
    "time still": ("t,u,y\n" + "0,1,2\n" * 30, "time stands still"),
    "time missing": ("t,u,y\n0,1,2\n,2,3\n2,2,3\n", "line 3, column t: the time is missing"),
    "time infinite": ("t,u,y\n0,1,2\ninf,2,3\n2,2,3\n", "line 3, column t: infinity"),
    "bad date": ("time,u,y\n2024-05-01T12:00:00,1,2\nsoon,1,2\n", "line 3.*'soon' is no date"),
    "irregular": (
        table("t,u,y", [(f"{t:.3f}", 1, 2) for t in np.cumsum([0.01, 0.05, 0.2, 0.7] * 20)]),
        "sampling is irregular",
    ),
    "one row": ("t,u,y\n0,1,2\n", "1 row of numbers"),
    "empty column": ("t,u,y\n0,,2\n1,,3\n2,,4\n", "column u is empty in 3 of 3"),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_broken_files_get_one_sentence(tmp_path: Path, case: str) -> None:
    content, expected = BAD_FILES[case]
    path = put(tmp_path, content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(SysidError, match=expected) as caught:
            read_log(path)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 400
    assert "log.csv" in text
    assert caught.value.exit_code == 1


def test_places_that_are_no_file(tmp_path: Path) -> None:
    put(tmp_path, GOOD, "drive.csv")
    with pytest.raises(UsageError, match=r"no file .*drvie.csv.*did you mean .*drive\.csv"):
        read_log(tmp_path / "drvie.csv")
    with pytest.raises(UsageError, match="is a folder"):
        read_log(tmp_path)
    with pytest.raises(DataError, match="not a Parquet file"):
        read_log(put(tmp_path, GOOD, "really.parquet"))
    with pytest.raises(UsageError, match="not a file name"):
        read_log("log\0.csv")
    with pytest.raises(UsageError, match="no log is named"):
        read_logs([])


def test_no_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Path) -> bytes:  # the superuser, as in a container, may read every file
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(DataError, match="may not be read; give yourself read permission"):
        read_log(put(tmp_path, GOOD))


BAD_OPTIONS: list[tuple[dict[str, object], str]] = [
    ({"ts": 0.0}, "`ts` must be a positive"),
    ({"ts": -1.0}, "`ts` must be a positive"),
    ({"ts": float("nan")}, "`ts` must be a positive"),
    ({"inputs": ("v",)}, r"`inputs` asks for 'v'.*columns are t, u, y"),
    ({"inputs": ("",)}, "`inputs` asks for an empty name"),
    ({"inputs": ("u", "u")}, "column u of log.csv twice"),
    ({"inputs": ("u",), "outputs": ("u",)}, "both input and output"),
    ({"inputs": ("t",), "time": "t"}, "is the time"),
    ({"time": "clock"}, "`time` asks for 'clock'"),
    ({"units": {"y": "furlong"}}, "unknown unit 'furlong' of y; known are rad/s, rpm"),
    ({"units": {"z": "rpm"}}, "`units` names 'z', which is no channel"),
    ({"units": {"y": "ticks/0"}}, "ticks per turn must be a positive"),
    ({"units": {"y": "ticks/e"}}, "ticks per turn must be a positive"),
    ({"pwm_max": 0.0}, "`pwm_max` must be a positive"),
    ({"pwm_max": float("inf")}, "`pwm_max` must be a positive"),
    ({"delimiter": "ab"}, "the delimiter must be"),
    ({"decimal": ";"}, "the decimal sign must be"),
    ({"delimiter": ",", "decimal": ","}, "cannot both be"),
    ({"resample": "maybe"}, "unknown `resample` 'maybe'"),
]


@pytest.mark.parametrize(("options", "expected"), BAD_OPTIONS)
def test_bad_options_get_one_sentence(
    tmp_path: Path, options: dict[str, object], expected: str
) -> None:
    path = put(tmp_path, GOOD)
    with pytest.raises(UsageError, match=expected):
        read_log(path, ReadOptions(**options))  # type: ignore[arg-type]


def test_pwm_max_needs_pwm(tmp_path: Path) -> None:
    path = put(tmp_path, GOOD.replace("t,u,y", "t,u_V,y"))
    with pytest.raises(UsageError, match="have other units"):
        read_log(path, ReadOptions(pwm_max=255))


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (GOOD.replace("t,u,y", "t,u2,y"), "has the inputs u2, log.csv has u"),
        (GOOD.replace("t,u,y", "t,u,y2"), "has the outputs y2"),
        (GOOD.replace("t,u,y", "t_ms,u,y"), "is sampled every 0.0001 s, log.csv every 0.1"),
        (GOOD.replace("t,u,y", "t,u [V],y"), "u is in V in other.csv, in no unit in log.csv"),
    ],
)
def test_experiments_must_agree(tmp_path: Path, other: str, expected: str) -> None:
    paths = [put(tmp_path, GOOD), put(tmp_path, other, "other.csv")]
    with pytest.raises(DataError, match=expected):
        read_files(paths)


def test_options_survive_json(tmp_path: Path) -> None:
    import json

    options = ReadOptions(
        inputs=("u",), units={"y": "rpm"}, ts=0.1, pwm_max=255, resample="fill", delimiter=";"
    )
    assert ReadOptions.from_json(json.loads(json.dumps(options.to_json()))) == options
    assert ReadOptions.from_json({}) == ReadOptions()
    assert ReadOptions().to_json() == {}
    with pytest.raises(UsageError, match="unknown read option 'colour'"):
        ReadOptions.from_json({"colour": "red"})
    with pytest.raises(UsageError, match="damaged"):
        ReadOptions.from_json({"inputs": 3})


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    st.lists(
        st.tuples(*[st.floats(-1e9, 1e9, allow_subnormal=False)] * 2), min_size=3, max_size=12
    ),
    st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", ".")]),
)
def test_numbers_survive_any_layout(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[float, float]],
    layout: tuple[str, str],
) -> None:
    sep, point = layout
    lines = [sep.join(repr(c).replace(".", point) for c in row) for row in rows]
    path = put(tmp_path_factory.mktemp("any"), "\n".join([sep.join("uy"), *lines]) + "\n")
    # Asked for by name: a column of whole numbers cannot show which decimal sign it uses.
    record = read_log(path, ReadOptions(ts=1.0, delimiter=sep, decimal=point))
    # The fast parser of pandas may miss the last bit.
    np.testing.assert_allclose(np.hstack([record.u, record.y]), rows, rtol=1e-15, atol=0)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.binary(max_size=120), st.sampled_from(["", "t,u,y\n", "t;u;y\n0;1;2\n1;1;1\n", "u y\n"]))
def test_any_bytes_give_a_record_or_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, junk: bytes, start: str
) -> None:
    path = put(tmp_path_factory.mktemp("junk"), start.encode() + junk)
    with contextlib.suppress(SysidError):  # anything else, a warning too, fails the test
        read_logs([path])


# ----------------------------------------------------------------------- the measured records

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


@needs_measured
@pytest.mark.parametrize("name", ROWS)
def test_measured_records_read_without_options(name: str) -> None:
    record = read_log(MEASURED / name)
    n, nu, ny, dt = ROWS[name]
    assert (len(record), record.nu, record.ny) == (n, nu, ny)
    assert record.dt == pytest.approx(dt, rel=1e-5)  # the Silverbox rate is printed with 5 digits
    assert record.sha256 == hashlib.sha256((MEASURED / name).read_bytes()).hexdigest()


# --------------------------------------------------------------------------------------- writing


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
