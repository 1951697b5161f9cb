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
    """A constant array of doubles of the values' shape, one or two axes."""
    shape = "".join(f"[{n}]" for n in values.shape)
    if values.ndim == 1:
        cells = [number(v) for v in values]
    else:
        cells = [f"{{{listed(row)}}}" for row in values]
    return [f"static const double {name}{shape} = {{", *_filled(cells), "};"]


def integers(name: str, rows: Sequence[Sequence[int]]) -> list[str]:
    """A constant matrix of integers."""
    cells = [f"{{{', '.join(map(str, row))}}}" for row in rows]
    return [f"static const int {name}[{len(rows)}][{len(rows[0])}] = {{", *_filled(cells), "};"]


def _filled(cells: Sequence[str]) -> list[str]:
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


def shifted(first: int, last: int) -> list[str]:
    """Lines that move x[first … last − 1] one place up, the newest place left as it is."""
    if last - first < 2:
        return []
    return [f"    for (k = {last - 1}; k > {first}; k--)", "        x[k] = x[k - 1];"]
