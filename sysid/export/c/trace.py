"""Equations written over an array namespace, recorded as they are computed and written as C.

Grey boxes and effects are functions of (xp, state, …) for xp = numpy or jax.numpy. Here xp is
``TRACE`` and the signals are arrays of ``Cell``: every operation between them becomes a line of a
``Program``, those between numbers are carried out, and lines that nothing uses are left out.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from types import SimpleNamespace
from typing import Any

import numpy as np

from sysid.errors import ModelError
from sysid.export.c.writing import factor, number


class Program:
    """Lines of C in the order in which they were recorded; equal expressions become one line."""

    def __init__(self) -> None:
        self._lines: list[tuple[str, str, tuple[str, ...]]] = []
        self._known: dict[str, str] = {}

    def line(self, text: str, used: Sequence["Cell"], truth: bool = False) -> "Cell":
        """The value of a C expression that uses these cells."""
        if text not in self._known:
            name = f"t{len(self._lines)}"
            kind = "int" if truth else "double"
            names = tuple(c.text for c in used if c.number is None)
            self._lines.append((name, f"const {kind} {name} = {text};", names))
            self._known[text] = name
        return Cell(self, self._known[text], None)

    def inputs(self, name: str, shape: tuple[int, ...], first: int = 0) -> "Traced":
        """An array that is read from ``name[first]`` on."""
        cells = np.empty(int(np.prod(shape)), dtype=object)
        for k in range(cells.size):
            cells[k] = self.line(f"{name}[{first + k}]", ())
        return Traced(cells.reshape(shape))

    def lines(self, results: Sequence["Cell"]) -> Iterator[str]:
        """The lines that these results need."""
        needed = {c.text for c in results if c.number is None}
        for name, _, used in reversed(self._lines):
            if name in needed:
                needed.update(used)
        for name, line, _ in self._lines:
            if name in needed:
                yield line


class Cell:
    """A number, or a named value of a program.

    Attributes:
        program: where it was recorded, None for a number.
        text: as C.
        number: its value where it is a number.
    """

    __slots__ = ("number", "program", "text")

    def __init__(self, program: Program | None, text: str, value: float | None) -> None:
        self.program, self.text, self.number = program, text, value


def cell(value: Any) -> Cell:
    """A cell as it is, anything else as a number."""
    if isinstance(value, Cell):
        return value
    return Cell(None, factor(float(value)), float(value))


def _recorded(
    form: str, numeric: Callable[..., Any], cells: Sequence[Cell], truth: bool = False
) -> Cell:
    """The value of an operation: a number where all are, else a line of the program."""
    program = next((c.program for c in cells if c.program is not None), None)
    if program is None:
        return cell(numeric(*(c.number for c in cells)))
    return program.line(form.format(*(c.text for c in cells)), cells, truth)


def _add(a: Cell, b: Cell) -> Cell:
    if a.number == 0.0:
        return b
    return a if b.number == 0.0 else _recorded("{0} + {1}", np.add, (a, b))


def _subtract(a: Cell, b: Cell) -> Cell:
    return a if b.number == 0.0 else _recorded("{0} - {1}", np.subtract, (a, b))


def _multiply(a: Cell, b: Cell) -> Cell:
    if a.number == 0.0 or b.number == 0.0:
        return cell(0.0)
    if a.number == 1.0:
        return b
    return a if b.number == 1.0 else _recorded("{0} * {1}", np.multiply, (a, b))


def _divide(a: Cell, b: Cell) -> Cell:
    return a if b.number == 1.0 else _recorded("{0} / {1}", np.divide, (a, b))


def _power(a: Cell, b: Cell) -> Cell:
    if b.number == 2.0:
        return _multiply(a, a)
    return a if b.number == 1.0 else _recorded("pow({0}, {1})", np.power, (a, b))


def _plain(form: str, numeric: Callable[..., Any], truth: bool = False) -> Callable[..., Cell]:
    return lambda *cells: _recorded(form, numeric, cells, truth)


_where = _plain("{0} ? {1} : {2}", lambda c, a, b: a if c else b)
_maximum = _plain("{0} > {1} ? {0} : {1}", np.maximum)
_minimum = _plain("{0} < {1} ? {0} : {1}", np.minimum)


class Traced:
    """An array of cells with NumPy's shapes, indices and operators."""

    __array_ufunc__ = None  # NumPy's arrays leave mixed operations to this class

    def __init__(self, cells: Any) -> None:
        self.cells = np.asarray(cells, dtype=object)

    @property
    def shape(self) -> tuple[int, ...]:
        """Its shape."""
        return self.cells.shape

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return self.cells.ndim

    def reshape(self, *shape: Any) -> "Traced":
        """The same cells in another shape."""
        return Traced(self.cells.reshape(*shape))

    def ravel(self) -> list[Cell]:
        """The cells in a row."""
        return list(self.cells.ravel())

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, key: Any) -> "Traced":
        return Traced(self.cells[key])

    def __iter__(self) -> Iterator["Traced"]:
        return (self[k] for k in range(len(self)))

    def __bool__(self) -> bool:
        raise ModelError(
            "its equations decide by values of signals in Python, which cannot be written as C; "
            "use xp.where instead of if"
        )

    def __add__(self, other: Any) -> "Traced":
        return _each(_add, self, other)

    def __radd__(self, other: Any) -> "Traced":
        return _each(_add, other, self)

    def __sub__(self, other: Any) -> "Traced":
        return _each(_subtract, self, other)

    def __rsub__(self, other: Any) -> "Traced":
        return _each(_subtract, other, self)

    def __mul__(self, other: Any) -> "Traced":
        return _each(_multiply, self, other)

    def __rmul__(self, other: Any) -> "Traced":
        return _each(_multiply, other, self)

    def __truediv__(self, other: Any) -> "Traced":
        return _each(_divide, self, other)

    def __rtruediv__(self, other: Any) -> "Traced":
        return _each(_divide, other, self)

    def __pow__(self, other: Any) -> "Traced":
        return _each(_power, self, other)

    def __rpow__(self, other: Any) -> "Traced":
        return _each(_power, other, self)

    def __neg__(self) -> "Traced":
        return _each(_plain("-{0}", np.negative), self)

    def __abs__(self) -> "Traced":
        return _each(_plain("fabs({0})", np.abs), self)

    def __gt__(self, other: Any) -> "Traced":
        return _each(_plain("{0} > {1}", np.greater, True), self, other)

    def __ge__(self, other: Any) -> "Traced":
        return _each(_plain("{0} >= {1}", np.greater_equal, True), self, other)

    def __lt__(self, other: Any) -> "Traced":
        return _each(_plain("{0} < {1}", np.less, True), self, other)

    def __le__(self, other: Any) -> "Traced":
        return _each(_plain("{0} <= {1}", np.less_equal, True), self, other)

    def __eq__(self, other: object) -> "Traced":  # type: ignore[override]
        return _each(_plain("{0} == {1}", np.equal, True), self, other)

    def __ne__(self, other: object) -> "Traced":  # type: ignore[override]
        return _each(_plain("{0} != {1}", np.not_equal, True), self, other)

    __hash__ = None  # type: ignore[assignment]

    def __and__(self, other: Any) -> "Traced":
        return _each(_plain("{0} && {1}", lambda a, b: bool(a and b), True), self, other)

    __rand__ = __and__

    def __or__(self, other: Any) -> "Traced":
        return _each(_plain("{0} || {1}", lambda a, b: bool(a or b), True), self, other)

    __ror__ = __or__

    def __invert__(self) -> "Traced":
        return _each(_plain("!{0}", lambda a: not a, True), self)


def _cells(value: Any) -> Any:
    """An array of cells from anything that can be one."""
    if isinstance(value, Traced):
        return value.cells
    numbers = np.asarray(value)
    found = np.empty(numbers.shape, dtype=object)
    for k in np.ndindex(numbers.shape):
        found[k] = cell(numbers[k])
    return found


def _each(operation: Callable[..., Cell], *values: Any) -> Traced:
    """An operation entry by entry, shapes brought together as NumPy does."""
    arrays = np.broadcast_arrays(*map(_cells, values))
    found = np.empty(arrays[0].shape, dtype=object)
    for k in np.ndindex(found.shape):
        found[k] = operation(*(a[k] for a in arrays))
    return Traced(found)


def _is_traced(value: Any) -> bool:
    return isinstance(value, Traced) or (
        isinstance(value, list | tuple) and any(map(_is_traced, value))
    )


def _function(name: str, operation: Callable[..., Cell]) -> Callable[..., Any]:
    """NumPy's function for numbers, the operation for traced arrays."""

    def call(*values: Any) -> Any:
        if any(map(_is_traced, values)):
            return _each(operation, *values)
        return getattr(np, name)(*values)

    return call


def _joined(name: str) -> Callable[..., Any]:
    def call(parts: Sequence[Any], axis: int = 0) -> Any:
        joined = getattr(np, name)
        if _is_traced(list(parts)):
            return Traced(joined([_cells(p) for p in parts], axis=axis))
        return joined(parts, axis=axis)

    return call


def _reduced(name: str, pair: Callable[[Cell, Cell], Cell], mean: bool = False) -> Any:
    def call(value: Any, axis: int | None = None, keepdims: bool = False) -> Any:
        if not isinstance(value, Traced):
            return getattr(np, name)(value, axis=axis, keepdims=keepdims)
        cells = value.cells if axis is not None else value.cells.ravel()
        rows = np.moveaxis(cells, axis or 0, 0)
        total = reduce(lambda a, b: _each(pair, a, b), (Traced(r) for r in rows))
        if mean:
            total = total / float(len(rows))
        if keepdims:
            return Traced(np.expand_dims(total.cells, 0 if axis is None else axis))
        return total

    return call


class _Namespace(SimpleNamespace):
    """The functions that can be written as C; asking for another one says so."""

    def __getattr__(self, name: str) -> Any:
        raise ModelError(f"its equations use {name}, which cannot be written as C")


_C_FUNCTIONS = {
    "exp": "exp", "expm1": "expm1", "log": "log", "log1p": "log1p", "sqrt": "sqrt", "sin": "sin",
    "cos": "cos", "tan": "tan", "arcsin": "asin", "arccos": "acos", "arctan": "atan",
    "sinh": "sinh", "cosh": "cosh", "tanh": "tanh", "abs": "fabs", "fabs": "fabs",
    "floor": "floor", "ceil": "ceil",
}  # fmt: skip

TRACE: Any = _Namespace(
    pi=np.pi,
    inf=np.inf,
    zeros=np.zeros,
    ones=np.ones,
    asarray=lambda a: a if _is_traced(a) else np.asarray(a),
    zeros_like=lambda a: np.zeros(np.shape(_cells(a))),
    ones_like=lambda a: np.ones(np.shape(_cells(a))),
    where=_function("where", _where),
    maximum=_function("maximum", _maximum),
    minimum=_function("minimum", _minimum),
    clip=_function("clip", lambda a, low, high: _minimum(_maximum(a, low), high)),
    power=_function("power", _power),
    arctan2=_function("arctan2", _plain("atan2({0}, {1})", np.arctan2)),
    sign=_function("sign", _plain("(double)(({0} > 0.0) - ({0} < 0.0))", np.sign)),
    stack=_joined("stack"),
    concatenate=_joined("concatenate"),
    sum=_reduced("sum", _add),
    mean=_reduced("mean", _add, mean=True),
    max=_reduced("max", _maximum),
    min=_reduced("min", _minimum),
    **{
        name: _function(name, _plain(f"{c}({{0}})", getattr(np, name)))
        for name, c in _C_FUNCTIONS.items()
    },
)
"""The namespace that records."""


def assigned(name: str, values: Sequence[Cell], first: int = 0, operator: str = "=") -> list[str]:
    """Lines that put cells into ``name[first]`` and on."""
    return [
        f"{name}[{first + k}] {operator} {c.text if c.number is None else number(c.number)};"
        for k, c in enumerate(values)
    ]
