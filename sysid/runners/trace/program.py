"""Lines of C in the order in which a computation recorded them: values, arrays, loops, tables.

An operation on few numbers is one line a number; one on many is a loop over an array, so that the
size of the code does not grow with that of a network. Loops over the same range that follow each
other become one, and what only they need is no array. What nothing uses is left out.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.runners.trace.loops import Access, Loop, loop_lines, names_read, row_major
from sysid.runners.trace.writing import factor, integers, number, table, wrapped

Cells = Any
"""A NumPy array of cells."""


class Cell:
    """A number, or a named value of a program.

    Attributes:
        text: as C.
        program: where it was recorded, None for a number.
        name: the value or array that must be computed before.
        place: the array and the index at which it stands there, if it does.
        usual: its value while all parameters are as exported, where it follows from these alone;
            None for numbers and for what depends on signals.
    """

    __slots__ = ("name", "number", "place", "program", "text", "usual")

    def __init__(
        self,
        text: str,
        value: float | None,
        program: "Program | None" = None,
        name: str = "",
        place: tuple[str, int] | None = None,
    ) -> None:
        self.text, self.number, self.program = text, value, program
        self.name, self.place = name, place
        self.usual: float | None = None


def as_number(c: Cell) -> str:
    """A cell as C where a number is wanted: truths become 0.0 or 1.0."""
    if c.number is not None:
        return number(c.number)
    return c.program.read(c.text, c.name, False) if c.program else c.text


def constant(value: float) -> Cell:
    """The cell of a number."""
    return Cell(factor(value), float(value))


@dataclass(frozen=True)
class _Lines:
    """What defines one name, and the names it reads."""

    name: str
    lines: tuple[str, ...]
    reads: frozenset[str]


@dataclass(frozen=True)
class Derived:
    """A value that follows from parameters alone: it need not be computed at every step.

    Attributes:
        name: of the value in the lines that compute it and in those that read it.
        usual: its value while the parameters are as exported.
        truth: whether it is a truth.
    """

    name: str
    usual: float
    truth: bool


class Program:
    """Statements in the order in which they were recorded; equal ones become one.

    What follows from parameters alone is kept apart from what a step computes.

    Args:
        numbers: that make names different from those of another program.
    """

    def __init__(self, numbers: Iterator[int] | None = None) -> None:
        self._scopes: list[list[_Lines | Loop]] = [[]]
        self._known: dict[str, str] = {}
        self._tables: dict[str, tuple[str, ...]] = {}
        self._truths: set[str] = set()
        self._numbers = count() if numbers is None else numbers
        self._derived: dict[str, tuple[_Lines, Derived]] = {}
        self._derived_texts: dict[str, str] = {}

    def read(self, text: str, name: str, condition: bool) -> str:
        """A value as C where a truth is wanted (``condition``), or a number."""
        if (name in self._truths) == condition:
            return text
        return f"({text} != 0.0)" if condition else f"(double){text}"

    # ----------------------------------------------------------------- single values

    def parameter(self, text: str, usual: float, place: tuple[str, int] | None = None) -> Cell:
        """A number that C reads where it is used, and that may be changed between steps."""
        cell = Cell(text, None, self, "", place)
        cell.usual = float(usual)
        return cell

    def derived(self, text: str, used: Sequence[Cell], truth: bool, usual: float) -> Cell:
        """The value of a C expression of parameters alone."""
        if text not in self._derived_texts:
            name = self._derived_texts[text] = self._name("t")
            kind = "int" if truth else "double"
            reads = frozenset(c.name for c in used if c.number is None)
            lines = _Lines(name, (f"const {kind} {name} = {text};",), reads)
            self._derived[name] = (lines, Derived(name, usual, truth))
            if truth:
                self._truths.add(name)
        name = self._derived_texts[text]
        cell = Cell(name, None, self, name)
        cell.usual = usual
        return cell

    def line(self, text: str, used: Sequence[Cell], truth: bool = False) -> Cell:
        """The value of a C expression that uses these cells."""
        if text not in self._known:
            name = self._name("t")
            kind = "int" if truth else "double"
            reads = frozenset(c.name for c in used if c.number is None)
            self._add(_Lines(name, (f"const {kind} {name} = {text};",), reads))
            self._known[text] = name
            if truth:
                self._truths.add(name)
        name = self._known[text]
        return Cell(name, None, self, name)

    def inputs(self, array: str, n: int) -> list[Cell]:
        """The first n entries of an array that exists already, as they are now."""
        cells = []
        for k in range(n):
            cell = self.line(f"{array}[{k}]", ())
            cell.place = (array, k)
            cells.append(cell)
        return cells

    # ----------------------------------------------------------------- arrays

    def looped(
        self,
        form: str,
        shape: tuple[int, ...],
        args: Sequence[Cells],
        truth: bool = False,
        conditions: Sequence[int] = (),
    ) -> Cells:
        """An operation on every entry of arrays of cells that broadcast to ``shape``.

        Args:
            form: as C, {0}, {1} … its arguments.
            conditions: which arguments are truths.
        """
        accesses = tuple(self._access(a, shape) for a in args)
        form = form.format(
            *(
                self.read(f"{{{k}}}", a.array or a.reads, k in conditions)
                for k, a in enumerate(accesses)
            )
        )
        key = f"{form}{shape}{truth}{accesses}"
        if key not in self._known:
            self._known[key] = self._name("a")
            self._add(Loop(self._known[key], shape, form, accesses, truth))
            if truth:
                self._truths.add(self._known[key])
        return self._entries(self._known[key], shape)

    def reduced(self, form: str, start: str, cells: Cells) -> Cells:
        """The last axis of an array of cells taken together by ``form`` of two values."""
        access = self._access(cells, cells.shape)
        form = form.format("{0}", self.read("{1}", access.array or access.reads, False))
        name = self._name("a")
        self._add(Loop(name, cells.shape, form, (access,), start=start))
        if cells.ndim == 1:
            return np.array(Cell(name, None, self, name), dtype=object)
        return self._entries(name, cells.shape[:-1])

    def looked_up(self, cells: Cells, at: Cell) -> Cell:
        """The entry of a row of cells whose index is the value of a cell."""
        access = self._access(cells, cells.shape)
        array = access.array or self._filled(cells)
        if access.index:
            raise ValueError("entries in no order cannot be looked up by a signal")
        place = f"{access.offset} + (int){at.text}" if access.offset else f"(int){at.text}"
        row = Cell("", None, self, array)
        return self.line(f"{array}[{place}]", (row, at))

    def repeated(self, times: int, start: Sequence[Cell]) -> "Rounds":
        """A loop whose body is recorded between ``entered`` and ``finished``."""
        return Rounds(self, times, start, self._name("s"))

    # ----------------------------------------------------------------- writing

    def lines(self, results: Iterable[Cell]) -> Iterator[str]:
        """The lines that these results need."""
        yield from self._needed(self._scopes[-1], {c.name for c in results if c.number is None})[0]

    def parted(self, results: Iterable[Cell]) -> tuple[list[str], list[Derived], list[str]]:
        """(lines of a step, what they read of derived values, lines that compute these)."""
        wanted = {c.name for c in results if c.number is None}
        lines, needed = self._needed(self._scopes[-1], wanted)
        read = [d for name, (_, d) in self._derived.items() if name in needed]
        scope = [line for line, _ in self._derived.values()]
        return lines, read, self._needed(scope, {d.name for d in read})[0]

    def support(self, text: str) -> Iterator[str]:
        """The tables that these lines read."""
        read = names_read(text)
        for name, lines in self._tables.items():
            if name in read:
                yield from (*lines, "")

    @staticmethod
    def _needed(scope: Sequence[_Lines | Loop], needed: set[str]) -> tuple[list[str], set[str]]:
        """(lines, names) that are needed of a scope; the names go beyond it."""
        needed, wanted = set(needed), set(needed)
        kept: list[_Lines | Loop] = []
        for statement in reversed(scope):
            if statement.name in needed:
                needed |= statement.reads
                kept.insert(0, statement)
        lines: list[str] = []
        at = 0
        while at < len(kept):
            first = kept[at]
            if isinstance(first, _Lines):
                lines += first.lines
                at += 1
                continue
            group = [first]
            while at + len(group) < len(kept):
                following = kept[at + len(group)]
                if not (isinstance(following, Loop) and following.joins(group)):
                    break
                group.append(following)
            at += len(group)
            later = wanted.union(*(s.reads for s in kept[at:]))
            lines += loop_lines(group, later)
        return lines, needed

    def _name(self, letter: str) -> str:
        return f"{letter}{next(self._numbers)}"

    def _add(self, statement: _Lines | Loop) -> None:
        self._scopes[-1].append(statement)

    def _entries(self, name: str, shape: tuple[int, ...]) -> Cells:
        entries = np.empty(int(np.prod(shape)), dtype=object)
        for k in range(entries.size):
            entries[k] = Cell(f"{name}[{k}]", None, self, name, (name, k))
        return entries.reshape(shape)

    # ----------------------------------------------------------------- how a loop reads an argument

    def _access(self, cells: Cells, shape: tuple[int, ...]) -> Access:
        """Where an argument's entries stand as a loop over ``shape`` goes through them."""
        aligned = np.reshape(cells, (1,) * (len(shape) - cells.ndim) + cells.shape)
        flat = aligned.ravel().tolist()
        first = flat[0]
        if all(c.text == first.text for c in flat):
            return Access(text=first.text, reads=first.name)
        strides = row_major(aligned.shape)
        if all(c.number is not None for c in flat):
            return Access(self._table(np.array([c.number for c in flat])), 0, strides)
        places = [c.place for c in flat]
        arrays = {p[0] if p else "" for p in places}
        if len(arrays) != 1 or "" in arrays:
            return Access(self._filled(aligned), 0, strides)
        (array,) = arrays
        at = np.array([p[1] for p in places if p]).reshape(aligned.shape)
        along = tuple(
            int(np.take(at, 1, k).flat[0] - at.flat[0]) if n > 1 else 0
            for k, n in enumerate(aligned.shape)
        )
        offset = int(at.flat[0])
        affine = offset + sum(s * g for s, g in zip(along, np.indices(aligned.shape), strict=True))
        if np.array_equal(affine, at):
            return Access(array, offset, along)
        numbers = "\n".join(integers("{}", at.ravel().tolist()))
        return Access(array, 0, strides, index=self._stored(numbers, "g"))

    def _table(self, values: Array) -> str:
        return self._stored("\n".join(table("{}", values)), "c")

    def _stored(self, text: str, letter: str) -> str:
        if text not in self._known:
            name = self._known[text] = self._name(letter)
            self._tables[name] = tuple(text.replace("{}", name, 1).split("\n"))
        return self._known[text]

    def _filled(self, cells: Cells) -> str:
        """An array with these cells in it."""
        flat = cells.ravel().tolist()
        if all(c.number is not None for c in flat):
            return self._table(np.array([c.number for c in flat]))
        texts = [as_number(c) for c in flat]
        key = f"{{{', '.join(texts)}}}"
        if key not in self._known:
            name = self._known[key] = self._name("a")
            lines = (f"const double {name}[{len(flat)}] = {{", *wrapped(texts), "};")
            reads = frozenset(c.name for c in flat if c.number is None)
            self._add(_Lines(name, lines, reads))
        return self._known[key]


class Rounds:
    """A loop over an array of states, its body being recorded."""

    def __init__(self, program: Program, times: int, start: Sequence[Cell], name: str) -> None:
        self.program, self.times, self.start, self.name = program, times, start, name

    def entered(self) -> list[Cell]:
        """The states as the body finds them."""
        self._outer = dict(self.program._known)
        self.program._scopes.append([])
        return self.program.inputs(self.name, len(self.start))

    def final_states(self, after: Sequence[Cell]) -> list[Cell]:
        """The states after the last round, from those after one."""
        program, name = self.program, self.name
        body, reads = program._needed(
            program._scopes.pop(), {c.name for c in after if c.number is None}
        )
        program._known = self._outer
        texts = [as_number(c) for c in self.start]
        lines = [
            f"double {name}[{len(texts)}] = {{",
            *wrapped(texts),
            "};",
            f"for (int round = 0; round < {self.times}; round++) {{",
            *(f"    {line}" for line in [*body, *assigned(name, after)]),
            "}",
        ]
        reads |= {c.name for c in self.start if c.number is None}
        program._add(_Lines(name, tuple(lines), frozenset(reads - {name})))
        entries: list[Cell] = program._entries(name, (len(texts),)).tolist()
        return entries


def assigned(name: str, values: Sequence[Cell], operator: str = "=") -> list[str]:
    """Lines that put cells into ``name[0]`` and on."""
    return [f"{name}[{k}] {operator} {as_number(c)};" for k, c in enumerate(values)]
