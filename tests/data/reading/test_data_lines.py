"""A long log of plain numbers is read without looking at every line, and says the same."""

from pathlib import Path

import numpy as np
import pytest

from sysid.data.io import read_file, read_log
from sysid.data.reading.data_lines import HEAD, cut_tail
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import DataError

ROWS = 3 * HEAD


def plain(separator: str = ",", end: str = "\n") -> list[str]:
    rng = np.random.default_rng(1)
    u, y = rng.standard_normal((2, ROWS))
    lines = [separator.join(("t", "u", "y"))]
    cells = zip(0.1 * np.arange(ROWS), u, y, strict=True)
    lines += [separator.join(f"{v:.6g}" for v in row) for row in cells]
    return [line + end for line in lines]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_plain_log_is_cut(separator: str, end: str, tmp_path: Path) -> None:
    lines = plain(separator, end)
    cut = cut_tail("".join(lines).encode())
    assert cut is not None
    assert cut[1].numbers == range(HEAD + 1, len(lines) + 1)
    path = tmp_path / "log.csv"
    path.write_bytes("".join(lines).encode())
    log = read_log(path)
    assert log.t[-1] == pytest.approx(0.1 * (ROWS - 1))
    last = [float(c) for c in lines[-1].split(separator)]
    assert [log.u[-1, 0], log.y[-1, 0]] == last[1:]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("# a comment\n", ""),
        ("t,u,y\n", ""),
        ("\n", ""),
        ("119.5,1.0\n", f"line {ROWS - 3} has 2 cells"),
        ("119.5,1.0,2.0,3.0\n", f"line {ROWS - 3} has 4 cells"),
        ("119.5,1.0,fault\n", "'fault' is not a number"),
        ("119.5,1e,2.0\n", "'1e' is not a number"),
    ],
)
def test_what_is_odd_behind_the_head_is_still_met(line: str, said: str, tmp_path: Path) -> None:
    lines = plain()
    path = tmp_path / "log.csv"
    path.write_text("".join([*lines[: ROWS - 4], line, *lines[ROWS - 4 :]]))
    if said:
        with pytest.raises(DataError, match=said):
            read_log(path, ReadOptions(strict=True))
        log = read_file(path)
        assert len(log.records[0]) == ROWS
        quoted = f"1 line that is no row was left out: line {ROWS - 3} {line.strip()!r}"
        if "not a number" in said:
            quoted = f"({said.split()[0]} in line {ROWS - 3})"
        assert any(quoted in note for note in log.notes)
    else:
        assert len(read_log(path)) == ROWS


def test_a_header_below_all_lines_that_are_looked_at_is_met(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("# a remark\n" * (HEAD - 1) + "".join(plain()))
    assert len(read_log(path)) == ROWS


@pytest.mark.parametrize(
    "text", ["", "t,u,y\n", "t u y\n" + "0 1 2\n" * ROWS, "t,u\n" + "1,2\n3\n" * ROWS]
)
def test_other_text_is_not_cut(text: str) -> None:
    assert cut_tail(text.encode()) is None
