"""Tables of the committed reports: aligned, escaped, refused when ragged."""

import pytest

from sysid.report.markdown import table


def test_columns_line_up_in_the_source() -> None:
    assert table(["model", "fit %", "ok"], [["oe-1", "97.1", "✓"], ["ω", "8.0", "no"]], "lrc") == (
        "| model | fit % | ok  |\n"
        "| :---- | ----: | :-: |\n"
        "| oe-1  |  97.1 |  ✓  |\n"
        "| ω     |   8.0 | no  |\n"
    )


def test_left_is_the_default_and_no_row_is_fine() -> None:
    assert table(["a", "b"], []) == "| a   | b   |\n| :-- | :-- |\n"


def test_bars_and_line_breaks_cannot_break_a_row() -> None:
    text = table(["x"], [["a|b\nc  d"]])
    assert text.splitlines()[2] == "| a\\|b c d |"


def test_wide_and_combining_letters_are_measured_as_shown() -> None:
    lines = table(["name"], [["速度"], ["e\u0301"]]).splitlines()
    assert lines[2] == "| 速度 |"
    assert lines[3] == "| e\u0301    |"


@pytest.mark.parametrize(
    ("headers", "rows", "align", "message"),
    [
        ([], [], "", "one per header"),
        (["a"], [], "ll", "one per header"),
        (["a"], [], "x", "one per header"),
        (["a", "b"], [["1", "2"], ["1"]], "lr", "row 2 has 1 cells"),
    ],
)
def test_ragged_tables_are_refused(
    headers: list[str], rows: list[list[str]], align: str, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        table(headers, rows, align)
