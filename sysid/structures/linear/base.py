"""What every linear structure can be asked: its transfer matrix, and its constant as an input."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from sysid.data.record import Array, Index
from sysid.errors import ModelError
from sysid.structures.base import NamedStructure
from sysid.structures.linear.transfer import TransferMatrix
from sysid.structures.special_runs import readout

REAL = 1e-9
"""Imaginary and real parts below it are zero."""


@dataclass(frozen=True)
class LinearStructure(NamedStructure):
    """y = G(q) u + H(q) e, with an offset: the coefficient of one more input, the constant 1.

    With that input starts, gradients, covariance and searches of orders need to know nothing of
    offsets.
    """

    @abstractmethod
    def transfer(self, theta: Array) -> TransferMatrix:
        """G(q)."""

    def held_near(self, theta: Array) -> Self:
        """The structure whose polynomials keep their lengths, whatever moves a little from θ."""
        return self

    def matrices(self, theta: Array) -> tuple[Array, Array, Array, Array]:
        """(A, B, C, D) of x⁺ = A x + B u, y = C x + D u with the states of ``step``."""
        return self.transfer(theta).matrices

    def step(self, theta: Array) -> Callable[[Array, Array], tuple[Array, Array]]:
        A, B, _, _ = self.matrices(theta)
        read = readout(self, theta)

        def advance(x: Array, u: Array) -> tuple[Array, Array]:
            return A @ x + B @ u, read(x, u)

        return advance

    def in_continuous_time(self, theta: Array, dt: float) -> tuple[Array, Array, Array, Array]:
        """(A, B, C, D) of ẋ = A x + B u, y = C x + D u with these samples where u is held."""
        from scipy.linalg import logm

        A, B, C, D = self.matrices(theta)
        n, nu = B.shape
        values = np.linalg.eigvals(A)
        if np.any((np.abs(values.imag) < REAL) & (values.real < REAL)):
            raise ModelError(
                f"{self.name} has poles at zero (a delay) or below, which no model in continuous "
                "time has; fit process or tf"
            )
        whole = np.eye(n + nu)
        whole[:n, :n], whole[:n, n:] = A, B
        power = np.real(logm(whole)) / dt
        return power[:n, :n], power[:n, n:], C, D

    @abstractmethod
    def with_constant(self, outputs: Sequence[bool]) -> Self:
        """The structure with the constant as its last input, in the equations of these outputs."""

    @abstractmethod
    def without_constant(self) -> Self:
        """Undo ``with_constant``."""

    @abstractmethod
    def constant_places(self) -> tuple[Index, Index]:
        """Entries of θ that are the constant's coefficients, and the outputs they belong to."""

    @abstractmethod
    def steady(self, theta: Array) -> tuple[Array, Array]:
        """A (ny, ny) and B (ny, nu) of A y = B u where nothing moves; infinite where y drifts."""


@readout.register
def _(s: LinearStructure, theta: Array) -> Callable[[Array, Array], Array]:
    """y = C x + D u; D is zero wherever a command acts a sample later."""
    _, _, C, D = s.matrices(theta)
    if not np.any(D):
        return lambda x, u: C @ x
    return lambda x, u: C @ x + D @ u
