"""Arrays whose operations are recorded as C, and the namespace of functions that work on them.

``step`` of a structure is a function of two arrays, written with operators and with the functions
of the arrays' namespace (``x.__array_namespace__()``) or of NumPy. Called with ``Traced`` arrays,
it leaves the program that computes it.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from sysid.errors import ModelError
from sysid.runners.trace.operations import (
    ADD,
    MAXIMUM,
    MINIMUM,
    MULTIPLY,
    OPERATIONS,
    WHERE,
    Operation,
    cell,
)
from sysid.runners.trace.operations import total as taken_together
from sysid.runners.trace.program import Cell, Cells, Program

WRITTEN_OUT = 24
"""Entries up to which an operation on an array is written out; beyond, it becomes a loop.

Written out, ones and zeros cost nothing and values need no memory; a loop's code does not grow.
Motors, tanks and effects have two or six entries a signal, the tables of a network hundreds."""


def _operator(name: str, swapped: bool = False) -> Callable[..., Any]:
    if swapped:
        return lambda self, other: _called(name, other, self)
    return lambda *values: _called(name, *values)


class Traced:
    """An array of cells with NumPy's shapes, indices, operators and functions."""

    def __init__(self, cells: Any) -> None:
        self.cells: Cells = np.asarray(cells, dtype=object)

    def __array_namespace__(self, api_version: str | None = None) -> Any:
        return TRACE

    def __array_ufunc__(self, ufunc: Any, method: str, *values: Any, **options: Any) -> "Traced":
        name = ufunc.__name__
        if method != "__call__" or any(v is not None for v in options.values()):
            raise _refusal(f"{name}.{method}")
        if name == "matmul":
            return _product(*values)
        return _called(name, *values)

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        return getattr(TRACE, function.__name__)(*args, **options)

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(self.cells.shape)

    @property
    def ndim(self) -> int:
        return int(self.cells.ndim)

    @property
    def size(self) -> int:
        return int(self.cells.size)

    @property
    def T(self) -> "Traced":
        return Traced(self.cells.T)

    def reshape(self, *shape: Any) -> "Traced":
        return Traced(self.cells.reshape(*shape))

    def ravel(self) -> "Traced":
        return Traced(self.cells.ravel())

    def clip(self, low: Any, high: Any) -> "Traced":
        """Cut to [low, high]."""
        clipped: Traced = _clip(self, low, high)
        return clipped

    def min(self, axis: int | None = None) -> "Traced":
        return _reduced(self, axis, MINIMUM)

    def max(self, axis: int | None = None) -> "Traced":
        return _reduced(self, axis, MAXIMUM)

    def any(self) -> "Traced":
        return Traced(taken_together(self.cells.ravel().tolist(), OPERATIONS["logical_or"]))

    def all(self) -> "Traced":
        return Traced(taken_together(self.cells.ravel().tolist(), OPERATIONS["logical_and"]))

    def swapaxes(self, one: int, other: int) -> "Traced":
        return Traced(self.cells.swapaxes(one, other))

    def tolist(self) -> Any:
        return [part.tolist() for part in self] if self.ndim else self

    def astype(self, kind: Any) -> "Traced":
        """The same: C makes an integer where an index is wanted."""
        return self

    def copy(self) -> "Traced":
        return Traced(self.cells.copy())

    def sum(self, axis: int | None = None) -> "Traced":
        return _reduced(self, axis)

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, key: Any) -> "Traced":
        if isinstance(key, Traced):
            return _looked_up(self, key)
        if isinstance(key, tuple) and any(isinstance(k, Traced) for k in key):
            return _looked_up(self.ravel(), _flat_index(self.shape, key))
        return Traced(self.cells[key])

    def __setitem__(self, key: Any, value: Any) -> None:
        cells = cells_of(value)
        self.cells[key] = cells if cells.ndim else cells.item()

    def __iter__(self) -> Iterator["Traced"]:
        return (self[k] for k in range(len(self)))

    def __bool__(self) -> bool:
        if self.size == 1 and self.cells.item().number is not None:
            return bool(self.cells.item().number)
        raise ModelError(
            "its equations decide by values of signals in Python, which cannot be written as C; "
            "use xp.where instead of if"
        )

    def __float__(self) -> float:
        if self.size == 1 and self.cells.item().number is not None:
            return float(self.cells.item().number)
        raise ModelError(
            "its equations make a Python number of a signal, which cannot be written as C; keep "
            "arrays and put them together by xp.stack or xp.concatenate"
        )

    def __index__(self) -> int:
        return int(float(self))

    __int__ = __index__
    __hash__ = None  # type: ignore[assignment]

    __add__, __radd__ = _operator("add"), _operator("add", swapped=True)
    __sub__, __rsub__ = _operator("subtract"), _operator("subtract", swapped=True)
    __mul__, __rmul__ = _operator("multiply"), _operator("multiply", swapped=True)
    __truediv__, __rtruediv__ = _operator("divide"), _operator("divide", swapped=True)
    __mod__, __rmod__ = _operator("mod"), _operator("mod", swapped=True)
    __pow__, __rpow__ = _operator("power"), _operator("power", swapped=True)
    __and__, __rand__ = _operator("bitwise_and"), _operator("bitwise_and", swapped=True)
    __or__, __ror__ = _operator("bitwise_or"), _operator("bitwise_or", swapped=True)
    __neg__, __abs__, __invert__ = map(_operator, ("negative", "absolute", "invert"))
    __gt__, __ge__ = _operator("greater"), _operator("greater_equal")
    __lt__, __le__ = _operator("less"), _operator("less_equal")
    __eq__, __ne__ = _operator("equal"), _operator("not_equal")

    def __matmul__(self, other: Any) -> "Traced":
        return _product(self, other)

    def __rmatmul__(self, other: Any) -> "Traced":
        return _product(other, self)


def cells_of(value: Any) -> Cells:
    """An array of cells from anything that can be one."""
    if isinstance(value, Traced):
        return value.cells
    if isinstance(value, list | tuple) and any(isinstance(v, Traced) for v in value):
        return np.stack([cells_of(v) for v in value])
    entries = np.asarray(value)
    cells = np.empty(entries.shape, dtype=object)
    for k in np.ndindex(entries.shape):
        entry = entries[k]
        cells[k] = entry.cells.item() if isinstance(entry, Traced) else cell(entry)
    return cells


def _called(name: str, *values: Any) -> Traced:
    """NumPy's function of this name."""
    return _remainder(*values) if name in _REMAINDERS else _each(_operation(name), *values)


_REMAINDERS = ("mod", "remainder")


def _remainder(a: Any, b: Any) -> Traced:
    """Python's remainder, with the sign of its divisor, by C's, which has that of the other."""
    remainder = _each(OPERATIONS["fmod"], a, b)
    one, other = (_each(OPERATIONS["less"], v, 0.0) for v in (remainder, b))
    opposite = _each(OPERATIONS["not_equal"], one, other)
    return _each(WHERE, (remainder != 0.0) & opposite, remainder + b, remainder)


def _program(*arrays: Cells) -> Program | None:
    return next((c.program for a in arrays for c in a.flat if c.program is not None), None)


def _each(operation: Operation, *values: Any) -> Traced:
    """An operation entry by entry, shapes brought together as NumPy does."""
    arrays = [cells_of(v) for v in values]
    shape = np.broadcast_shapes(*(a.shape for a in arrays))
    program = _program(*arrays)
    if program is not None and int(np.prod(shape)) > WRITTEN_OUT:
        if operation is OPERATIONS["power"] and all(c.number == 2.0 for c in arrays[1].flat):
            operation, arrays = MULTIPLY, [arrays[0], arrays[0]]
        return Traced(
            program.looped(operation.form, shape, arrays, operation.truth, operation.conditions)
        )
    arrays = [np.broadcast_to(a, shape) for a in arrays]
    out = np.empty(shape, dtype=object)
    for k in np.ndindex(shape):
        out[k] = operation(*(a[k] for a in arrays))
    return Traced(out)


_FOLDS = {
    ADD: ("{0} + {1}", "0.0"),
    MAXIMUM: ("{1} > {0} ? {1} : {0}", "-HUGE_VAL"),
    MINIMUM: ("{1} < {0} ? {1} : {0}", "HUGE_VAL"),
}
"""How a loop takes entries together, and where it begins."""


def _reduced(value: Any, axis: int | None = None, operation: Operation = ADD) -> Traced:
    """The entries along an axis (all of them by default) taken together."""
    cells = cells_of(value)
    cells = cells.ravel() if axis is None else np.moveaxis(cells, axis, -1)
    program = _program(cells)
    if not cells.shape[-1]:
        return Traced(cells_of(np.zeros(cells.shape[:-1])))
    if program is not None and cells.size > WRITTEN_OUT:
        return Traced(program.reduced(*_FOLDS[operation], cells))
    out = np.empty(cells.shape[:-1], dtype=object)
    for k in np.ndindex(out.shape):
        out[k] = taken_together(cells[k], operation)
    return Traced(out)


def _product(a: Any, b: Any) -> Traced:
    """The matrix product, written out where it is small or has many zeros."""
    left, right = cells_of(a), cells_of(b)
    if max(left.ndim, right.ndim) > 2:
        return _stacked_product(left, right)
    if right.ndim == 2:
        # the rows of aᵀ's partner, equal ones computed once: units that see the same signals
        unique: dict[tuple[str, ...], int] = {}
        rows = [unique.setdefault(tuple(c.text for c in row), len(unique)) for row in right.T]
        first = [rows.index(k) for k in range(len(unique))]
        if len(unique) < len(rows):
            return Traced(_product(Traced(left), Traced(right[:, first])).cells[..., rows])
        left, right = left[..., None, :], right.T
    shape = np.broadcast_shapes(left.shape, right.shape)
    wide, other = np.broadcast_to(left, shape), np.broadcast_to(right, shape)
    idle = sum(p.number == 0.0 or q.number == 0.0 for p, q in zip(wide.flat, other.flat))  # noqa: B905 (of one shape)
    busy = wide.size - idle
    if busy > WRITTEN_OUT and 2 * busy > wide.size:
        return _reduced(_each(MULTIPLY, Traced(left), Traced(right)), -1)
    out = np.empty(shape[:-1], dtype=object)
    for k in np.ndindex(out.shape):
        terms = [MULTIPLY(p, q) for p, q in zip(wide[k], other[k], strict=True)]
        out[k] = taken_together([cell(0.0), *terms])
    return Traced(out)


def _stacked_product(left: Cells, right: Cells) -> Traced:
    """Matrix products side by side."""
    many = np.broadcast_shapes(left.shape[:-2], right.shape[:-2])
    left = np.broadcast_to(left, (*many, *left.shape[-2:]))
    right = np.broadcast_to(right, (*many, *right.shape[-2:]))
    out = np.empty((*many, left.shape[-2], right.shape[-1]), dtype=object)
    for k in np.ndindex(many):
        out[k] = _product(Traced(left[k]), Traced(right[k])).cells
    return Traced(out)


def _flat_index(shape: tuple[int, ...], key: tuple[Any, ...]) -> Traced:
    """Where an entry stands in a row, from its places along all axes."""
    if len(key) != len(shape):
        raise _refusal("indices of some axes that follow from signals")
    at: Any = Traced(cells_of(0.0))
    for n, k in zip(shape, key, strict=True):
        at = at * float(n) + k
    return Traced(cells_of(at))


def _looked_up(row: Traced, at: Traced) -> Traced:
    """Entries of a row at places that follow from signals."""
    out = np.empty(at.shape, dtype=object)
    program = _program(at.cells)
    for k in np.ndindex(at.shape):
        index = at.cells[k]
        if index.number is not None:
            out[k] = row.cells[int(index.number)]
        elif program is None or row.ndim != 1:
            raise _refusal("indices of several axes that follow from signals")
        else:
            out[k] = program.looked_up(row.cells, index)
    return Traced(out)


# ------------------------------------------------------------------------------ the namespace


def _refusal(what: str) -> ModelError:
    return ModelError(f"its equations use {what}, for which there is no C")


def _operation(name: str) -> Operation:
    if name not in OPERATIONS:
        raise _refusal(name)
    return OPERATIONS[name]


class _Namespace(SimpleNamespace):
    """The functions that can be written as C; asking for another one says so."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise _refusal(name)


def _is_traced(value: Any) -> bool:
    return isinstance(value, Traced) or (
        isinstance(value, list | tuple) and any(map(_is_traced, value))
    )


def _function(name: str) -> Callable[..., Any]:
    """NumPy's function for numbers, the operation for traced arrays."""

    def call(*values: Any) -> Any:
        if any(map(_is_traced, values)):
            return _called(name, *values)
        return getattr(np, name)(*values)

    return call


def _joined(name: str) -> Callable[..., Any]:
    def call(parts: Sequence[Any], axis: int = 0) -> Traced:
        return Traced(getattr(np, name)([cells_of(p) for p in parts], axis=axis))

    return call


def _fold(operation: Operation, value: Any, axis: int | None = None, keepdims: bool = False) -> Any:
    folded = _reduced(value, axis, operation)
    if keepdims:
        return Traced(np.expand_dims(folded.cells, 0 if axis is None else axis))
    return folded


def _mean(value: Any, axis: int | None = None, keepdims: bool = False) -> Any:
    cells = cells_of(value)
    n = cells.size if axis is None else cells.shape[axis]
    return _fold(ADD, value, axis, keepdims) / float(n)


def _clip(value: Any, low: Any, high: Any) -> Any:
    return TRACE.minimum(TRACE.maximum(value, low), high)


def _searchsorted(points: Any, value: Any, side: str = "left") -> Traced:
    """How many of these rising points lie below the value, or at it where ``side`` is right."""
    at, rising = Traced(cells_of(value)[..., None]), Traced(cells_of(points))
    below = at >= rising if side == "right" else at > rising
    return _reduced(_each(OPERATIONS["where"], below, 1.0, 0.0), -1)


def _repeated(times: int, advance: Callable[[Any], Any], x: Any) -> Any:
    """x, an array or a tuple of such, after ``times`` rounds of ``advance``: one loop."""
    parts = _parts(x)
    # where it begins with numbers, the result of a round determines the types
    program = _program(*parts) or (_program(*_parts(advance(x))) if times > 1 else None)
    if program is None or times == 1:
        for _ in range(times):
            x = advance(x)
        return x
    rounds = program.repeated(times, [c for p in parts for c in p.ravel()])
    after = advance(_like(x, iter(rounds.entered())))
    shapes = [p.shape for p in _parts(after)]
    if shapes != [p.shape for p in parts]:
        raise ValueError(f"a round makes {shapes} of {[p.shape for p in parts]}")
    return _like(x, iter(rounds.final_states([c for p in _parts(after) for c in p.ravel()])))


def _parts(x: Any) -> list[Cells]:
    """The arrays of a tuple of tuples of arrays."""
    return [p for y in x for p in _parts(y)] if isinstance(x, tuple) else [cells_of(x)]


def _like(x: Any, cells: Iterator[Cell]) -> Any:
    """The same tuples, these cells in their arrays."""
    if isinstance(x, tuple):
        made = [_like(y, cells) for y in x]
        return type(x)(*made) if hasattr(x, "_fields") else tuple(made)
    shape = cells_of(x).shape
    out = np.empty(int(np.prod(shape)), dtype=object)
    for k in range(out.size):
        out[k] = next(cells)
    return Traced(out.reshape(shape))


def _cholesky(matrix: Any) -> Traced:
    """The lower triangle L with LLᵀ = A, written out."""
    a = Traced(cells_of(matrix))
    n = len(a)
    L = np.zeros((n, n), dtype=object)
    for j in range(n):
        for i in range(j, n):
            rest = a[i, j]
            for k in range(j):
                rest = rest - L[i, k] * L[j, k]
            L[i, j] = TRACE.sqrt(rest) if i == j else rest / L[j, j]
    return Traced(cells_of(L.tolist()))


TRACE: Any = _Namespace(
    __name__="recorded as C",
    linalg=SimpleNamespace(cholesky=_cholesky),
    ndim=lambda value: cells_of(value).ndim,
    shape=lambda value: cells_of(value).shape,
    pi=np.pi,
    inf=np.inf,
    nan=np.nan,
    eye=np.eye,
    full=np.full,
    array=lambda value, dtype=None: Traced(cells_of(value)),
    float64=lambda value: Traced(cells_of(value)),
    zeros=np.zeros,
    ones=np.ones,
    arange=np.arange,
    asarray=lambda value, dtype=None: Traced(cells_of(value)),
    zeros_like=lambda value, dtype=None: np.zeros(np.shape(cells_of(value))),
    ones_like=lambda value, dtype=None: np.ones(np.shape(cells_of(value))),
    reshape=lambda value, shape: Traced(cells_of(value).reshape(shape)),
    ravel=lambda value: Traced(cells_of(value).ravel()),
    copy=lambda value: Traced(cells_of(value).copy()),
    roll=lambda value, shift, axis=None: Traced(np.roll(cells_of(value), shift, axis)),
    clip=_clip,
    searchsorted=_searchsorted,
    repeated=_repeated,
    stack=_joined("stack"),
    concatenate=_joined("concatenate"),
    concat=_joined("concatenate"),
    hstack=lambda parts: Traced(np.hstack([cells_of(p) for p in parts])),
    vstack=lambda parts: Traced(np.vstack([cells_of(p) for p in parts])),
    dot=lambda a, b: _product(a, b),
    matmul=lambda a, b: _product(a, b),
    sum=partial(_fold, ADD),
    max=partial(_fold, MAXIMUM),
    min=partial(_fold, MINIMUM),
    amax=partial(_fold, MAXIMUM),
    amin=partial(_fold, MINIMUM),
    mean=_mean,
    **{name: _function(name) for name in (*OPERATIONS, *_REMAINDERS)},
)
"""The namespace that records."""
