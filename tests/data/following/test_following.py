"""Logs that are still being written: half lines, other files in their place, odd rows, clocks."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from sysid.data.following.lines import FileLines, PipeLines, lines_of
from sysid.data.following.rows import RowReader, Rows
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import DataError, UsageError

HEAD = ["t,volts,rpm", *(f"{0.1 * k:.1f},{k % 3},{10 * k}" for k in range(25))]


def rows_of(reader: RowReader, lines: Sequence[str]) -> Rows:
    """The rows of these lines, whose format is known."""
    found = reader.read(lines)
    assert found is not None
    return found


def begun(**options: object) -> RowReader:
    """A reader that has seen the head."""
    reader = RowReader("run.csv", ReadOptions(units={"volts": "V"}, **options))  # type: ignore[arg-type]
    assert len(rows_of(reader, HEAD).t) == 25
    return reader


def test_a_line_counts_when_its_end_has_come(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    source = lines_of(str(path))
    assert isinstance(source, FileLines)
    assert source.new() == []  # not there yet
    with path.open("w") as file:
        file.write("t,u,y\n0,1,2\n0.1,1")
        file.flush()
        assert source.new() == ["t,u,y", "0,1,2"]
        file.write(".5,3\r\n")
        file.flush()
        assert source.new() == ["0.1,1.5,3"]
        assert source.new() == []
        file.write("0.2,1,4")
        file.flush()
    assert source.new() == []
    assert source.last() == ["0.2,1,4"]
    source.close()


def test_a_file_that_is_cut_or_replaced_begins_anew(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t,u,y\n0,1,2\n")
    source = FileLines(path)
    assert len(source.new()) == 2
    path.write_text("t,u\n")  # cut
    assert source.new() == ["t,u"]
    assert source.restarted
    path.rename(tmp_path / "run.csv.1")  # rotated
    assert source.new() == []
    path.write_text("t,u,y\n5,6,7\n")
    assert source.new() == ["t,u,y", "5,6,7"]
    assert source.restarted
    assert source.new() == []
    assert not source.restarted
    source.close()


def test_a_pipe_ends_when_its_writer_goes(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    source = lines_of(str(path))
    assert isinstance(source, PipeLines)
    assert source.new() == []
    assert not source.ended
    writer = os.open(path, os.O_WRONLY)
    os.write(writer, b"t,u,y\n0,1")
    assert source.new() == ["t,u,y"]
    os.close(writer)
    assert source.new() == []
    assert source.ended
    assert source.last() == ["0,1"]
    source.close()


def test_zero_bytes_of_a_serial_line_are_left_out(tmp_path: Path) -> None:
    log = tmp_path / "run.csv"
    log.write_bytes(b"\0t,u,y\n" + b"0,1,2\n" * 20 + b"1,\x002,3\n")
    source = lines_of(str(log))
    assert source.new()[::21] == ["t,u,y", "1,2,3"]
    source.close()


def test_no_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="is a folder"):
        lines_of(str(tmp_path))
    with pytest.raises(UsageError, match="folder not found"):
        lines_of(str(tmp_path / "none" / "run.csv"))
    picture = tmp_path / "run.png"
    picture.write_bytes(b"\x89PNG\0\0\n")
    source = lines_of(str(picture))
    with pytest.raises(DataError, match="is not text"):
        source.new()
    source.close()


def test_units_and_columns_are_those_of_a_finished_log() -> None:
    reader = begun()
    assert [c.name for c in reader.inputs] == ["volts"]
    assert reader.outputs[0].unit == "rad/s"
    assert reader.dt == 0.1
    found = rows_of(reader, ["2.5,2,60"])
    assert found.t == pytest.approx([2.5])
    assert found.u[0, 0] == 2.0
    assert found.y[0, 0] == pytest.approx(2.0 * np.pi)
    assert not found.gap[0]


def test_what_is_missing_makes_a_gap() -> None:
    reader = begun()
    found = rows_of(reader, ["2.5,1,1", "2.9,1,1", "3.0,,1", "3.1,1,1", "3.2,nan,1", "3.3,1,2"])
    assert found.t == pytest.approx([2.5, 2.9, 3.1, 3.3])
    assert found.gap.tolist() == [False, True, True, True]
    assert reader.lost.incomplete == 2


def test_lines_that_are_no_rows_are_counted() -> None:
    reader = begun()
    odd = ["2.5,1,1", "2.5,1,1", "garbage", "2.6,1", "2.6,x,1", "2.6,1,1", "", HEAD[0]]
    found = rows_of(reader, odd)
    assert found.t == pytest.approx([2.5, 2.6])
    assert not found.gap.any()
    assert reader.lost.doubled == 1
    assert reader.lost.unreadable == 3


def test_a_clock_that_begins_again_goes_on() -> None:
    reader = begun()
    reader.restart()
    found = rows_of(reader, ["0.0,1,1", "0.1,1,2"])
    assert found.t == pytest.approx([2.5, 2.6])
    assert found.gap.tolist() == [True, False]


@pytest.mark.parametrize(
    ("head", "stamp", "options"),
    [
        ("time_ms", lambda k: f"{100 * k + 7}", {}),
        ("timestamp", lambda k: f"{1.7e9 + 0.1 * k:.1f}", {}),
        ("timestamp", lambda k: f"2026-03-01 23:59:{58 + 0.1 * k:04.1f}", {}),
        ("sample", lambda k: f"{k}", {"ts": 0.1}),
    ],
)
def test_clocks_in_other_units(head: str, stamp: object, options: dict[str, float]) -> None:
    assert callable(stamp)
    reader = RowReader("run.csv", ReadOptions(inputs=("volts",), outputs=("w",), **options))  # type: ignore[arg-type]
    last = 19
    lines = [f"{head},volts,w", *(f"{stamp(k)},{k % 3},{k}" for k in range(last + 1))]
    if "2026" in str(stamp(0)):
        lines = [f"{head},volts,w"] + [
            f"2026-03-01 23:00:{0.1 * k:04.1f},{k % 3},{k}" for k in range(last + 1)
        ]
    found = rows_of(reader, lines)
    assert reader.dt == pytest.approx(0.1)
    assert np.diff(found.t) == pytest.approx(0.1, abs=1e-6)  # of stamps of 1.7e9 s
    assert not found.gap.any()


def test_few_rows_must_do_where_no_more_come() -> None:
    reader = RowReader("run.csv")
    assert reader.read(["t,u,y", "0,1,2", "1,1,3"]) is None
    assert reader.read(["2,1,4"], last=True) is not None
    assert reader.dt == 1.0


@pytest.mark.parametrize(
    "options",
    [
        {"speed_of": ("y",)},
        {"unwrap": {"": 360.0}},
        {"held": "4"},
        {"resample": "fill"},
        {"stamps": "header"},
        {"latency": "remove"},
    ],
)
def test_what_needs_the_whole_log_is_refused(options: dict[str, object]) -> None:
    with pytest.raises(UsageError, match="needs the whole log"):
        RowReader("run.csv", ReadOptions(**options))  # type: ignore[arg-type]


@pytest.mark.parametrize("rows", [20, 60])
def test_a_clock_in_two_columns_goes_on_in_its_order_of_day_and_month(rows: int) -> None:
    """One row alone, and a head of one day, do not show the order."""
    reader = RowReader("run.csv", ReadOptions())
    at = [f"{4 + k // 24:02}/03/2026,{k % 24:02}:00:00" for k in range(rows)]
    head = ["day,hms,u,y", *(f"{t},{k % 5},{k % 7}" for k, t in enumerate(at))]
    assert len(rows_of(reader, head).t) == rows
    more = rows_of(reader, ["07/03/2026,00:00:00,1,2"])
    np.testing.assert_allclose(more.t, [72 * 3600.0])
