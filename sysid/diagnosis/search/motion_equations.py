"""Cores by one regression of measured motion, where a free run of the baseline follows nothing.

F(q) y(k + 1) = B(q) u(k + 1 − n) + further columns is linear in all its parameters.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index

LEAST_ROWS = 10
"""Rows a parameter of the regression, below which it says nothing."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Rows of a record on which it moves as the equation says.

    Attributes:
        y, u: measurements and commands, (N,).
        at: the rows k, (n,).
        beside: further columns, (n,) each.
    """

    y: Array
    u: Array
    at: Index
    beside: Sequence[Array]


@dataclass(frozen=True, eq=False)
class MotionEquation:
    """The equation by least squares.

    Attributes:
        theta: factors of past measurements, of past commands and of the further columns.
        squares: sum of squares that it leaves.
    """

    order: int
    theta: Array
    squares: float

    @property
    def core(self) -> tuple[float, Array, Array] | None:
        """Static gain, f_1 … f_n, and the further factors over F(1); None where it is unstable."""
        n = self.order
        f = -self.theta[:n]
        size = 1.0 + float(f.sum())
        if not size > 1e-9 or np.any(np.abs(np.roots([1.0, *f])) >= 1.0):
            return None
        return float(self.theta[n : 2 * n].sum()) / size, f, self.theta[2 * n :] / size


def counted_rows(weight: Array, at: Index, order: int) -> NDArray[np.bool_]:
    """Which rows k count together with their past and the row that follows."""
    return np.asarray(np.min([weight[at - j] for j in range(-1, order)], axis=0) > 0.0)


def motion_equation(records: Iterable[Motion], order: int, delay: int = 1) -> MotionEquation | None:
    """The equation of some records together; None where too few rows determine it.

    Args:
        delay: n, the samples until a command acts.
    """
    rows, rights = [], []
    for r in records:
        past = [r.y[r.at - j] for j in range(order)]
        past += [r.u[r.at + 1 - delay - j] for j in range(order)]
        rows.append(np.column_stack([*past, *r.beside]))
        rights.append(r.y[r.at + 1])
    A, b = np.concatenate(rows or [np.empty((0, 1))]), np.concatenate(rights or [np.empty(0)])
    if len(b) < LEAST_ROWS * A.shape[1]:
        return None
    theta = np.linalg.lstsq(A, b, rcond=None)[0]
    left = b - A @ theta
    return MotionEquation(order, theta, float(left @ left))
