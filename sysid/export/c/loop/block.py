"""One law as C: its numbers become parameters, its memory a struct, its step one function."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np

from sysid.errors import ModelError
from sysid.export.c.fields import Field
from sysid.export.c.loop.trees import Path, identifier, leaves, mapped, size
from sysid.export.c.step import UNWRITABLE
from sysid.runners.trace.program import Cell, Program, as_number
from sysid.runners.trace.traced import TRACE, Traced, cells_of


@dataclass(frozen=True)
class Block:
    """One step function with what belongs to it.

    Attributes:
        name: prefix of its types and functions.
        title: what it does.
        parameters, states, inputs, outputs: members of its structs.
        start, step: lines of its functions.
        support: tables that they read.
        fixed: parameters that are constants, because the law decides by them while it is written.
    """

    name: str
    title: str
    parameters: tuple[Field, ...]
    states: tuple[Field, ...]
    inputs: tuple[Field, ...]
    outputs: tuple[Field, ...]
    start: tuple[str, ...]
    step: tuple[str, ...]
    support: tuple[str, ...]
    fixed: tuple[str, ...] = ()


_READ = re.compile(r"\bstate->(\w+)")
_PARAMETER = re.compile(r"\bparameters->(\w+)")

Start = Callable[[Mapping[Path, Any]], Any]
"""Parameters → the state."""
Step = Callable[[Mapping[Path, Any], Any, Any], tuple[Any, Any]]
"""Parameters, state, inputs → the state after, outputs."""


@dataclass(frozen=True)
class Law:
    """What is to be recorded.

    Attributes:
        parameters: their values by place; those that nothing reads are left out.
        inputs: a tree of numbers or arrays like those the law will be given.
        start, step: the law, over :data:`TRACE`.
        units: unit and words of a member by its place.
    """

    name: str
    title: str
    parameters: Mapping[Path, float]
    inputs: Any
    start: Start
    step: Step
    units: Callable[[Path], tuple[str, str]]


def recorded(law: Law) -> Block:
    """A law as C.

    A law may decide by a number while it is written, in Python; that number stays as it is, and
    stands in ``fixed``.
    """
    free = dict(law.parameters)
    fixed: list[str] = []
    try:
        return _recorded(law, free, ())
    except UNWRITABLE:
        pass
    for place in law.parameters:
        try:
            _recorded(law, {place: free[place]}, ())
        except UNWRITABLE:
            fixed.append(identifier(place))
            del free[place]
    try:
        return _recorded(law, free, tuple(fixed))
    except UNWRITABLE as error:
        raise ModelError(
            f"the {law.name} of this mission cannot be written as C: {error.__cause__ or error}"
        ) from None


Leaves = list[tuple[Path, Any]]


@dataclass(frozen=True, eq=False)
class _Recording:
    """A law being recorded.

    Attributes:
        free: parameters that C may change.
    """

    law: Law
    free: Mapping[Path, float]

    def parameters(self, program: Program) -> dict[Path, Any]:
        """All parameters, the free ones as values of a program."""
        fixed = {p: v for p, v in self.law.parameters.items() if p not in self.free}
        return fixed | {p: _value(program, "parameters", p, 0.0) for p in self.free}

    def stepped(self, program: Program, first: Any, fixed: set[Path]) -> tuple[Any, Any, Any]:
        """(state before, state after, outputs) of a step where some of the state is fixed."""

        def remembered(p: Path, v: Any) -> Any:
            return v if p in fixed else _value(program, "state", p, v)

        state = mapped(first, remembered)
        given = mapped(self.law.inputs, lambda p, v: _value(program, "inputs", p, v))
        return (state, *self.law.step(self.parameters(program), state, given))

    def step(self, first: Any, numbers: Iterator[int]) -> tuple[Program, Leaves, Leaves]:
        """A recorded step, what it remembers of the state, and what it gives.

        What every step leaves as the start puts it is a constant, no memory.
        """
        fixed: set[Path] = set()
        while True:
            program = Program(numbers)
            before, after, out = self.stepped(program, first, fixed)
            still = _unchanged(before, after, first) - fixed
            if not still:
                return program, [(p, v) for p, v in leaves(after) if p not in fixed], [*leaves(out)]
            fixed |= still


def _recorded(law: Law, free: Mapping[Path, float], fixed: tuple[str, ...]) -> Block:
    recording, numbers = _Recording(law, free), count()
    begin = Program(numbers)
    first = law.start(recording.parameters(begin))
    names = [identifier(p) for p, _ in leaves(first)]
    if len(set(names)) < len(names):
        raise ModelError(f"two parts of its memory are called alike: {', '.join(names)}")
    program, kept, out = recording.step(first, numbers)
    lines, kept = _step_lines(program, kept, out)
    remembered = {p for p, _ in kept}
    opened = _lines(begin, _assigned("state", [x for x in leaves(first) if x[0] in remembered]))
    used = "\n".join([*lines, *opened])
    read = set(_PARAMETER.findall(used))
    return Block(
        name=law.name,
        title=law.title,
        parameters=tuple(
            Field(identifier(p), *law.units(p), values=(v,))
            for p, v in free.items()
            if identifier(p) in read
        ),
        states=tuple(_fields(law, kept)),
        inputs=tuple(_fields(law, leaves(law.inputs))),
        outputs=tuple(_fields(law, out)),
        start=tuple(opened),
        step=tuple(lines),
        support=(*program.support(used), *begin.support(used)),
        fixed=fixed,
    )


def _step_lines(program: Program, kept: Leaves, out: Leaves) -> tuple[list[str], Leaves]:
    """Lines of a step, and what of the state it reads: the rest is not remembered."""
    gave = _assigned("outputs", out)
    while True:
        lines = _lines(program, [*gave, *_assigned("state", kept)])
        # what stands on the left of = is written, all else is read
        read = {n for line in lines for n in _READ.findall(line.partition(" = ")[2] or line)}
        needed = [(p, v) for p, v in kept if identifier(p) in read]
        if len(needed) == len(kept):
            return lines, kept
        kept = needed


def _lines(program: Program, rows: Sequence[tuple[str, list[Cell]]]) -> list[str]:
    """What computes the cells, and then puts them where they belong."""
    return [*program.lines([c for _, row in rows for c in row]), *_texts(rows)]


def _value(program: Program, struct: str, path: Path, value: Any) -> Traced:
    """A member of a struct as value of a program, of the shape of ``value``."""
    name, shape = f"{struct}->{identifier(path)}", cells_of(value).shape
    if not shape:
        return Traced(program.line(name, ()))
    cells = np.empty(int(np.prod(shape)), dtype=object)
    cells[:] = program.inputs(name, cells.size)
    return Traced(cells.reshape(shape))


def _unchanged(state: Any, after: Any, first: Any) -> set[Path]:
    """Places where a step leaves what the start put there as plain numbers."""
    before, ended, begun = (dict(leaves(t)) for t in (state, after, first))
    if before.keys() != ended.keys():
        raise ModelError("its memory changes its parts during a step")
    return {
        p
        for p, value in begun.items()
        if all(c.number is not None for c in cells_of(value).flat)
        and _texts_of(before[p]) == _texts_of(ended[p])
    }


def _texts_of(value: Any) -> list[str]:
    return [c.text for c in cells_of(value).flat]


def _assigned(struct: str, tree: Leaves) -> list[tuple[str, list[Cell]]]:
    """What is to be put into the members of a struct."""
    assigned = []
    for path, value in tree:
        cells = cells_of(value)
        name = f"{struct}->{identifier(path)}"
        assigned.append((f"{name}[{{}}]" if cells.ndim else name, cells.ravel().tolist()))
    return assigned


def _texts(rows: Sequence[tuple[str, list[Cell]]]) -> Iterator[str]:
    for name, cells in rows:
        for k, c in enumerate(cells):
            yield f"{name.format(k)} = {as_number(c)};"


def _fields(law: Law, tree: Any) -> Iterator[Field]:
    for path, value in tree:
        yield Field(identifier(path), *law.units(path), size=size(value))


__all__ = ["TRACE", "Block", "Law", "recorded"]
