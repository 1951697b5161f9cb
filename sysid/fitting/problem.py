"""Least-squares problems of a fit, their parameters, and the focus."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index

Data = Sequence[tuple[Array, Array]]
"""(u, y) of each record."""

HUGE = 1e100
"""What stands for an infinite error or slope: the solver rejects the step."""


class Focus(Enum):
    """What a fit minimises: one-step prediction errors or free-run simulation errors."""

    PREDICTION = "prediction"
    SIMULATION = "simulation"


class Initial(Enum):
    """Where a fit starts each experiment from."""

    AUTO = "auto"
    ZERO = "zero"
    ESTIMATED = "estimated"
    BACKCAST = "backcast"


@dataclass(frozen=True)
class Parameter:
    """One number of a structure: its name, unit and admissible range.

    Attributes:
        name: as users see and type it, e.g. ``a1`` or ``b1[omega_l,pwm_r]``.
        unit: unit, empty for a pure number.
        lower, upper: bounds, infinite when free.
        fixed: the value it is held at, or None when it is estimated.
    """

    name: str
    unit: str = ""
    lower: float = -np.inf
    upper: float = np.inf
    fixed: float | None = None


class Problem(ABC):
    """A least-squares problem min ½‖r(p)‖² that determines some entries of θ.

    p stacks θ[index] and then the initial states, experiment after experiment.

    Attributes:
        index: which entries of the structure's θ this problem determines.
        n_initial: how many initial states follow them in p.
        lengths: how many residuals each stretch of time contributes, in order; noise is not
            correlated across stretches.
        channels: output of each of these stretches.
        counts: which residuals count at all, (M,); None when all do. Those that do not are zero.
    """

    index: Index
    n_initial: int
    lengths: tuple[int, ...]
    channels: tuple[int, ...]
    counts: NDArray[np.bool_] | None = None

    @abstractmethod
    def residual(self, p: Array) -> Array:
        """Errors ε, shape (M,); huge but finite where p is inadmissible."""

    @abstractmethod
    def jacobian(self, p: Array) -> Array:
        """∂ε/∂p, shape (M, len(p))."""

    def initial_columns(self, p: Array) -> Array:
        """∂ε/∂(initial states), shape (M, n_initial): the last columns of the Jacobian."""
        return self.jacobian(p)[:, len(self.index) :]

    def given(self, theta: Array) -> "Problem":
        """This problem when the entries of θ outside ``index`` are those of ``theta``."""
        return self

    def initial_guess(self, theta: Array) -> Array:
        """p with θ's entries and zero initial states."""
        return np.concatenate([theta[self.index], np.zeros(self.n_initial)])
