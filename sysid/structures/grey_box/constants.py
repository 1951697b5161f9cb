"""Physical constants of grey boxes, and ladders of constants that the data have to pay for."""

from dataclasses import dataclass
from typing import Any

import numpy as np

Signal = Any
"""An array of the namespace in use (numpy or jax.numpy)."""


@dataclass(frozen=True)
class Constant:
    """One physical constant of a grey box.

    Attributes:
        name: as users see it; the output's name follows in brackets where every output has one.
        unit: unit; ``{u}`` and ``{y}`` stand for those of the first input and output.
        value: what it is held at when it is not estimated, and where searches begin.
        lower, upper: physical bounds.
        free: whether it is estimated unless something else is asked for.
        spread: starts vary it by about this factor (a constant of either sign: by this share).
        each: whether every output has its own.
        jumps: whether runs change by jumps or kinks with it, so that slopes do not give its error.
    """

    name: str
    unit: str = ""
    value: float = 1.0
    lower: float = -np.inf
    upper: float = np.inf
    free: bool = True
    spread: float = 3.0
    each: bool = False
    words: str = ""
    jumps: bool = False


@dataclass(frozen=True)
class Rung:
    """One step of a ladder: constants that are estimated only where held-out data pay for them."""

    words: str
    names: tuple[str, ...]
