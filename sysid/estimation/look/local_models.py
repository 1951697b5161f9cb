"""Models of a spectrum in a window of its lines: local polynomials, and local rational functions.

    Y(k+r) = (N(r) U(k+r) + T(r))/D(r) + V(k+r),   N, T of degree 2,   D = 1 or 1 + d r

T is the transient of a record that is no whole period, so that it is estimated instead of leaking
into the response N(0); what is left is the noise, whose variance gives the band (Schoukens,
Vandersteen, Barbé & Pintelon 2009, IEEE Trans. Instrum. Meas. 58, 786). A pole of D follows a
resonance that is narrower than the window (McKelvey & Guérin 2012, 16th IFAC SYSID, 470): each
output has its own, found by reweighing (Sanathanan & Koerner 1963) and then Gauss-Newton steps.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array

DEGREE = 2
"""Of the polynomials."""

SPARE = 6
"""Lines more than there are unknowns; two more where these are not linear."""

SINGULAR = 1e-6
"""Directions of a window's columns below this share of the strongest are not there."""

REWEIGHED, ROUNDS = 2, 3
"""Rounds with the last denominator for weight, and all of them: twice as many err as much, and
their bands hold the truth less often."""

NEAR = 1e-6
"""A denominator is not trusted below this size on a line."""

CHOICE = 1
"""Complex degrees of freedom that choosing the better of two models takes from it: without, bands
of what was chosen hold the truth a per cent less often."""

Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class LocalModel:
    """Responses at one frequency.

    Attributes:
        value: Ĝ, (ny, nu).
        spread: its variance over the noise's, (ny, nu); infinite where it is not known.
        left: squared remainders, (ny,).
        unseen: the same of each line where the others are fitted, (ny,).
        freedom: complex degrees that the remainders have.
        lines: in the window.
        power: mean square of the outputs' lines, (ny,).
    """

    value: Complex
    spread: Array
    left: Array
    unseen: Array
    freedom: int
    lines: int
    power: Array


def half_width(nu: int, rational: bool) -> int:
    """Lines of a window on each side."""
    return ((DEGREE + 1) * (nu + 1) + SPARE + 3 * rational) // 2


def local_model(U: Complex, Y: Complex, x: Array, rational: bool) -> LocalModel:
    """The model of a window.

    Args:
        U, Y: its lines, (n, nu) and (n, ny).
        x: their places, 0 at the frequency asked for, within ± 1.
    """
    nu, ny = U.shape[1], Y.shape[1]
    steps = x[:, None] ** np.arange(DEGREE + 1)
    K = np.hstack([*(U[:, [j]] * steps for j in range(nu)), steps.astype(np.complex128)])
    places = np.arange(nu) * (DEGREE + 1)
    value, spread = np.zeros((ny, nu), dtype=np.complex128), np.full((ny, nu), np.inf)
    left, unseen = np.zeros(ny), np.zeros(ny)
    unknowns = 0
    for i in range(ny):
        theta, e, inverse, leverage = _rational(K, Y[:, i], x) if rational else _linear(K, Y[:, i])
        squares = np.abs(e) ** 2
        left[i] = squares.sum()
        unseen[i] = np.sum(squares / np.maximum(1.0 - leverage, 1e-3) ** 2)
        rank = round(float(leverage.sum()))
        unknowns = max(unknowns, rank)
        if rank == len(theta):
            value[i] = theta[places]
            spread[i] = np.sum(np.abs(inverse[places]) ** 2, axis=1)
    freedom = len(x) - unknowns - CHOICE * rational
    return LocalModel(value, spread, left, unseen, freedom, len(x), np.mean(np.abs(Y) ** 2, axis=0))


def _linear(K: Complex, y: Complex) -> tuple[Complex, Complex, Complex, Array]:
    """θ of least squares, the errors, K⁺, and the leverage of each line."""
    size = np.maximum(np.linalg.norm(K, axis=0), 1e-300)
    left, values, right = np.linalg.svd(K / size, full_matrices=False)
    known = values > SINGULAR * values[0]
    inverse = (right[known].conj().T / values[known]) @ left[:, known].conj().T / size[:, None]
    theta = inverse @ y
    leverage = np.sum(np.abs(left[:, known]) ** 2, axis=1)
    return theta, y - K @ theta, inverse, leverage


def _rational(K: Complex, y: Complex, x: Array) -> tuple[Complex, Complex, Complex, Array]:
    """The same of the rational model, whose slopes stand for K; d is the last of θ."""
    theta = np.append(_linear(K, y)[0], 0.0)
    best, least = theta, np.inf
    for k in range(ROUNDS):
        D, N = 1.0 + theta[-1] * x, K @ theta[:-1]
        if k < REWEIGHED:
            theta = _linear(np.column_stack([K, -x * y]) / D[:, None], y / D)[0]
        else:
            theta = theta + _linear(_slopes(K, N, D, x), y - N / D)[0]
        D = 1.0 + theta[-1] * x
        if np.min(np.abs(D)) < NEAR:
            break
        cost = float(np.sum(np.abs(y - K @ theta[:-1] / D) ** 2))
        if cost < least:
            best, least = theta, cost
        elif k >= REWEIGHED:
            break
        if k + 1 >= REWEIGHED:
            theta = best
    D, N = 1.0 + best[-1] * x, K @ best[:-1]
    _, _, inverse, leverage = _linear(_slopes(K, N, D, x), y)
    return best, y - N / D, inverse, leverage


def _slopes(K: Complex, N: Complex, D: Complex, x: Array) -> Complex:
    return np.column_stack([K, -x * N / D]) / D[:, None]
