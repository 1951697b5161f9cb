"""The bare references of the speed rows: NumPy and SciPy alone, no more than the arithmetic asks.

Nothing here comes from the package that is measured, and nothing here may be made faster or slower
without measuring every row anew: the committed ratios stand on these functions.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lfilter

Array = NDArray[np.float64]
ONE = np.ones(1)


def normal_equations(u: Array, y: Array, na: int, nb: int) -> Array:
    """ARX(na, nb, 1) from ΦᵀΦ θ = Φᵀy: [a…, b…] of A y = B u + e."""
    first = max(na, nb)
    lagged = [-y[first - k : len(y) - k] for k in range(1, na + 1)]
    lagged += [u[first - k : len(u) - k] for k in range(1, nb + 1)]
    phi = np.stack(lagged)
    return np.asarray(np.linalg.solve(phi @ phi.T, phi @ y[first:]))


def best_orders(u: Array, y: Array, highest: int) -> tuple[int, int]:
    """Orders (na, nb) of the ARX model that runs freely best on the last third of the record.

    Every pair from 1 to ``highest`` is fitted to the first two thirds by ``lstsq``.
    """
    cut = 2 * len(y) // 3
    errors = {}
    for na in range(1, highest + 1):
        for nb in range(1, highest + 1):
            first = max(na, nb)
            lagged = [-y[first - k : cut - k] for k in range(1, na + 1)]
            lagged += [u[first - k : cut - k] for k in range(1, nb + 1)]
            theta = np.linalg.lstsq(np.column_stack(lagged), y[first:cut], rcond=None)[0]
            run = lfilter(_delayed(theta[na:]), _monic(theta[:na]), u)
            errors[na, nb] = float(np.sum((y[cut:] - run[cut:]) ** 2))
    return min(errors, key=lambda pair: errors[pair])


def bare_fit(structure: str, u: Array, y: Array) -> Array:
    """ARMAX, OE or BJ of second order, nk = 1, by Levenberg–Marquardt on filtered gradients.

    The start is ARX with C = D = 1; initial conditions are zero.
    No bounds, no invertibility, no covariance.

    Args:
        structure: ``armax`` θ = (a, b, c), ``oe`` θ = (b, f) or ``bj`` θ = (b, c, d, f).
        u, y: the record, shapes (N,).

    Returns:
        θ, two numbers for each polynomial.
    """
    arx = normal_equations(u, y, 2, 2)
    a, b, zero = arx[:2], arx[2:], np.zeros(2)
    start, errors, slopes = {
        "armax": (np.concatenate([a, b, zero]), _armax_errors, _armax_slopes),
        "oe": (np.concatenate([b, a]), _oe_errors, _oe_slopes),
        "bj": (np.concatenate([b, zero, zero, a]), _bj_errors, _bj_slopes),
    }[structure]
    return np.asarray(
        least_squares(
            lambda p: errors(p, u, y),
            start,
            jac=lambda p: _twice_lagged(slopes(p, u, y)),
            method="lm",
            x_scale="jac",
        ).x
    )


Slopes = tuple[tuple[Array, tuple[int, int]], ...]
"""Signals and the two lags at which each stands in the Jacobian."""


def _monic(tail: Array) -> Array:
    return np.concatenate([ONE, tail])


def _delayed(tail: Array) -> Array:
    return np.concatenate([np.zeros(1), tail])


def _twice_lagged(slopes: Slopes) -> Array:
    out = np.zeros((2 * len(slopes), len(slopes[0][0])))
    rows = ((x, k) for x, lags in slopes for k in lags)
    for row, (x, k) in zip(out, rows, strict=True):
        row[k:] = x[: len(x) - k]
    return out.T


LAGS = (1, 2)


def _armax_errors(p: Array, u: Array, y: Array) -> Array:
    c = _monic(p[4:])
    return np.asarray(lfilter(_monic(p[:2]), c, y) - lfilter(_delayed(p[2:4]), c, u))


def _armax_slopes(p: Array, u: Array, y: Array) -> Slopes:
    c = _monic(p[4:])
    e = _armax_errors(p, u, y)
    return (lfilter(ONE, c, y), LAGS), (lfilter(-ONE, c, u), LAGS), (lfilter(-ONE, c, e), LAGS)


def _oe_errors(p: Array, u: Array, y: Array) -> Array:
    return np.asarray(y - lfilter(_delayed(p[:2]), _monic(p[2:]), u))


def _oe_slopes(p: Array, u: Array, y: Array) -> Slopes:
    f = _monic(p[2:])
    w = lfilter(_delayed(p[:2]), f, u)
    return (lfilter(-ONE, f, u), LAGS), (lfilter(ONE, f, w), LAGS)


def _bj_errors(p: Array, u: Array, y: Array) -> Array:
    v = y - lfilter(_delayed(p[:2]), _monic(p[6:]), u)
    return np.asarray(lfilter(_monic(p[4:6]), _monic(p[2:4]), v))


def _bj_slopes(p: Array, u: Array, y: Array) -> Slopes:
    c, d, f = _monic(p[2:4]), _monic(p[4:6]), _monic(p[6:])
    cf = np.convolve(c, f)
    w = lfilter(_delayed(p[:2]), f, u)
    v = y - w
    return (
        (lfilter(-d, cf, u), LAGS),
        (lfilter(-ONE, c, lfilter(d, c, v)), LAGS),
        (lfilter(ONE, c, v), LAGS),
        (lfilter(d, cf, w), LAGS),
    )


Simulated = Callable[[Array, Array], tuple[Array, Array]]


def plain_steps(step: Simulated, state: Array, u: Array, samples: int) -> Array:
    """A plant stepped ``samples`` times under one constant input, and nothing else."""
    for _ in range(samples):
        state, _ = step(state, u)
    return state
