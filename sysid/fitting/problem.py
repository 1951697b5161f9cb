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


@dataclass(frozen=True, eq=False)
class Allowed:
    """What parameters may be, (n,) each.

    Attributes:
        lower, upper: bounds.
        fixed: value where one is held, NaN elsewhere.
    """

    lower: Array
    upper: Array
    fixed: Array

    @staticmethod
    def by(parameters: Sequence[Parameter]) -> "Allowed":
        """What a table of parameters allows."""
        rows = [(p.lower, p.upper, np.nan if p.fixed is None else p.fixed) for p in parameters]
        return Allowed(*np.array(rows, dtype=np.float64).reshape(-1, 3).T)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which are estimated."""
        return np.isnan(self.fixed)

    @property
    def bounded(self) -> bool:
        return bool(np.isfinite([self.lower, self.upper]).any())

    def nearest(self, theta: Array) -> Array:
        """θ with the values held, within the bounds."""
        return np.clip(np.where(self.free, theta, self.fixed), self.lower, self.upper)


class LeastSquares(ABC):
    """A problem min ½‖r(p)‖², as solvers see it.

    Attributes:
        counts: which residuals count at all, (M,); None when all do. Those that do not are zero.
    """

    counts: NDArray[np.bool_] | None = None

    @abstractmethod
    def residual(self, p: Array) -> Array:
        """Errors ε, shape (M,); huge but finite where p is inadmissible."""

    @abstractmethod
    def jacobian(self, p: Array) -> Array:
        """∂ε/∂p, shape (M, len(p))."""


class Problem(LeastSquares):
    """A least-squares problem that determines some entries of a structure's θ.

    p stacks θ[index] and then the initial states, experiment after experiment.

    Attributes:
        index: which entries of the structure's θ this problem determines.
        n_initial: how many initial states follow them in p.
        lengths: how many residuals each stretch of time contributes, in order; noise is not
            correlated across stretches.
        channels: output of each of these stretches.
        scales: divisor of the errors of each output among ``channels``, in order.
    """

    index: Index
    n_initial: int
    lengths: tuple[int, ...]
    channels: tuple[int, ...]
    scales: Array | float = 1.0

    def initial_columns(self, p: Array) -> Array:
        """∂ε/∂(initial states), shape (M, n_initial): the last columns of the Jacobian."""
        return self.jacobian(p)[:, len(self.index) :]

    def given(self, theta: Array) -> "Problem":
        """This problem when the entries of θ outside ``index`` are those of ``theta``."""
        return self

    def initial_guess(self, theta: Array) -> Array:
        """p with θ's entries and zero initial states."""
        return np.concatenate([theta[self.index], np.zeros(self.n_initial)])

    def with_states(self, theta: Array) -> Array | None:
        """p with θ's entries and the initial states that suit it best; None where errors are
        linear in these, so that whoever asks finds them by one step."""
        return None


class Wrapped(Problem):
    """Another problem, changed in what a subclass says."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.index, self.n_initial = problem.index, problem.n_initial
        self.lengths, self.channels = problem.lengths, problem.channels
        self.counts = problem.counts

    def residual(self, p: Array) -> Array:
        return self.problem.residual(p)

    def jacobian(self, p: Array) -> Array:
        return self.problem.jacobian(p)

    def initial_columns(self, p: Array) -> Array:
        return self.problem.initial_columns(p)

    def initial_guess(self, theta: Array) -> Array:
        return self.problem.initial_guess(theta)

    def with_states(self, theta: Array) -> Array | None:
        return self.problem.with_states(theta)
