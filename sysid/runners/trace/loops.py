"""Loops of C over all entries of arrays, and how several of them become one."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod


@dataclass(frozen=True)
class Access:
    """How a loop reads one argument: ``array[offset + strides · indices]``.

    Attributes:
        array: its name; empty for a single value.
        offset, strides: where the entries stand.
        index: a table that says where in the array they stand instead, empty for none.
        text, reads: the value and its name, of a single value.
    """

    array: str = ""
    offset: int = 0
    strides: tuple[int, ...] = ()
    index: str = ""
    text: str = ""
    reads: str = ""

    def at(self, indices: Sequence[str]) -> str:
        """The entry for these loop variables."""
        if not self.array:
            return self.text
        place = _place(self.offset, self.strides, indices)
        return f"{self.array}[{self.index}[{place}]]" if self.index else f"{self.array}[{place}]"


@dataclass(frozen=True)
class Loop:
    """An operation on every entry, or one that takes the last axis together.

    Attributes:
        name: the array that it makes.
        shape: range of its loop variables.
        form: the operation as C, {0}, {1} … its arguments; of two values where ``start`` is given.
        truth: whether the values are truths.
        start: value before the first entry of the last axis, where that is taken together.
    """

    name: str
    shape: tuple[int, ...]
    form: str
    args: tuple[Access, ...]
    truth: bool = False
    start: str = ""

    @cached_property
    def reads(self) -> frozenset[str]:
        """Names of what must be computed before."""
        return frozenset(a.array or a.reads for a in self.args)

    def joins(self, group: "Sequence[Loop]") -> bool:
        """Whether it can be computed in one loop with these: entry by entry from their entries."""
        if self.shape != group[0].shape:
            return False
        made = {loop.name: loop for loop in group}
        steps = row_major(self.shape)
        return all(
            a.array not in made
            or not (made[a.array].start or a.index or a.offset or a.strides != steps)
            for a in self.args
        ) and not any(a.reads in made for a in self.args)


def loop_lines(group: Sequence[Loop], later: set[str]) -> list[str]:
    """Lines of one loop that computes a group; ``later`` are the names that are used after it."""
    shape = group[0].shape
    indices = [f"i{k}" for k in range(len(shape))]
    place = _place(0, row_major(shape), indices)
    outer = _place(0, row_major(shape[:-1]), indices[:-1])
    kept = {loop.name for loop in group if loop.name in later}
    local = {loop.name for loop in group if not loop.start} - kept
    declared, before, inner = [], [], []
    for loop in group:
        kind = "int" if loop.truth else "double"
        values = [(a.array if a.array in local else a.at(indices)) for a in loop.args]
        if loop.start:
            total = loop.name if len(shape) == 1 else f"{loop.name}[{outer}]"
            size = "" if len(shape) == 1 else f"[{prod(shape[:-1])}]"
            declared.append(f"double {loop.name}{size};")
            before.append(f"{total} = {loop.start};")
            inner.append(f"{total} = {loop.form.format(total, *values)};")
        elif loop.name in local:
            inner.append(f"const {kind} {loop.name} = {loop.form.format(*values)};")
        else:
            declared.append(f"{kind} {loop.name}[{prod(shape)}];")
            inner.append(f"{loop.name}[{place}] = {loop.form.format(*values)};")
    for k in reversed(range(len(shape))):
        head = f"for (int {indices[k]} = 0; {indices[k]} < {shape[k]}; {indices[k]}++) {{"
        nested = [head, *(f"    {line}" for line in inner), "}"]
        inner = [*before, *nested] if k == len(shape) - 1 else nested
    return [*declared, *inner]


def names_read(text: str) -> set[str]:
    """The names of values, arrays and tables in lines of C."""
    return set(re.findall(r"\b[a-z]\d+\b", text))


def row_major(shape: tuple[int, ...]) -> tuple[int, ...]:
    """How far apart neighbours along each axis stand; zero along axes of one entry."""
    return tuple(0 if n == 1 else prod(shape[k + 1 :]) for k, n in enumerate(shape))


def _place(offset: int, strides: Sequence[int], indices: Sequence[str]) -> str:
    terms = [str(offset)] if offset else []
    for s, i in zip(strides, indices, strict=True):
        if s:
            terms.append(i if s == 1 else f"{s} * {i}")
    return " + ".join(terms) or "0"
