"""What an odd log is: its file, what is typed first, and what has to come out."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class OddLog:
    """One odd log.

    Attributes:
        name: what is odd about it.
        make: (random numbers, folder) → the file to name on the command line.
        options: what a person types behind the file, for every command.
        fit_options: what they type behind it for ``fit`` alone.
        says: pattern that ``inspect`` has to print.
        fit_says: pattern that ``fit`` has to print.
        never: pattern that neither may print, beside a traceback.
        gains: (input, output) → static gain, or gain of the rate, in the file's units.
        code: exit code of ``fit``.
        inspected: exit code of ``inspect``.
        diagnosis: patterns of which ``diagnose`` has to print the first, and not the others.
        slow: whether it is left to the study.
        read_only: whether its file is odd and not its machine, so that the tests fit one structure
            to it; the study lets the fit choose.
    """

    name: str
    make: Callable[[np.random.Generator, Path], Path]
    options: str = ""
    fit_options: str = ""
    says: str = ""
    fit_says: str = ""
    never: str = "Traceback"
    gains: Mapping[tuple[str, str], float] = field(default_factory=dict)
    code: int = 0
    inspected: int = 0
    diagnosis: tuple[str, ...] = ()
    slow: bool = False
    read_only: bool = False
