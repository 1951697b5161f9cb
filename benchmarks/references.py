"""The plainest references of the speed study: NumPy and SciPy alone, written to be fast.

Nothing here comes from the package that is measured. ``Row`` is also the common yardstick: every
contestant's answer is turned into rows, and their errors are computed here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lfilter

Array = NDArray[np.float64]
ONE = np.ones(1)
BLOCK = 16384
TOLERANCE = 1e-9
"""Tolerance on cost and step of the bare search: that of the search it is compared with."""


@dataclass(frozen=True, eq=False)
class Row:
    """One output of A y = Σ (B_j/F_j) u_j + (C/D) e, polynomials in ascending powers of q⁻¹.

    Attributes:
        A, C, D: monic.
        B: one per input, leading zeros for the delay.
        F: one per input, monic; empty where all are 1.
    """

    A: Array
    B: tuple[Array, ...]
    C: Array = field(default_factory=lambda: ONE)
    D: Array = field(default_factory=lambda: ONE)
    F: tuple[Array, ...] = ()

    def forced(self, u: Array) -> Array:
        """Σ (B_j/F_j) u_j from rest."""
        total = np.zeros(len(u))
        for j, b in enumerate(self.B):
            total += lfilter(b, self.F[j] if self.F else ONE, u[:, j])
        return total

    def free_run(self, u: Array) -> Array:
        """Output without noise, from rest: (1/A) Σ (B_j/F_j) u_j."""
        return np.asarray(lfilter(ONE, self.A, self.forced(u)))

    def output(self, u: Array, e: Array) -> Array:
        """Output with white noise ``e``."""
        return np.asarray(lfilter(ONE, self.A, self.forced(u) + lfilter(self.C, self.D, e)))

    def one_step(self, u: Array, y: Array) -> Array:
        """Prediction errors ε = (D/C)(A y − Σ (B_j/F_j) u_j), from rest."""
        return np.asarray(lfilter(self.D, self.C, lfilter(self.A, ONE, y) - self.forced(u)))


def monic(tail: Array) -> Array:
    """1 + Σ tail_k q⁻ᵏ."""
    return np.concatenate([ONE, tail])


def delayed(tail: Array, delay: int) -> Array:
    """q^−delay Σ tail_k q⁻ᵏ."""
    return np.concatenate([np.zeros(delay), tail])


def accumulate_arx(u: Array, y: Array, na: int, nb: int) -> Array:
    """ARX(na, nb, 1) by accumulating ΦᵀΦ and Φᵀy in blocks of rows: [a…, b…]."""
    n, first = na + nb, max(na, nb)
    normal, right = np.zeros((n, n)), np.zeros(n)
    for low in range(first, len(y), BLOCK):
        high = min(low + BLOCK, len(y))
        phi = np.column_stack(
            [-y[low - k : high - k] for k in range(1, na + 1)]
            + [u[low - k : high - k] for k in range(1, nb + 1)]
        )
        normal += phi.T @ phi
        right += phi.T @ y[low:high]
    return np.asarray(np.linalg.solve(normal, right))


Residual = Callable[[Array], Array]


def bare_search(structure: str, u: Array, y: Array, start: Array) -> tuple[Array, float]:
    """SciPy's Levenberg-Marquardt on filtered gradients and nothing else, second order, nk = 1.

    Initial conditions are zero, residuals start with the record; no bounds, no test for
    invertibility, no covariance.

    Args:
        structure: ``armax`` (a, b, c), ``oe`` (b, f) or ``bj`` (b, c, d, f): two of each.
        u, y: the record, shapes (N,).
        start: θ to start from, in that order.

    Returns:
        θ and ½ Σ ε².
    """
    residual, jacobian = {"armax": _armax, "oe": _oe, "bj": _bj}[structure](u, y)
    found = least_squares(
        residual,
        start,
        jac=jacobian,
        method="lm",
        x_scale="jac",
        ftol=TOLERANCE,
        xtol=TOLERANCE,
        gtol=1e-14,
    )
    return found.x, float(found.cost)


def _fill(out: Array, x: Array, lags: Sequence[int], at: int) -> None:
    for row, k in enumerate(lags, at):
        out[row, k:] = x[: len(x) - k]


def _armax(u: Array, y: Array) -> tuple[Residual, Residual]:
    def residual(p: Array) -> Array:
        C = monic(p[4:])
        return np.asarray(lfilter(monic(p[:2]), C, y) - lfilter(delayed(p[2:4], 1), C, u))

    def jacobian(p: Array) -> Array:
        C = monic(p[4:])
        out = np.zeros((6, len(y)))
        _fill(out, lfilter(ONE, C, y), (1, 2), 0)
        _fill(out, lfilter(-ONE, C, u), (1, 2), 2)
        _fill(out, lfilter(-ONE, C, residual(p)), (1, 2), 4)
        return out.T

    return residual, jacobian


def _oe(u: Array, y: Array) -> tuple[Residual, Residual]:
    def residual(p: Array) -> Array:
        return y - lfilter(delayed(p[:2], 1), monic(p[2:]), u)

    def jacobian(p: Array) -> Array:
        F = monic(p[2:])
        out = np.zeros((4, len(y)))
        _fill(out, lfilter(-ONE, F, u), (1, 2), 0)
        _fill(out, lfilter(ONE, F, y - residual(p)), (1, 2), 2)
        return out.T

    return residual, jacobian


def _bj(u: Array, y: Array) -> tuple[Residual, Residual]:
    def residual(p: Array) -> Array:
        v = y - lfilter(delayed(p[:2], 1), monic(p[6:]), u)
        return np.asarray(lfilter(monic(p[4:6]), monic(p[2:4]), v))

    def jacobian(p: Array) -> Array:
        C, D, F = monic(p[2:4]), monic(p[4:6]), monic(p[6:])
        CF = np.convolve(C, F)
        w = lfilter(delayed(p[:2], 1), F, u)
        v = y - w
        out = np.zeros((8, len(y)))
        _fill(out, lfilter(-D, CF, u), (1, 2), 0)
        _fill(out, lfilter(-ONE, C, lfilter(D, C, v)), (1, 2), 2)
        _fill(out, lfilter(ONE, C, v), (1, 2), 4)
        _fill(out, lfilter(D, CF, w), (1, 2), 6)
        return out.T

    return residual, jacobian
