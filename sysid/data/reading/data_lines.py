"""Data lines of a text log: the first lines as text, a long tail of plain numbers as bytes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import overload

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array

HEAD = 400
"""Lines that are looked at one by one: what is odd shows in these, or in other signs behind."""

NUMERALS = b"0123456789+-.eE"
SEPARATORS = (b",", b";", b"\t")
_DIGIT, _POINT, _SIGN, _EXPONENT, _END = range(5)
_FOLLOWS = np.array(
    [
        [1, 1, 0, 1, 1],
        [1, 0, 0, 1, 1],
        [1, 1, 0, 0, 0],
        [1, 0, 1, 0, 0],
        [1, 1, 1, 0, 1],
    ],
    dtype=bool,
)
"""Whether in a line of numbers a character of the column's kind may follow one of the row's."""

NUMPY_ROWS = 100_000
"""Rows up to which NumPy reads a log sooner than pandas is imported (0.3 s)."""


@dataclass(frozen=True, eq=False)
class Tail:
    """Lines of nothing but numbers, each with as many cells.

    Attributes:
        data: the lines, ended by a newline each.
        separator: between cells.
        cells: of each line.
        first: line number of the first one in the file, counted from 1.
    """

    data: bytes
    separator: str
    cells: int
    first: int
    count: int

    @property
    def numbers(self) -> range:
        return range(self.first, self.first + self.count)


def cut_tail(data: bytes) -> tuple[bytes, Tail] | None:
    """The first ``HEAD`` lines and the tail behind them; None where the tail is not plain."""
    data = data.replace(b"\r\n", b"\n")
    at = 0
    for _ in range(HEAD):
        at = data.find(b"\n", at) + 1
        if at == 0:
            return None
    tail = data[at:] if data.endswith(b"\n") else data[at:] + b"\n"
    others = set(tail.translate(None, NUMERALS + b"\n" + b"".join(SEPARATORS)))
    used = [s for s in SEPARATORS if s in tail]
    if others or len(used) != 1 or len(tail) < 2:
        return None
    signs = np.frombuffer(tail, dtype=np.uint8)
    ends = signs[(signs == used[0][0]) | (signs == ord("\n"))] == ord("\n")
    cells = int(np.argmax(ends)) + 1
    if len(ends) % cells or not are_numbers(signs):
        return None
    of_line = ends.reshape(-1, cells)  # a newline stands behind the last cell and nowhere else
    if not of_line[:, -1].all() or of_line[:, :-1].any():
        return None
    return data[:at], Tail(tail, used[0].decode(), cells, HEAD + 1, len(ends) // cells)


def are_numbers(signs: NDArray[np.uint8]) -> bool:
    """Whether each cell of such lines is a number or empty, not ``1e``, ``3-4`` or ``1.2.3``."""
    kind = np.full(256, _END, dtype=np.uint8)
    for characters, which in (
        (b"0123456789", _DIGIT),
        (b".", _POINT),
        (b"+-", _SIGN),
        (b"eE", _EXPONENT),
    ):
        kind[list(characters)] = which
    kinds = kind[signs]
    pairs = np.bincount(5 * kinds[:-1] + kinds[1:], minlength=25).reshape(5, 5)
    if np.any(pairs[~_FOLLOWS]) or not _FOLLOWS[_END, kinds[0]]:
        return False
    cell = np.cumsum(kinds == _END, dtype=np.int32)
    return all(np.all(np.diff(cell[kinds == once])) for once in (_POINT, _EXPONENT))


@dataclass(frozen=True, eq=False)
class DataLines(Sequence[str]):
    """All data lines; those of the tail become text when one of them is asked for.

    Attributes:
        head: the first lines.
        tail: the others, None where the head holds all.
    """

    head: Sequence[str]
    tail: Tail | None = None

    def __len__(self) -> int:
        return len(self.head) + (self.tail.count if self.tail else 0)

    @cached_property
    def _all(self) -> Sequence[str]:
        if self.tail is None:
            return self.head
        return [*self.head, *self.tail.data.decode("ascii").splitlines()]

    @overload
    def __getitem__(self, at: int) -> str: ...
    @overload
    def __getitem__(self, at: slice) -> Sequence[str]: ...
    def __getitem__(self, at: int | slice) -> str | Sequence[str]:
        inside = isinstance(at, int) and 0 <= at < len(self.head)
        return self.head[at] if inside else self._all[at]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all)

    @property
    def text(self) -> bytes:
        """The lines as one text, in UTF-8."""
        head = "\n".join(self.head).encode()
        return head if self.tail is None else head + b"\n" + self.tail.data

    def has(self, sign: str) -> bool:
        """Whether a sign that no plain number has stands in some line."""
        return any(sign in line for line in self.head)

    def numbers(self, separator: str, columns: Sequence[int]) -> Array | None:
        if len(self) > NUMPY_ROWS:
            return None
        sep = None if separator == " " else separator
        try:
            return np.loadtxt(
                self._all, delimiter=sep, usecols=list(columns), ndmin=2, comments=None
            )
        except ValueError:
            return None
