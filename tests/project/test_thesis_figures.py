"""The thesis figure by figure: nothing is left out, and the committed page says what we compute."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from studies.runner import REPORTS
from thesis import report

PAGE = REPORTS / "thesis.md"
PICTURES = REPORTS / "thesis"

MOST_BYTES = 1_500_000
"""All pictures together: a clone of the project should stay small."""


@pytest.fixture(scope="module")
def lines() -> list[tuple[str, ...]]:
    """The cells of every line of a table of the committed page."""
    text = PAGE.read_text(encoding="utf-8")
    rows = (re.split(r"(?<!\\)\|", row)[1:-1] for row in text.splitlines() if row.startswith("|"))
    return [tuple(cell.strip() for cell in row) for row in rows]


def test_every_figure_and_table_stands_in_the_inventory_once() -> None:
    last = {1: 11, 2: 12, 3: 5, 4: 4, 5: 27, 6: 30, 7: 6, 8: 30}  # figures of each chapter
    wanted = [f"{c}.{k}" for c, n in last.items() for k in range(1, n + 1)]
    numbers = [item.number for item in report.ITEMS]
    tables = [n for n in numbers if n.startswith("Table")]
    assert len(tables) == len(set(tables)) == 7  # two have numbers of their own, five have none
    assert {"Table 5.1", "Table 5.2"} < set(tables)
    assert sorted(numbers) == sorted([*wanted, *tables])
    for item in report.ITEMS:
        assert item.title
        assert item.missing or item.kind is not report.Kind.MISSING, item.number


def test_the_page_has_a_line_for_every_item(lines: list[tuple[str, ...]]) -> None:
    computed = {cells[0] for cells in lines if len(cells) == 6}
    left_out = [cells[0] for cells in lines if len(cells) == 4]
    for item in report.ITEMS:
        if item.kind is report.Kind.COMPUTED:
            assert item.number in computed
            assert item.number not in left_out
        else:
            assert left_out.count(item.number) == 1


def test_every_difference_has_a_reason(lines: list[tuple[str, ...]]) -> None:
    rows = [cells for cells in lines if len(cells) == 6 and cells[0][:1] not in ("f", ":")]
    assert len(rows) > 100
    for figure, what, published, ours, difference, why in rows:
        assert all((figure, what, published, ours, difference)), (figure, what)
        assert why or difference == "none", (figure, what)


def test_pictures_are_those_of_the_page_and_small() -> None:
    linked = set(re.findall(r"\]\(thesis/([^)]+)\)", PAGE.read_text(encoding="utf-8")))
    files = {p.relative_to(PICTURES).as_posix(): p for p in PICTURES.rglob("*.*")}
    assert set(files) == linked
    assert sum(p.stat().st_size for p in files.values()) < MOST_BYTES


def test_cheap_rows_are_those_of_the_committed_page(lines: list[tuple[str, ...]]) -> None:
    cheap = (
        *report.SHEETS[2],
        report.bench_motor.constants,
        report.bench_motor.loads,
        report.bench_motor.simulation,
        report.pendulum.swing,
        report.chapter6.forces,
        report.chapter6.references,
        report.chapter6.settings,
        report.chapter7.body,
    )
    for sheet in cheap:
        for row in sheet().rows:
            cells = (row.figure, row.what, row.published, row.ours, row.difference, row.why)
            assert cells in lines


def test_published_numbers_come_back_to_their_digits() -> None:
    found = {
        row.what: row
        for sheet in (
            report.bench_motor.constants,
            report.pendulum.swing,
            report.chapter6.references,
        )
        for row in sheet().rows
    }
    assert found["K_em [V/(rad/s)]"].difference == "none"
    assert found["J of (5.7) [kg m²]"].ours == "0.0652"
    assert found["K_c [Nm/A], stall torque over V/R − i₀"].ours == "8.6479e−04"
    assert found["V_d over its maximum at 0.2 m with K_g = 0.4 [%]"].ours == "50.0"


def test_differences_are_relative_and_none_where_the_digits_agree() -> None:
    compared = report.chapter2.compared
    assert compared("1.1", "", 2.0, 2.004, ".2f").difference == "none"
    assert compared("1.1", "", 2.0, 1.5, ".2f").difference == "−25 %"
    assert compared("1.1", "", 0.0, 1.5, ".2f").difference == "1.50"


def test_thinned_lines_keep_their_steps_and_ends() -> None:
    x = np.arange(1000.0)
    step = report.chapter2.line("step", x, (x >= 500) * 1.0)
    np.testing.assert_array_equal(step.x, [0, 499, 500, 999])
    curve = report.chapter2.line("curve", x, np.sin(x))
    assert len(curve.x) < 200
    assert curve.x[-1] == 999


def test_small_pictures_show_what_the_large_ones_show(tmp_path: Path) -> None:
    sheet = report.chapter6.forces()
    large, small = tmp_path / "large.svg", tmp_path / "small.svg"
    report.write_picture(large, sheet.picture)
    report.write_picture(small, sheet.picture)
    report.made_small(small)
    assert small.stat().st_size < 0.75 * large.stat().st_size
    for tag in ("path", "use", "clipPath"):
        name = "{http://www.w3.org/2000/svg}" + tag
        counts = [len(list(ElementTree.parse(f).iter(name))) for f in (large, small)]
        assert counts[0] == counts[1] > 0
    text = small.read_text(encoding="utf-8")
    for name in re.findall(r'url\(#([^)]+)\)|href="#([^"]+)"', text):
        assert f'id="{name[0] or name[1]}"' in text
