"""The same C in single precision: types, literals and functions of ``float``."""

import math
import re
from dataclasses import dataclass

import numpy as np

from sysid.structures.model import Model
from sysid.structures.motion import time_constants


@dataclass(frozen=True)
class Precision:
    """What a self-test in C allows, in parts of the range of each signal.

    Attributes:
        double: whether numbers have 8 bytes, else 4.
        plant: error of the plant, which carries every rounding on.
        function: error of a law's step function.
        loop: error of the closed loop.
        slack: share of the time by which two instants that are one may differ by rounding.
        reason: why more is allowed than usual, in a sentence; empty where it is not.
    """

    double: bool
    plant: float
    function: float
    loop: float
    slack: float
    reason: str = ""


DOUBLE = Precision(True, plant=1e-9, function=1e-12, loop=1e-9, slack=1e-9)
"""Rounding is 1e-16 an operation; plant and loop carry it on through poles near the unit circle."""

_USUAL = 1e-4
"""What single precision keeps where no slow pole carries rounding on."""

_ROUNDING = 2.0**-24
"""Largest relative error of one rounding to single precision."""

_ROUNDINGS = 16.0
"""Roundings of a step that a slow mode sums up, generously counted."""


def single(model: Model) -> Precision:
    """What single precision can keep for a plant.

    A mode that forgets in n samples sums up n roundings: n = 1/(1 − e^(−dt/τ)) for its time
    constant τ.
    """
    modes = time_constants(model.structure, model.theta)
    slowest = max((float(t) for t in modes if math.isfinite(t)), default=0.0)
    kept = 1.0 / -math.expm1(-1.0 / slowest) if slowest > 0.0 else 1.0
    bound = _ROUNDINGS * _ROUNDING * kept
    if bound <= _USUAL:
        return Precision(False, plant=_USUAL, function=_USUAL, loop=_USUAL, slack=1e-6)
    reason = (
        f"The plant's slowest mode ({slowest * model.dt:.3g} s) sums up the roundings of "
        f"{kept:.3g} steps, so single precision keeps {bound:.2g} of the range instead of "
        f"{_USUAL:g}."
    )
    return Precision(False, bound, _USUAL, bound, slack=1e-6, reason=reason)


_TEXT = re.compile(r'("(?:[^"\\]|\\.)*"|/\*.*?\*/)', re.DOTALL)
"""Strings and comments, which stay."""
_LITERAL = re.compile(r"(?<![\w.])(\d+\.\d*(?:e[-+]?\d+)?|\d+e[-+]?\d+)(?![\w.])")
_CALL = re.compile(
    r"\b(acos|asin|atan2?|ceil|cosh?|exp|expm1|fabs|floor|fmod|hypot|log|log10|log1p|pow"
    r"|sinh?|sqrt|tanh?)\("
)
_SMALLEST = 1.17549435e-38
"""The smallest normal number of single precision [1]."""


def in_single(source: str) -> str:
    """C written for ``double`` as C for ``float``."""
    parts = _TEXT.split(source)
    return "".join(part if k % 2 else _single(part) for k, part in enumerate(parts))


def _single(code: str) -> str:
    code = re.sub(r"\bdouble\b", "float", code)
    code = _LITERAL.sub(lambda m: _literal(float(m[1])), code)
    code = re.sub(r"\bHUGE_VAL\b", "HUGE_VALF", code)
    return _CALL.sub(r"\1f(", code)


def _literal(value: float) -> str:
    """A literal; what is too small for single precision does not become zero, nor a divisor."""
    if value and value < _SMALLEST:
        value = _SMALLEST
    with np.errstate(over="ignore"):
        single = np.float32(value)
    if np.isinf(single):
        return "HUGE_VALF"
    mantissa, e, exponent = str(single).partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}{e}{exponent}f"
