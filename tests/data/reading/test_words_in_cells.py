"""Words in the cells of a table: what they mean depends on the columns that are used."""

from pathlib import Path

import numpy as np
import pytest

from sysid.data.io import LogFile, read_file
from sysid.data.reading.read_options import ReadOptions
from sysid.errors import DataError, UnclearColumnsError

N = 300
DRAW = np.random.default_rng(7)
U = np.repeat(DRAW.integers(0, 60, N // 10), 10)
ROWS = [f"12.03.26 08:{k // 60:02}:{k % 60:02};{U[k]};{k * 7 % 31};N{k}x" for k in range(N)]
HEADER = "Zeit;u;y;Lage;Notiz"


def read(folder: Path, cells: dict[int, dict[int, str]], **options: object) -> LogFile:
    """The log with other cells: row → column → text."""
    rows = [[*r.split(";"), ""] for r in ROWS]
    for k, of_row in cells.items():
        for i, text in of_row.items():
            rows[k][i] = text
    path = folder / "l.csv"
    path.write_text("\n".join([HEADER, *(";".join(r) for r in rows), ""]))
    given = {"inputs": "u", "outputs": "y"} | options
    return read_file(path, ReadOptions(**given))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("cells", "bad", "said"),
    [
        ({}, 0, ""),
        ({4: {4: "start"}, 90: {4: "wind from aft"}}, 0, ""),  # a column of remarks
        ({k: {4: "run on"} for k in range(0, N, 3)}, 0, ""),
        ({4: {4: "7"}, 90: {4: "x"}, 95: {4: "12.5"}}, 0, ""),
        ({k: {3: f"{k}"} for k in range(20, 40)}, 0, ""),  # numbers in a column of text
        ({50: {2: "OVL"}}, 1, "y ('OVL' in line 52)"),
        ({50: {2: "I/O"}, 60: {2: "Bad"}, 61: {1: "Bad"}}, 3, "u ('Bad' in line 63)"),
        ({50: {0: "reset"}}, 1, "line 52 'nan;"),
        ({N - 1: {0: "mean", 3: ""}}, 1, "line 301 'mean;"),
    ],
)
def test_a_row_is_bad_only_by_the_columns_used(
    cells: dict[int, dict[int, str]], bad: int, said: str, tmp_path: Path
) -> None:
    log = read(tmp_path, cells)
    notes = " ".join(log.notes)
    assert said in notes
    assert ("left out" in notes or "were interpolated" in notes) == (bad > 0)
    assert ("first of 2 such rows" in notes) == (bad > 1)  # the third row lacks its input, too
    used = np.arange(N)[: len(log.records[0])]
    kept = [k for k in used if k not in cells or not bad]
    np.testing.assert_array_equal(log.records[0].u[kept, 0], U[kept])


def test_a_word_in_a_column_of_numbers_that_is_not_used(tmp_path: Path) -> None:
    for unused, y in (("u", "y"), ("y", "u")):
        log = read(
            tmp_path, {50: {HEADER.split(";").index(unused): "Bad"}}, inputs="none", outputs=y
        )
        assert len(log.records[0]) == N


def test_strict_refuses_a_word_only_where_it_is_used(tmp_path: Path) -> None:
    assert len(read(tmp_path, {9: {4: "start"}}, strict=True).records[0]) == N
    for column in (0, 1, 2):
        with pytest.raises(DataError, match=r"line 11, column .*'Bad'"):
            read(tmp_path, {9: {column: "Bad"}}, strict=True)


COLUMNS = {
    "UTC": lambda k: f"08:{k // 60:02}:{k % 60:02}",
    "Order": lambda k: f"{U[k]}",
    "Sway": lambda k: f"{k * 7 % 31}",
    "Load": lambda k: f"{k * 5 % 17}",
    "Set": lambda k: "3.5",
    "Remarks": lambda k: "run" if k % 50 == 3 else "",
    "Place": lambda k: f"N{k}x",
    "Spoiled": lambda k: "?" if k % 3 == 0 else f"{k % 9}",
}


@pytest.mark.parametrize(
    ("columns", "asked"),
    [
        ("UTC Remarks Order Sway Load Place Set", ["Order", "Sway", "Load"]),
        ("Remarks Place Order Sway", ["Order", "Sway"]),
        ("UTC Spoiled Order Sway", ["Spoiled", "Order", "Sway"]),
    ],
)
def test_only_columns_of_numbers_are_asked_for(
    columns: str, asked: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "l.csv"
    names = columns.split()
    rows = [",".join(COLUMNS[n](k) for n in names) for k in range(N)]
    path.write_text("\n".join([",".join(names), *rows, ""]))
    with pytest.raises(UnclearColumnsError) as error:
        read_file(path)
    assert {n for f in (*error.value.inputs, *error.value.outputs) for n in f} == set(asked)
    if "Spoiled" not in asked:
        u, y = error.value.inputs[0], error.value.outputs[-1]
        assert len(read_file(path, ReadOptions(inputs=u, outputs=y)).records[0]) == N


CHAT = [f"2026-01-02 03:04:{k % 60:02},{k:03} - sent: M{k} S1" for k in range(N)]
STATES = [
    f"{k},pump {'on' if k % 7 else 'off'} again,{'calm' if k % 3 else 'loud'}" for k in range(N)
]


@pytest.mark.parametrize(
    "lines",
    [
        CHAT,
        [c.replace(" S1", ", echo" * (k % 4)) for k, c in enumerate(CHAT)],
        ["k,what,how", *STATES],
        [f"note {k}: all quiet, no wind" for k in range(N)],
    ],
)
def test_a_text_without_columns_of_numbers_is_no_table(lines: list[str], tmp_path: Path) -> None:
    path = tmp_path / "l.log"
    path.write_text("\n".join([*lines, ""]))
    with pytest.raises(DataError, match="is no table: its lines hold no columns of numbers"):
        read_file(path)
