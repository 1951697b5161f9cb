"""Pieces of C99 source: literals, tables, comments, and what a structure contributes to plant.c."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array

WIDTH = 96
"""Longest line of a table."""


@dataclass(frozen=True)
class CBody:
    """What a structure contributes to ``plant.c``.

    The body finds the inputs as deviations from the operating point in ``v[]``, the states in
    ``x[]`` (zero at rest), and adds the core's outputs to ``out[]``.

    Attributes:
        n_states: how many states.
        words: lines of the comment at the head of the file: how the code works.
        body: lines of ``plant_step`` between reading the inputs and writing the outputs.
        support: constant tables and functions that the body needs.
        mathematical: whether ``math.h`` is needed.
    """

    n_states: int
    words: tuple[str, ...]
    body: tuple[str, ...]
    support: tuple[str, ...] = ()
    mathematical: bool = False


def number(value: float) -> str:
    """A double literal that reads back as the same double."""
    value = float(value)
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


def minus(offset: float) -> str:
    """What takes an offset off; nothing for zero."""
    return f" - ({number(offset)})" if offset else ""
