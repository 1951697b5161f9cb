"""Pieces of C99 source: literals, tables, comments."""

from collections.abc import Iterable, Sequence

import numpy as np

from sysid.data.record import Array

WIDTH = 96
"""Longest line of a table."""


def number(value: float) -> str:
    """A double literal that reads back as the same double."""
    value = float(value)
    if np.isnan(value):
        return "NAN"
    if np.isinf(value):
        return "HUGE_VAL" if value > 0 else "-HUGE_VAL"
    return repr(value)


def factor(value: float) -> str:
    """The literal where something stands before it: negative ones in parentheses."""
    return f"({number(value)})" if np.signbit(value) else number(value)


def listed(values: Iterable[float]) -> str:
    """Literals divided by commas."""
    return ", ".join(number(v) for v in values)


def table(name: str, values: Array) -> list[str]:
    """A constant row of doubles."""
    return _row("double", name, [number(v) for v in values])


def integers(name: str, values: Sequence[int]) -> list[str]:
    """A constant row of integers."""
    return _row("int", name, [str(v) for v in values])


def _row(kind: str, name: str, cells: Sequence[str]) -> list[str]:
    return [f"static const {kind} {name}[{len(cells)}] = {{", *wrapped(cells), "};"]


def wrapped(cells: Sequence[str]) -> list[str]:
    """Cells divided by commas, in lines that are not too long."""
    lines, line = [], "   "
    for cell in cells:
        if len(line) + len(cell) + 2 > WIDTH:
            lines.append(line)
            line = "   "
        line += f" {cell},"
    return [*lines, line]


def comment(text: str) -> str:
    """Text that cannot end a comment or continue a line."""
    plain = "".join(c if c.isprintable() and c not in "\\?" else "_" for c in text)
    return plain.replace("*/", "*_").replace("/*", "_*")
