"""The array namespace of a single run: NumPy's names on plain numbers.

Laws and steps are written over a namespace ``xp``, so that a batch can run the same text on
``jax.numpy``. A single run has one number where a batch has an array, and NumPy needs ten times
longer for one number than ``math`` does. The functions used most are therefore those of ``math``
here (the same on every processor, to the last bit); everything else, and every array, is NumPy's.
"""

import math
from bisect import bisect_right
from collections.abc import Callable
from typing import Any

import numpy as np

float64 = float
array = np.array
inf = math.inf
nan = math.nan

_LARGEST_EXPONENT = 709.0
"""math.exp refuses what NumPy calls infinite."""


def __getattr__(name: str) -> Any:
    return getattr(np, name)


def _of_one(plain: Callable[[float], Any], whole: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def of(x: Any) -> Any:
        """By ``math`` of a plain number, by NumPy of anything else."""
        return plain(x) if type(x) is float else whole(x)

    return of


def _of_two(
    plain: Callable[[float, float], float], whole: Callable[[Any, Any], Any]
) -> Callable[[Any, Any], Any]:
    def of(x: Any, y: Any) -> Any:
        """By ``math`` of plain numbers, by NumPy of anything else."""
        return plain(x, y) if type(x) is float and type(y) is float else whole(x, y)

    return of


sin = _of_one(math.sin, np.sin)
cos = _of_one(math.cos, np.cos)
tan = _of_one(math.tan, np.tan)
tanh = _of_one(math.tanh, np.tanh)
abs = _of_one(math.fabs, np.abs)
isnan = _of_one(math.isnan, np.isnan)
hypot = _of_two(math.hypot, np.hypot)
arctan2 = _of_two(math.atan2, np.arctan2)


def exp(x: Any) -> Any:
    """eˣ; infinite where it is too large for a number."""
    return math.exp(x) if type(x) is float and x < _LARGEST_EXPONENT else np.exp(x)


def expm1(x: Any) -> Any:
    """eˣ − 1, without loss of digits at 0; infinite where it is too large for a number."""
    return math.expm1(x) if type(x) is float and x < _LARGEST_EXPONENT else np.expm1(x)


def sign(x: Any) -> Any:
    """−1, 0 or 1 as x; NaN where it is NaN."""
    if type(x) is float:
        return math.copysign(1.0, x) if x < 0.0 or x > 0.0 else x
    return np.sign(x)


def sqrt(x: Any) -> Any:
    """√x; NaN below zero."""
    return math.sqrt(x) if type(x) is float and x >= 0 else np.sqrt(x)


def floor(x: Any) -> Any:
    """The largest whole number that is not above ``x``."""
    return float(math.floor(x)) if type(x) is float else np.floor(x)


def logical_not(x: Any) -> Any:
    """The contrary of a truth value."""
    return not x if type(x) is bool else np.logical_not(x)


def minimum(a: Any, b: Any) -> Any:
    """The smaller of both; NaN where one is NaN."""
    if type(a) is float and type(b) is float:
        return a if a <= b or a != a else b
    return np.minimum(a, b)


def maximum(a: Any, b: Any) -> Any:
    """The larger of both; NaN where one is NaN."""
    if type(a) is float and type(b) is float:
        return a if a >= b or a != a else b
    return np.maximum(a, b)


def clip(x: Any, low: Any, high: Any) -> Any:
    """``x`` cut to [low, high]; NaN stays NaN."""
    if type(x) is type(low) is type(high) and (type(x) is float or type(x) is int):
        x = low if x < low else x
        return high if x > high else x
    return minimum(maximum(x, low), high)


def searchsorted(points: Any, x: Any, side: Any = "left") -> Any:
    """How many of these rising points lie below ``x``, or at it where ``side`` is right."""
    if type(x) is float and type(points) is list and side == "right":
        return bisect_right(points, x)
    return np.searchsorted(points, x, side)


def where(condition: Any, one: Any, other: Any) -> Any:
    """``one`` where the condition holds, else ``other``.

    Raises:
        TypeError: the condition is a number, as ``~`` makes of a Python truth value.
    """
    if condition is True:
        return one
    if condition is False:
        return other
    if np.asarray(condition).dtype != bool:
        raise TypeError("the condition of where is no truth value: use xp.logical_not, not ~")
    return np.where(condition, one, other) if np.ndim(condition) else one if condition else other
