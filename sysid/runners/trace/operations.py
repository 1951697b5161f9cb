"""Operations between cells: computed between numbers, recorded otherwise, dropped if idle."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from sysid.runners.trace.program import Cell, constant


@dataclass(frozen=True)
class Operation:
    """One operation on single values.

    Attributes:
        form: as C, {0}, {1} … its arguments.
        numeric: the same on numbers.
        truth: whether it gives a truth.
        conditions: which arguments are truths.
        idle: (cells) → the cell it gives without an operation, or None.
    """

    form: str
    numeric: Callable[..., Any]
    truth: bool = False
    conditions: tuple[int, ...] = ()
    idle: Callable[..., Cell | None] = lambda *cells: None

    def __call__(self, *cells: Cell) -> Cell:
        """The value: a number where all are, else a line of their program."""
        program = next((c.program for c in cells if c.program is not None), None)
        if program is None:
            return constant(float(self.numeric(*(c.number for c in cells))))
        cell = self.idle(*cells)
        if cell is not None:
            return cell
        texts = (
            c.text
            if c.number is not None and k not in self.conditions
            else program.read(c.text, c.name, k in self.conditions)
            for k, c in enumerate(cells)
        )
        text = self.form.format(*texts)
        if all(c.number is not None or c.usual is not None for c in cells):
            usual = [c.usual if c.number is None else c.number for c in cells]
            return program.derived(text, cells, self.truth, float(self.numeric(*usual)))
        return program.line(text, cells, self.truth)


def cell(value: Any) -> Cell:
    """A cell as it is, anything else as a number."""
    return value if isinstance(value, Cell) else constant(float(value))


def _added(a: Cell, b: Cell) -> Cell | None:
    return b if a.number == 0.0 else a if b.number == 0.0 else None


def _multiplied(a: Cell, b: Cell) -> Cell | None:
    if a.number == 0.0 or b.number == 0.0:
        return constant(0.0)
    return b if a.number == 1.0 else a if b.number == 1.0 else None


def _second(neutral: float) -> Callable[[Cell, Cell], Cell | None]:
    return lambda a, b: a if b.number == neutral else None


def _powered(a: Cell, b: Cell) -> Cell | None:
    if b.number == 2.0:
        return MULTIPLY(a, a)
    return a if b.number == 1.0 else None


def _limited(never: float) -> Callable[[Cell, Cell], Cell | None]:
    return lambda a, b: a if b.number == never else b if a.number == never else None


def _chosen(c: Cell, a: Cell, b: Cell) -> Cell | None:
    if c.number is not None:
        return a if c.number else b
    return a if a.text == b.text else None


ADD = Operation("{0} + {1}", np.add, idle=_added)
SUBTRACT = Operation("{0} - {1}", np.subtract, idle=_second(0.0))
MULTIPLY = Operation("{0} * {1}", np.multiply, idle=_multiplied)
DIVIDE = Operation("{0} / {1}", np.divide, idle=_second(1.0))
POWER = Operation("pow({0}, {1})", np.power, idle=_powered)
NEGATIVE = Operation("-{0}", np.negative)
MAXIMUM = Operation("{0} > {1} ? {0} : {1}", np.maximum, idle=_limited(-np.inf))
MINIMUM = Operation("{0} < {1} ? {0} : {1}", np.minimum, idle=_limited(np.inf))
WHERE = Operation("{0} ? {1} : {2}", lambda c, a, b: a if c else b, conditions=(0,), idle=_chosen)
ABSOLUTE = Operation("fabs({0})", np.abs)
SIGN = Operation("(double)(({0} > 0.0) - ({0} < 0.0))", np.sign)

_AND = Operation("{0} && {1}", np.logical_and, True, (0, 1))
_OR = Operation("{0} || {1}", np.logical_or, True, (0, 1))
_NOT = Operation("!{0}", np.logical_not, True, (0,))

_COMPARISONS = {
    "greater": ">", "greater_equal": ">=", "less": "<", "less_equal": "<=",
    "equal": "==", "not_equal": "!=",
}  # fmt: skip
_C_FUNCTIONS = {
    "exp": "exp", "expm1": "expm1", "log": "log", "log1p": "log1p", "log10": "log10",
    "sqrt": "sqrt", "sin": "sin", "cos": "cos", "tan": "tan", "arcsin": "asin",
    "arccos": "acos", "arctan": "atan", "sinh": "sinh", "cosh": "cosh", "tanh": "tanh",
    "fabs": "fabs", "floor": "floor", "ceil": "ceil",
}  # fmt: skip

OPERATIONS: Mapping[str, Operation] = MappingProxyType(
    {
        "add": ADD,
        "subtract": SUBTRACT,
        "multiply": MULTIPLY,
        "divide": DIVIDE,
        "power": POWER,
        "negative": NEGATIVE,
        "maximum": MAXIMUM,
        "minimum": MINIMUM,
        "where": WHERE,
        "abs": ABSOLUTE,
        "absolute": ABSOLUTE,
        "sign": SIGN,
        "fmod": Operation("fmod({0}, {1})", np.fmod),
        "isnan": Operation("isnan({0})", np.isnan, True),
        "isfinite": Operation("isfinite({0})", np.isfinite, True),
        "arctan2": Operation("atan2({0}, {1})", np.arctan2),
        "hypot": Operation("hypot({0}, {1})", np.hypot),
        "logical_not": _NOT,
        "invert": _NOT,
        "logical_and": _AND,
        "logical_or": _OR,
        "bitwise_and": _AND,
        "bitwise_or": _OR,
        **{
            name: Operation(f"{{0}} {c} {{1}}", getattr(np, name), True)
            for name, c in _COMPARISONS.items()
        },
        **{name: Operation(f"{c}({{0}})", getattr(np, name)) for name, c in _C_FUNCTIONS.items()},
    }
)
"""What can be written as C entry by entry, by NumPy's names."""


def total(cells: Sequence[Cell], operation: Operation = ADD) -> Cell:
    """Cells taken together from left to right."""
    sum_cell = cells[0]
    for c in cells[1:]:
        sum_cell = operation(sum_cell, c)
    return sum_cell
