"""Single values in a step: plain numbers in NumPy, where arrays of one are ten times slower."""

from collections.abc import Sequence
from typing import Any

import numpy as np

Limits = tuple[tuple[float, float], ...]
"""Lowest and highest value of each output in free run."""


def kept_inside(xp: Any, value: Any, low: float, high: float) -> Any:
    """A value inside its limits; what is no number goes to the lower one."""
    if xp is np:
        return high if value > high else value if value >= low else low
    return xp.where(value > high, high, xp.where(value >= low, value, low))


def together(xp: Any, values: Sequence[Any]) -> Any:
    """The array of these values."""
    return np.array(values) if xp is np else xp.stack(values)
