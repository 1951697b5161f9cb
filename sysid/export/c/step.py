"""The step of a model as C: recorded from the structure's ``step``, or the structure's own.

Its files are a header, one step function with a state struct, and a self-test.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.errors import ModelError
from sysid.export.c.fields import Field, listed, places
from sysid.export.c.parameters import (
    STRUCT,
    plant_numbers,
    theta_numbers,
    traced_step,
)
from sysid.export.templates import fill
from sysid.plant.selftest import TOLERANCE, SelfTest
from sysid.runners.trace.program import Derived, Program, assigned
from sysid.runners.trace.traced import Traced, cells_of
from sysid.structures import special_runs
from sysid.structures.model import Model
from sysid.structures.special_runs import CStep

WORDS = (
    "x holds the states, v the inputs as deviations from the operating point. The lines below are",
    "the equations of the model as sysid computes them, recorded; its numbers are parameters.",
)
OWN_WORDS = ("The numbers of these equations are constants: only the operating point can change.",)

MOST_TRIED = 64
"""Numbers of θ that are tried one by one where not all of them can be parameters together; a
network has more, and what it does with one it does with all."""

MOST_FOLLOWING = 500
"""Lines up to which what follows from parameters alone is computed in C. More come from outputs of
high order that act on each other, whose transfer functions have products of all coefficients."""

COEFFICIENTS = "coefficients"
"""The parameter that holds what would take more lines: the numbers of the transfer functions."""

DERIVED = "state->derived"
"""Where the state holds what follows from parameters alone."""

_READ = re.compile(rf"{re.escape(DERIVED)}\[\d+\]|{STRUCT}\w+(?:\[\d+\])?")
"""A number that a line reads of parameters, or of what follows from them."""

UNWRITABLE = (ArithmeticError, AttributeError, LookupError, ModelError, TypeError, ValueError)
"""What a step raises that does with recording arrays what only numbers can do."""


@dataclass(frozen=True)
class PlantStep:
    """One step of a plant as C99.

    Attributes:
        words: lines of the comment at the head of the file.
        parameters: what may be changed at run time, with its values.
        entering: lines that put the inputs, less their operating point, into ``v``.
        starting: lines that put the operating point of the outputs into ``out``.
        body: lines that add to ``out`` and advance ``x``.
        support: tables and functions that these need.
        derived: what is computed from parameters alone, only where one has changed.
        following: lines that compute it.
        sources: parameters from which it follows, by their places in the struct, with their values.
        feedthrough: whether an output may depend on the inputs of its own instant.
    """

    n_states: int
    words: tuple[str, ...]
    parameters: tuple[Field, ...]
    entering: tuple[str, ...]
    starting: tuple[str, ...]
    body: tuple[str, ...]
    support: tuple[str, ...] = ()
    derived: tuple[Derived, ...] = ()
    following: tuple[str, ...] = ()
    sources: tuple[tuple[str, float], ...] = ()
    feedthrough: bool = True


def c_step(model: Model) -> PlantStep:
    """One step of a model as C."""
    try:
        own_step = special_runs.c_step(model.structure, model.theta)
        if own_step is not None:
            return _of_its_own(model, own_step)
        step = _recorded(model, ())
        long = len(step.following) > MOST_FOLLOWING
        return (_of_coefficients(step) or _recorded(model, None)) if long else step
    except UNWRITABLE:
        pass  # perhaps only because some numbers are to be parameters
    every = range(len(theta_numbers(model)))
    try:
        plain = _recorded(model, None)
    except UNWRITABLE as error:
        # NumPy says that a signal is no number, its cause says what to write instead
        why = str(error.__cause__ or error)
        raise ModelError(
            f"this {model.structure.name} model cannot be written as C: {why}; run its plant.json "
            "with sysid"
        ) from None
    if len(every) > MOST_TRIED:
        return plain
    fixed = [k for k in every if not _can_change(model, k, every)]
    return _recorded(model, fixed) if len(fixed) < len(every) else plain


def tunable_parameters(model: Model) -> tuple[Field, ...]:
    """What of a plant may be changed at run time in C: name, unit, identified value, words.

    In the order of the members of ``plant_parameters`` in ``plant.h``, arrays entry by entry.
    """
    return tuple(listed(c_step(model).parameters))


def _can_change(model: Model, one: int, every: Iterable[int]) -> bool:
    """Whether an equation can be recorded with one number of θ as a parameter."""
    try:
        _recorded(model, [k for k in every if k != one])
    except UNWRITABLE:
        return False
    return True


def _recorded(model: Model, fixed: Iterable[int] | None) -> PlantStep:
    """The step with these entries of θ as numbers, None for all, and the others as parameters."""
    structure = model.structure
    n, ny = structure.n_states(model.theta), len(model.outputs)
    program = Program()
    numbers = plant_numbers(program, model, fixed)
    x: Any = Traced(program.inputs("x", n))
    v: Any = Traced(program.inputs("v", len(model.inputs)))
    with np.errstate(all="ignore"):
        step = (
            structure.step(model.theta)
            if fixed is None
            else traced_step(structure, numbers.theta, model.theta)
        )
        after, y = map(cells_of, step(x, v))
    if (after.shape, y.shape) != ((n,), (ny,)):
        raise ValueError(
            f"a step gives states {after.shape} and outputs {y.shape} where ({n},) and ({ny},) are "
            "expected"
        )
    moved, out = after.tolist(), y.tolist()
    lines, derived, following = program.parted([*moved, *out])
    head = [
        f"const {'int' if d.truth else 'double'} {d.name} = {DERIVED}[{k}]"
        f"{' != 0.0' if d.truth else ''};"
        for k, d in enumerate(derived)
    ]
    body = [*head, *lines, *assigned("out", out, operator="+="), *assigned("x", moved)]
    entering, starting = _operating_point(numbers.u_offset, numbers.y_offset)
    text = "\n".join([*entering, *starting, *body, *following])
    parameters = numbers.read_in(text)
    read = set(re.findall(rf"{STRUCT}(\w+(?:\[\d+\])?)", "\n".join(following)))
    return PlantStep(
        n,
        WORDS,
        parameters,
        entering,
        starting,
        tuple(body),
        tuple(program.support(text)),
        tuple(derived),
        tuple(following),
        tuple((place, value) for place, value in places(parameters) if place in read),
        any(" v[" in line for line in program.lines(out)),
    )


def _of_coefficients(step: PlantStep) -> PlantStep | None:
    """The same step with what its equations hold as parameters, in place of what that is made of.

    None where a loop goes through parameters.
    """
    body = "\n".join(step.body)
    if re.search(rf"{STRUCT}\w+\[(?!\d+\])", body):
        return None
    known = {f"{DERIVED}[{k}]": d.usual for k, d in enumerate(step.derived)}
    known |= {f"{STRUCT}{p}": v for p, v in places(step.parameters)}
    read = list(dict.fromkeys(_READ.findall(body)))
    at = {name: f"{STRUCT}{COEFFICIENTS}[{k}]" for k, name in enumerate(read)}
    words = "what the equations hold of the identified numbers"
    values = tuple(known[name] for name in read)
    outside = "\n".join([*step.entering, *step.starting])
    kept = [f for f in step.parameters if f"{STRUCT}{f.name}" in _READ.findall(outside)]
    return replace(
        step,
        parameters=(Field(COEFFICIENTS, "", words, len(values), values), *kept),
        body=tuple(_READ.sub(lambda m: at[m[0]], line) for line in step.body),
        derived=(),
        following=(),
        sources=(),
    )


def _of_its_own(model: Model, own_step: CStep) -> PlantStep:
    """What a structure says itself: C may change the operating point alone."""
    numbers = plant_numbers(Program(), model, None)
    entering, starting = _operating_point(numbers.u_offset, numbers.y_offset)
    return PlantStep(
        own_step.n_states,
        (*own_step.words, *OWN_WORDS),
        numbers.read_in("\n".join([*entering, *starting])),
        entering,
        starting,
        tuple(line.removeprefix("    ") for line in own_step.body),
        own_step.support,
    )


def _operating_point(u: Traced, y: Traced) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Lines that take it off the inputs, and begin the outputs with it."""
    off = ["" if c.number == 0.0 else f" - {c.text}" for c in u.cells]
    return (
        tuple(f"v[{j}] = u[{j}]{text};" for j, text in enumerate(off)),
        tuple(f"out[{i}] = {c.text};" for i, c in enumerate(y.cells)),
    )


_MATHEMATICAL = re.compile(r"\b(HUGE_VAL|NAN|[a-z]\w*\()")
"""What needs math.h: infinity, and calls of functions."""


def c_sources(
    model: Model, test: SelfTest, name: str = "", tolerance: float = TOLERANCE
) -> dict[str, str]:
    """:func:`plant_sources` of a model's step."""
    return plant_sources(model, c_step(model), test, name, tolerance)


def plant_sources(
    model: Model, written: PlantStep, test: SelfTest, name: str, tolerance: float
) -> dict[str, str]:
    """``plant.h``, ``plant.c`` and ``selftest.c`` of a model.

    The code computes what the structure's ``step`` computes, in double precision, so that it
    agrees with Python to rounding.

    Args:
        test: the rows ``selftest.c`` checks.
        name: what to call the plant; the structure's title where that is empty.
        tolerance: error that ``selftest.c`` allows, in parts of the range of each output.
    """

    def used(word: str) -> bool:
        texts = written.body if word in ("x", "v") else lines
        return any(re.search(rf"\b{word}\b", line) for line in texts)

    lines = (*written.entering, *written.starting, *written.body)
    code = "\n".join((*written.support, *written.body, *written.following))
    values = [v for _, v in places(written.parameters)]
    common = {
        "title": f"{name}: {model.structure.traits.title}"
        if name
        else model.structure.traits.title,
        "model": model,
        "step": written,
    }
    return {
        "plant.h": fill("c/plant.h", **common),
        "plant.c": fill(
            "c/plant.c",
            **common,
            needs_math=_MATHEMATICAL.search(code) or not np.all(np.isfinite(values)),
            lines=lines,
            used=used,
        ),
        "selftest.c": fill(
            "c/selftest.c",
            **common,
            rows=np.column_stack([test.u, test.y]),
            scale=test.scale(),
            tolerance=tolerance,
        ),
    }
