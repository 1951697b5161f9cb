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
SIGN = 3
"""A word that stands so often in a column of numbers is the logger's sign for a missing number."""

_PLAIN = re.compile(r"[\d+\-.,;\teE \"]*")
_BROKEN = re.compile(r"[eE+\-](?![+\-\d.])|[\d.][+-]|[+-]{2}|\.\d*\.|(?<![\d.])[eE]")
"""What no plain number has, as in ``1e``, ``3-4``, ``1.2.3``; a date may have it."""
_NUMBER = re.compile(
    r"\s*\"?\s*[+-]?(\d[\d.,'\u2019\u00a0\u202f]*|[.,]\d+)([eE][+-]?\d+)?\s*\"?\s*|[+-]?inf"
)


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


def unreadable(rows: Sequence[str], sep: str) -> tuple[list[int], dict[int, str]]:
    """Rows with a word in a column of numbers, where they are few.

    Returns:
        the rows; and rows in which such a word is the logger's sign for a missing number, as they
        read without it.
    """
    odd = [k for k, row in enumerate(rows) if not _PLAIN.fullmatch(row) or _BROKEN.search(row)]
    if not odd:
        return [], {}
    cells = {k: [c.strip() for c in cells_of(rows[k], sep)] for k in odd}
    words = {k: [i for i, c in enumerate(row) if _is_word(c)] for k, row in cells.items()}
    per_column = Counter(i for of_row in words.values() for i in of_row)
    numbers = {i for i, n in per_column.items() if few(n, _filled(rows, i, sep))}
    signs = Counter((i, cells[k][i]) for k in odd for i in words[k] if i in numbers)
    bad, without = [], {}
    for k in odd:
        wrong = [i for i in words[k] if i in numbers]
        if any(signs[i, cells[k][i]] < SIGN for i in wrong):
            bad.append(k)
        elif wrong:
            row = ["nan" if i in wrong else c for i, c in enumerate(cells[k])]
            without[k] = sep.join(f'"{c}"' if sep in c else c for c in row)
    return bad, without


def _filled(rows: Sequence[str], column: int, sep: str) -> int:
    """About how many cells of a column hold something."""
    every = max(len(rows) // SAMPLED, 1)
    cells = [cells_of(row, sep)[column].strip().lower() for row in rows[::every]]
    return every * sum(c not in MISSING for c in cells)


def _is_word(cell: str) -> bool:
    """Whether a cell is neither a number nor a date, a switch's word or a sign for no number."""
    lower = cell.lower()
    return not (lower in MISSING or lower in STATES or _NUMBER.fullmatch(cell) or date_format(cell))


def _short(text: str, most: int = 40) -> str:
    return repr(text if len(text) <= most else text[: most - 1] + "…")
