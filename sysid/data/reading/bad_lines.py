"""Lines of a text log that are no rows of its table: half lines, messages, footers with means."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from sysid.data.finding import Finding, Severity
from sysid.data.reading.dates import date_format
from sysid.data.reading.header import MISSING, STATES, cells_of

MOST = 0.1
"""Share of lines up to which they are left out; with more of them the table was misread."""
QUOTED = 3
"""Lines that are quoted."""
SAMPLED = 1000
"""Rows looked at to see whether a column is filled."""

_GROUP = "[.,'\u2019\u00a0\u202f]"
_NUMBER = re.compile(
    rf"\"? *[+-]?(\d+([.,]\d*)?|[.,]\d+|[1-9]\d{{0,2}}({_GROUP}\d{{3}})+([.,]\d+)?)"
    r"([eE][+-]?\d+)? *\"?|[+-]?inf",
)
_DATE = r'"?\d[\d:./\- TZ+]*"?'
"""The signs of a date as loggers write it."""


@dataclass(frozen=True)
class Skipped:
    """Lines left out: their numbers and texts."""

    lines: tuple[tuple[int, str], ...] = ()

    def __add__(self, other: "Skipped") -> "Skipped":
        return Skipped(tuple(sorted((*self.lines, *other.lines))))

    def finding(self, where: str) -> tuple[Finding, ...]:
        """How many lines were left out, and the first of them; nothing where none was."""
        n = len(self.lines)
        if not n:
            return ()
        quoted = ", ".join(f"line {i} {_short(text)}" for i, text in self.lines[:QUOTED])
        more = f" and {n - QUOTED} more" if n > QUOTED else ""
        text = (
            f"{where}: {n} line{' that is no row was' if n == 1 else 's that are no rows were'} "
            f"left out: {quoted}{more}."
        )
        advice = "`strict=True` refuses such a log."
        return (Finding("bad-lines", Severity.WARNING, text, advice, record=where),)


NONE_SKIPPED = Skipped()


def few(bad: int, rows: int) -> bool:
    """Whether so few lines are no rows that the others are a table."""
    return 0 < bad <= MOST * rows


def ragged(counts: Sequence[int], allowed: set[int]) -> list[int]:
    """The rows with another number of cells than others have, where they are few."""
    frequent = allowed | {cells for cells, n in Counter(counts).items() if n > MOST * len(counts)}
    rows = [k for k, cells in enumerate(counts) if cells not in frequent]
    return rows if few(len(rows), len(counts)) else []


def without_words(rows: Sequence[str], sep: str) -> tuple[dict[int, str], dict[int, int]]:
    """Rows with a word in a column of numbers or dates, where such words are few.

    A word makes a cell empty, and no row bad: that depends on the columns that are used.

    Returns:
        row number → the row with empty cells for its words; column → its first row with a word.
    """
    usual, texts = _usual_row(rows, sep)
    odd = [k for k, row in enumerate(rows) if not usual.fullmatch(row)]
    cells = {k: [c.strip() for c in cells_of(rows[k], sep)] for k in odd}
    words = [(i, k) for k in odd for i, c in enumerate(cells[k]) if i not in texts and _is_word(c)]
    per_column = Counter(i for i, _ in words)
    numbers = {i for i, n in per_column.items() if few(n, _filled(rows, i, sep))}
    first: dict[int, int] = {}
    without = {}
    for i, k in ((i, k) for i, k in words if i in numbers):
        first.setdefault(i, k)
        cells[k][i] = "nan"
        without[k] = sep.join(f'"{c}"' if sep in c else c for c in cells[k])
    return without, first


def _usual_row(rows: Sequence[str], sep: str) -> tuple[re.Pattern[str], set[int]]:
    """What a row without anything odd looks like, and which columns hold text in many rows.

    A number has one decimal sign, and that is no delimiter, so that a row is matched in one way.
    """
    point = "[.,]" if sep != "," else "[.]"
    number = rf'"?[+-]?\d*(?:{point}\d*)?(?:(?<=\d)[eE][+-]?\d+)?"?'
    between, text = (r"\s+", r"\S*") if sep == " " else (rf" *{re.escape(sep)} *", None)
    text = text or rf'(?:"[^"]*"|[^"{re.escape(sep)}]*)'
    shown = [[c.strip() for c in cells_of(row, sep)] for row in _some(rows)]
    least = MOST * len(shown)
    kinds = []
    for column in zip(*shown, strict=True):
        dates = sum(date_format(c) is not None for c in column)
        words = sum(map(_is_word, column))
        kinds.append(text if words > least else _DATE if dates > least else number)
    texts = {i for i, kind in enumerate(kinds) if kind == text}
    return re.compile(rf" *{between.join(kinds)}\s*"), texts


def _some(rows: Sequence[str]) -> Sequence[str]:
    """Rows from all of a log."""
    return rows[:: max(len(rows) // SAMPLED, 1)]


def _filled(rows: Sequence[str], column: int, sep: str) -> int:
    """About how many cells of a column hold something."""
    some = _some(rows)
    cells = [cells_of(row, sep)[column].strip().lower() for row in some]
    return sum(c not in MISSING for c in cells) * len(rows) // len(some)


def _is_word(cell: str) -> bool:
    """Whether a cell is neither a number nor a date, a switch's word or a sign for no number."""
    lower = cell.lower()
    return not (lower in MISSING or lower in STATES or _NUMBER.fullmatch(cell) or date_format(cell))


def _short(text: str, most: int = 40) -> str:
    return repr(text if len(text) <= most else text[: most - 1] + "…")
