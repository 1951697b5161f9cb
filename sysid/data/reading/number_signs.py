"""Decimal sign and thousands separator of a text log, decided over all of its cells."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

from sysid.data.reading.dates import date_format
from sysid.data.reading.header import cells_of

DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_GROUPED = {
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d+)?"),
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+(,\d+)?"),
    "'": re.compile(r"[+-]?[1-9]\d{0,2}(['\u2019\u00a0\u202f]\d{3})+([.,]\d+)?"),
}
_BELOW = re.compile(r"[+-]?[1-9]\d\d")
SPREAD = 2000
"""Rows that are asked whether it is, over the whole log."""

MIN_VALUES = 5
"""Different numbers beyond and below a thousand that show a column to be of whole numbers."""

_SPACES = "'\u2019\u00a0\u202f"
SHOWN = 200
"""Rows looked at, and as many further ones that hold a comma: a log that starts at rest may have no
fraction in its first rows."""


@dataclass(frozen=True)
class NumberSigns:
    """How numbers are written.

    Attributes:
        decimal: ``.`` or ``,``.
        group: the thousands separator, empty without.
        example: a number with such a separator, or one that could be read either way.
        doubtful: whether every comma could also be a thousands separator.
    """

    decimal: str
    group: str = ""
    example: str = ""
    doubtful: bool = False

    def note(self) -> tuple[str, ...]:
        """What a person should know, as part of a sentence."""
        if self.group:
            plain = re.sub(f"[{_SPACES}{re.escape(self.group)}]", "", self.example)
            plain = plain.replace(",", ".")
            return (f"{self.example} was read as {plain}: its separators are of thousands",)
        if self.doubtful:
            return (
                f"{self.example} was read with a decimal comma; if it separates thousands, give "
                "`decimal='.'`",
            )
        return ()


def number_signs(rows: Sequence[str], sep: str, given: str | None) -> NumberSigns:
    """Decimal sign and thousands separator; ``given`` is the decimal sign by option.

    A comma is the decimal sign where a cell reads ``1,5`` and none ``1.5``. It separates thousands
    where all commas stand before three digits and a point is seen beside them, two in a number, or
    a column of whole numbers goes on from them below a thousand.
    """
    shown = list(rows[:SHOWN]) + [r for r in rows[SHOWN:] if "," in r][:SHOWN]
    cells = [c for row in _cells(shown, sep) for c in row]
    commas = [c for c in cells if "," in c and c[-1:].isdigit() and not date_format(c)]
    points = [c for c in cells if "." in c and not date_format(c)]
    spaced = [c for c in cells if _GROUPED["'"].fullmatch(c)]
    grouped_commas = [c for c in commas if _GROUPED[","].fullmatch(c)]
    grouped_points = [c for c in points if _GROUPED["."].fullmatch(c)]
    decimal, doubtful = given, False
    if decimal is None and not commas:
        decimal = "."
    elif decimal is None and len(grouped_commas) == len(commas):
        certain = any(c.count(",") > 1 or "." in c for c in commas) or _goes_on_below(rows, sep)
        decimal = "." if certain or points else ","
        doubtful = decimal == ","
    elif decimal is None:
        comma = any(DECIMAL_COMMA.fullmatch(c) or c in grouped_points for c in commas)
        decimal = "," if comma and len(grouped_points) == len(points) else "."
    group, of_group = (",", grouped_commas) if decimal == "." else (".", grouped_points)
    if of_group and len(of_group) == len(commas if group == "," else points):
        return NumberSigns(decimal, group, of_group[0])
    if spaced:
        return NumberSigns(decimal, "'", spaced[0])
    return NumberSigns(decimal, "", commas[0] if doubtful else "", doubtful)


def _goes_on_below(rows: Sequence[str], sep: str) -> bool:
    """Whether a column holds ``1,591`` and ``955``: no writer of decimals drops three of them."""
    for column in zip_longest(*_cells(rows[:: 1 + len(rows) // SPREAD], sep), fillvalue=""):
        beyond = {c for c in column if "," in c}
        below = {c for c in column if _BELOW.fullmatch(c)}
        if min(len(beyond), len(below)) >= MIN_VALUES:
            return all(_GROUPED[","].fullmatch(c) for c in beyond)
    return False


def _cells(rows: Sequence[str], sep: str) -> list[list[str]]:
    return [[c.strip().strip('"') for c in cells_of(row, sep)] for row in rows]


def without_groups(rows: Sequence[str], sep: str, group: str) -> list[str]:
    """The rows without thousands separators."""
    signs = _SPACES if group == "'" else group
    pattern = _GROUPED[group]
    table = str.maketrans("", "", signs)
    out = []
    for row in rows:
        if any(sign in row for sign in signs):
            cells = [c.strip() for c in cells_of(row, sep)]
            bare = [c.translate(table) if pattern.fullmatch(c) else c for c in cells]
            row = sep.join(f'"{c}"' if sep in c else c for c in bare)
        out.append(row)
    return out
