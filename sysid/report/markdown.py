"""Markdown of the reports: a table (the same rows give the same bytes), and the last line."""

import unicodedata
from collections.abc import Sequence
from datetime import date

from sysid.version import __version__

_RULES = {"l": (":", "-"), "r": ("-", ":"), "c": (":", ":")}


def table(headers: Sequence[str], rows: Sequence[Sequence[str]], align: str = "") -> str:
    """Return a GitHub-flavoured table whose columns also line up in the source.

    Args:
        rows: cells as text, n per row; numbers are formatted by the caller, so that a table
            never changes because a float printed differently.
        align: n letters of ``l``, ``r``, ``c``; empty means left for all.

    Returns:
        The table, ending in a newline. ``|`` is escaped and line breaks become spaces.

    Raises:
        ValueError: ``align`` or a row does not have one entry per header.
    """
    n = len(headers)
    align = align or "l" * n
    if n == 0 or len(align) != n or set(align) - set(_RULES):
        raise ValueError(f"align must be {n} letters of l, r, c (one per header), got {align!r}")
    lines = [[_cell(text) for text in headers]]
    for number, row in enumerate(rows, start=1):
        if len(row) != n:
            raise ValueError(f"row {number} has {len(row)} cells, the header has {n}")
        lines.append([_cell(text) for text in row])
    widths = [max(3, *(_width(line[j]) for line in lines)) for j in range(n)]
    rule = [
        left + "-" * (width - 2) + right
        for width, (left, right) in zip(widths, (_RULES[a] for a in align), strict=True)
    ]
    body = [
        [_pad(cell, width, a) for cell, width, a in zip(line, widths, align, strict=True)]
        for line in lines
    ]
    return "".join(f"| {' | '.join(line)} |\n" for line in (body[0], rule, *body[1:]))


def foot(command: str, seeds: str = "none") -> str:
    """The last line of a report: version of the tool, date, command, seeds of what was drawn."""
    return f"\n---\nsysid {__version__}, {date.today()}: `{command}`; seeds: {seeds}.\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _width(text: str) -> int:
    """Columns a terminal or editor gives the text: accents take none, wide letters two."""
    return sum(
        0 if unicodedata.combining(c) else 1 + (unicodedata.east_asian_width(c) in "WF")
        for c in text
    )


def _pad(text: str, width: int, align: str) -> str:
    room = width - _width(text)
    left = {"l": 0, "r": room, "c": room // 2}[align]
    return " " * left + text + " " * (room - left)
