"""Steps over sequences of numbers: plain ones in NumPy, as arrays of one are ten times slower."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.runners import floats

Step = Callable[[Any, Any, Any], tuple[Sequence[Any], Sequence[Any]]]
"""(namespace, entries of x, entries of u) → (entries of x⁺, entries of y)."""


def on_arrays(step: Step) -> Callable[[Array, Array], tuple[Array, Array]]:
    """(x, u) → (x⁺, y) in the namespace of its arrays; in NumPy on plain numbers."""

    def advance(x: Array, u: Array) -> tuple[Array, Array]:
        xp: Any = x.__array_namespace__()
        if xp is np:
            after, y = step(floats, x.tolist(), u.tolist())
            return np.array(after), np.array(y)
        after, y = step(xp, x, u)
        return xp.stack(after) if len(after) else x, xp.stack(y)

    return advance


def together(xp: Any, values: Sequence[Any]) -> Any:
    """The array of these values; of a run on plain numbers their list."""
    return list(values) if xp is floats else xp.stack(values)


def ahead(xp: Any, x: Any, h: Any, rate: Any) -> Any:
    """x + h rate."""
    return [v + h * d for v, d in zip(x, rate, strict=True)] if xp is floats else x + h * rate


def in_floats(value: Any) -> Any:
    """Constants for one run: (n, 1) becomes a list of floats, (1,) and () a float."""
    if isinstance(value, Mapping):
        return {name: in_floats(v) for name, v in value.items()}
    if isinstance(value, tuple):
        parts = map(in_floats, value)
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    array = np.asarray(value, dtype=np.float64)
    return (array[..., 0] if array.ndim else array).tolist()


def kept_inside(xp: Any) -> Callable[[Any, Any, Any], Any]:
    """(value, low, high) → the value inside its limits; what is no number goes to the lower one."""
    if xp is floats:
        return lambda v, low, high: high if v > high else v if v >= low else low
    if xp is np:
        return lambda v, low, high: np.fmin(np.fmax(v, low), high)
    return lambda v, low, high: xp.where(v > high, high, xp.where(v >= low, v, low))
