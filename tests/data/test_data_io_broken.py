"""Logs that cannot be read as they are: broken files are refused in one sentence."""

import contextlib
import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from data_io_cases import GOOD, put, table
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid.data import documents
from sysid.data.io import read_files, read_log, read_logs
from sysid.data.reading.read_options import ReadOptions
from sysid.data.schema import checked
from sysid.errors import DataError, SysidError, UsageError

BAD_FILES: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", "is empty"),
    "blank": ("\n \n\n", "is empty"),
    "only a mark": (b"\xef\xbb\xbf", "is empty"),
    "header only": ("t,u,y\n", "header but no rows"),
    "no header": ("0,1,2\n0.1,2,3\n", "the input and the output can be column_1, column_2"),
    "nameless column": ("t,u,,y\n0,1,2,3\n", "column 3 has no name"),
    "one column": ("y\n1\n2\n", "only the column y"),
    "text cell": ("t,u,y\n0,1,2\n0.1,fast,3\n", "line 3, column u: 'fast' is not a number"),
    "words below the header": (
        "t,u,y\nred,green,blue\n0,1,2\n",
        "line 2, column t: .red. is not a number; write numbers",
    ),
    "long row": ("t,u,y\n0,1,2\n0.1,1,2,9\n0.2,1,2\n", "line 3 has 4 cells where the header has 3"),
    "short row": ("t,u,y\n0,1,2\n0.1,1\n0.2,1,2\n", "line 3 has 2 cells"),
    "decimal commas": ("t,u,y\n0,0,1,5,2,0\n0,1,1,5,2,0\n", "line 2 has 6 cells.*decimal comma"),
    "hex": ("t,u,y\n0,0x10,1\n1,2,3\n", "'0x10' is not a number"),
    "underscores": ("t,u,y\n0,1_000,1\n1,2,3\n", "'1_000' is not a number"),
    "infinity": ("t,u,y\n0,1,2\n1,inf,3\n", "line 3, column u: infinity"),
    "too large": ("t,u,y\n0,1,2\n1,1e999,3\n", "line 3, column u: infinity"),
    "binary": (bytes(range(256)) * 8, "is not text"),
    "control signs": (b"t,u\x01\x02\x03\xff\x04\x05\n" * 20, "is binary"),
    "half UTF-16": ("t,u,y\n0,1,2\n".encode("utf-16")[:-1], "damaged UTF-16"),
    "zip": (b"PK\x03\x04rest", "spreadsheet or zip"),
    "gzip": (b"\x1f\x8b\x08rest", "gzip"),
    "damaged parquet": (b"PAR1 but nothing else", "not a Parquet file"),
    "open quote": ('t,u,y\n0,"1,2\n0.1,1,2\n0.2,3,4\n', "line 2 has 2 cells"),
    "JSON of scalars": ('{"t": 0, "u": [1]}', "no columns of equal length"),
    "JSON, no end": ('{"t": [0, 1', "line 1 is no JSON"),
    "deep JSON": ("[" * 100_000, "damaged JSON"),
    "MATLAB": (b"MATLAB 5.0 MAT-file" + bytes(200), "damaged MATLAB file"),
    "web page": ("<html><body>404</body></html>", "a web page"),
    "emoji": ("t,u,y\n0,1,😀\n1,2,3\n", "line 2, column y: '😀' is not a number; correct"),
    "endless text": ("t,u,y\n0,1," + "x" * 5000 + "\n1,2,3\n", "line 2, column y: 'xxx"),
    "many columns": (
        ",".join(f"c{i}" for i in range(300)) + "\n" + ",".join("1" * 300) + "\n",
        "c7 and 292 more",
    ),
    "absurd value": ("t,u,y\n0,1,2\n1,1e300,3\n", "line 3, column u: 1e.300 is not a valid number"),
    "absurd time step": ("t,u,y\n0,1,2\n1e-30,2,3\n2e-30,2,3\n", "not credible"),
    "mixed decimals": ("t;u;y\n0;1,5;2.5\n1;2;3\n", "'1,5' is not a number.*decimal comma"),
    "strange names": (
        "a,b,c\n0,1,2\n1,2,3\n",
        "the input and the output can be a, b or c;.*`inputs='a', outputs='b'`",
    ),
    "two columns without names": ("left,right\n0,1\n1,2\n", "can be left or right"),
    "no output": ("t,u1,u2\n0,1,2\n1,2,3\n", "no column left for the output"),
    "time backward": ("t,u,y\n2,1,2\n1,2,3\n0,2,3\n", "time decreases throughout"),
    "time not increasing": (GOOD + "2.5,1,1\n3.0,1,2\n", "line 32: time does not increase"),
    "rows in disorder": (
        table("t,u,y", [(f"{0.02 * (k * 271 % 600):.2f}", k % 7, k % 5) for k in range(600)]),
        "does not increase.*sort the rows",
    ),
    "two rows exchanged": (
        table(
            "t,u,y",
            [(f"{0.02 * (k + (k % 50 == 9) - (k % 50 == 10)):.2f}", 1, k) for k in range(600)],
        ),
        "does not increase.*sort the rows",
    ),
    "time twice": (GOOD + "2.9,1,1\n3.0,1,2\n", "line 32: time 2.9 appears twice"),
    "time still": ("t,u,y\n" + "0,1,2\n" * 30, "time stays at"),
    "time missing": ("t,u,y\n0,1,2\n,2,3\n2,2,3\n", "line 3, column t: the time is missing"),
    "time infinite": ("t,u,y\n0,1,2\ninf,2,3\n2,2,3\n", "line 3, column t: infinity"),
    "bad date": ("time,u,y\n2024-05-01T12:00:00,1,2\nsoon,1,2\n", "line 3.*'soon' is not a date"),
    "irregular": (
        table("t,u,y", [(f"{t:.3f}", 1, 2) for t in np.cumsum([0.01, 0.05, 0.2, 0.7] * 20)]),
        "sampling is irregular",
    ),
    "one row": ("t,u,y\n0,1,2\n", "1 row of numbers"),
    "empty column": ("t,u,y\n0,,2\n1,,3\n2,,4\n", "column u is empty in 3 of 3"),
}

# ------------------ broken files


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
    with pytest.raises(UsageError, match=r"drvie.csv: file not found; did you mean .*drive\.csv"):
        read_log(tmp_path / "drvie.csv")
    with pytest.raises(UsageError, match="is a folder"):
        read_log(tmp_path)
    with pytest.raises(DataError, match="not a Parquet file"):
        read_log(put(tmp_path, GOOD, "really.parquet"))
    with pytest.raises(UsageError, match="not a valid path"):
        read_log("log\0.csv")
    with pytest.raises(UsageError, match="no log given"):
        read_logs([])


def test_no_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> int:  # the superuser, as in a container, may read every file
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(DataError, match="is not readable; change its permissions"):
        read_log(put(tmp_path, GOOD))


BAD_OPTIONS: list[tuple[dict[str, object], str]] = [
    ({"ts": 0.0}, "`ts` must be a positive"),
    ({"ts": -1.0}, "`ts` must be a positive"),
    ({"ts": float("nan")}, "`ts` must be a positive"),
    ({"inputs": ("v",)}, r"`inputs` names 'v'.*columns are t, u, y"),
    ({"inputs": ("",)}, "`inputs` names an empty name"),
    ({"inputs": ("u", "u")}, "column u of log.csv twice"),
    ({"inputs": ("u",), "outputs": ("u",)}, "both input and output"),
    ({"inputs": ("t",), "time": "t"}, "is the time"),
    ({"time": "clock"}, "`time` names 'clock'"),
    ({"units": {"y": "furlong"}}, "unknown unit 'furlong' of y; known are rad/s, rpm"),
    ({"units": {"z": "rpm"}}, "`units` names 'z', which is not a channel"),
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
        (GOOD.replace("t,u,y", "t,u2,y"), "has u2 -> y but log.csv has u -> y"),
        (GOOD.replace("t,u,y", "t,u,y2"), "-> y2 but log.csv has"),
        (
            GOOD.replace("t,u,y", "t_ms,u,y"),
            "is sampled every 0.0001 s, the others every 0.1 s; check the unit",
        ),
        (GOOD.replace("t,u,y", "t,u [V],y"), "u is in V in other.csv, in no unit in log.csv"),
    ],
)
def test_experiments_must_agree(tmp_path: Path, other: str, expected: str) -> None:
    paths = [put(tmp_path, GOOD), put(tmp_path, other, "other.csv")]
    with pytest.raises(DataError, match=expected):
        read_files(paths)


def test_options_survive_json(tmp_path: Path) -> None:
    options = ReadOptions(
        inputs=("u",), units={"y": "rpm"}, ts=0.1, pwm_max=255, resample="fill", delimiter=";"
    )
    assert checked(ReadOptions, documents.plain(options)) == options
    assert checked(ReadOptions, {}) == ReadOptions()
    assert ReadOptions().to_json() == {}
    with pytest.raises(ValueError, match="'colour' is not known"):
        checked(ReadOptions, {"colour": "red"})
    with pytest.raises(ValueError, match="inputs: it should be"):
        checked(ReadOptions, {"inputs": 3})


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
