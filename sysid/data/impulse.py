"""A long regression (ARX of high order), the basis of the checks that need no model.

Every record is regressed, output by output, on its own past and on the inputs around now:

    y_j(t) = Σ_i Σ_k a_jik y_i(t−k) + Σ_i Σ_k b_jik u_i(t−k) + c + e_j(t),   k = first … last

With enough lags e is white whatever colours the noise (Ljung 1999, §4.2 and §10.3), so the
ordinary least-squares standard errors hold; the leading zeros of b are the plant's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.linalg import solve_toeplitz
from scipy.special import fdtrc

from sysid.data.record import Array, Record
from sysid.errors import DataError

MAX_SAMPLES = 20_000
"""Enough samples for every answer here; longer data are cut to their first part."""
ORDERS = (2, 4, 8, 12, 16)
"""Numbers of lags that are tried."""


@dataclass(frozen=True, eq=False)
class LongRegression:
    """The fitted regression.

    Attributes:
        a: coefficients of past outputs, shape (ny, ny, n): [output, of output, lag − 1].
        b: coefficients of the inputs, shape (ny, nu, n_lags).
        b_error: their standard errors; infinite where the data cannot distinguish them.
        lags: the input lags, shape (n_lags,); negative ones are in the future.
        variance: variance of e per output, shape (ny,).
        covariance: (XᵀX)⁻¹ for b alone, shape (nu·n_lags, nu·n_lags); times the variance.
        samples: number of equations.
    """

    a: Array
    b: Array
    b_error: Array
    lags: NDArray[np.int64]
    variance: Array
    covariance: Array
    samples: int

    def step_response(self, samples: int) -> Array:
        """Response of each output to a unit step in each input, shape (samples, ny, nu)."""
        ny, nu, _ = self.b.shape
        n = self.a.shape[2]
        y = np.zeros((samples + n, ny, nu))
        causal = self.lags >= 0
        lags, b = self.lags[causal], self.b[:, :, causal]
        for t in range(samples):
            past = y[t : t + n][::-1]  # past[k − 1] is y(t − k)
            now = np.einsum("jik,kiu->ju", self.a, past)
            y[t + n] = now + b[:, :, lags <= t].sum(axis=2)
        return y[n:]


def long_regression(
    records: Sequence[Record],
    order: int,
    first: int = 0,
    last: int | None = None,
    far: Sequence[int] | NDArray[np.int64] = (),
) -> LongRegression:
    """Fit the regression with ``order`` output lags and input lags ``first`` … ``last``.

    Each record has its own constant c. Directions of the input lags in which the data carry no
    information (collinear inputs, too few harmonics) get a zero coefficient and infinite error.

    Args:
        records: experiments with the same channels.
        order: number of output lags n.
        first: first input lag; negative to look into the future.
        last: last input lag; None for ``order``.
        far: further input lags, where the inputs act after a long delay.
    """
    last = order if last is None else last
    lags = np.union1d(np.arange(first, last + 1), np.asarray(far, dtype=np.int64))
    X, Y, groups = regressors(records, order, lags)
    count, width = X.shape
    free = count - width - groups
    if free < max(10, width // 2):
        raise DataError(f"{records[0].name}: {count} samples are too few for {width} coefficients")
    scale = np.sqrt(np.mean(X**2, axis=0))
    scale[scale == 0] = 1.0
    X /= scale
    values, vectors = np.linalg.eigh(X.T @ X)
    # 1e-11 of the largest eigenvalue is where round-off of the products (1e-16 × width) drowns it.
    known = values > 1e-11 * values[-1]
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T
    theta = inverse @ (X.T @ Y)
    residual = Y - X @ theta
    variance = np.sum(residual**2, axis=0) / free
    blind = np.sum(vectors[:, ~known] ** 2, axis=1) > 1e-6
    inputs = slice(records[0].ny * order, None)
    error = np.sqrt(np.outer(variance, np.diag(inverse)[inputs])) / scale[inputs]
    error[:, blind[inputs]] = np.inf
    theta = theta / scale[:, None]
    ny, nu = records[0].ny, records[0].nu
    return LongRegression(
        a=theta[: ny * order].T.reshape(ny, ny, order),
        b=theta[inputs].T.reshape(ny, nu, len(lags)),
        b_error=error.reshape(ny, nu, len(lags)),
        lags=lags,
        variance=variance,
        covariance=inverse[inputs, inputs] / np.outer(scale[inputs], scale[inputs]),
        samples=count,
    )


def regressors(
    records: Sequence[Record], order: int, lags: NDArray[np.int64]
) -> tuple[Array, Array, int]:
    """The regression's columns and targets with each record's means removed.

    Returns:
        X, shape (n, ny·order + nu·len(lags)), outputs' lags first; Y, shape (n, ny); and the number
        of records used (each has spent one degree of freedom on its mean).
    """
    blocks, targets = [], []
    back, ahead = max(order, int(lags[-1])), max(-int(lags[0]), 0)
    for part in at_most(records, MAX_SAMPLES):
        stop = len(part) - ahead
        if stop <= back + 1:
            continue
        past = [part.y[back - k : stop - k, j] for j in range(part.ny) for k in range(1, order + 1)]
        around = [part.u[back - k : stop - k, i] for i in range(part.nu) for k in lags]
        columns, target = np.array([*past, *around]), part.y[back:stop]
        columns -= columns.mean(axis=1, keepdims=True)
        blocks.append(columns.T)
        targets.append(target - target.mean(axis=0))
    if not blocks:
        width = records[0].ny * order + records[0].nu * len(lags)
        return np.empty((0, width)), np.empty((0, records[0].ny)), 0
    return np.vstack(blocks), np.vstack(targets), len(blocks)


def chosen_order(
    records: Sequence[Record],
    far: Sequence[int] | NDArray[np.int64] = (),
) -> int:
    """The number of lags of ``ORDERS`` of lowest BIC; 0 when there are too few samples for any.

    ``far``: further input lags in every regression.
    """
    lowest, best_order = np.inf, 0
    for order in ORDERS:
        try:
            fit = long_regression(records, order, far=far)
        except DataError:
            break
        score = bic(fit, fit.samples)
        if score < lowest:
            lowest, best_order = score, order
    return best_order


def bic(fit: LongRegression, samples: int) -> float:
    """N ln V + n ln N summed over the outputs."""
    spread = np.maximum(fit.variance, np.finfo(float).tiny)
    return float(samples * np.log(spread).sum() + (fit.a.size + fit.b.size) * np.log(samples))


def chance(fit: LongRegression, j: int, index: NDArray[np.int64]) -> float:
    """p-value of "these coefficients of output j are all zero"."""
    value, rank = wald(fit, j, index)
    free = fit.samples - fit.a[j].size - fit.b[j].size
    return float(fdtrc(max(rank, 1), free, value / max(rank, 1)))


def wald(fit: LongRegression, j: int, index: NDArray[np.int64]) -> tuple[float, int]:
    """bᵀ (σ² C)⁺ b and its rank for the coefficients ``index`` of output ``j``."""
    b = fit.b[j].ravel()[index]
    c = fit.covariance[np.ix_(index, index)]
    scale = np.sqrt(np.maximum(np.diag(c), 0))
    usable = scale > 0
    if fit.variance[j] <= 0 or not usable.any():
        return 0.0, 0
    b, scale = b[usable] / scale[usable], scale[usable]
    c = c[np.ix_(usable, usable)] / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(c)
    known = values > 1e-9 * values[-1]
    projected = vectors[:, known].T @ b
    return float(np.sum(projected**2 / values[known]) / fit.variance[j]), int(known.sum())


def clipped(e: Array) -> Array:
    """Errors cut off at three robust standard deviations, so that jumps count no more."""
    spread = 3.0 * 1.4826 * float(np.median(np.abs(e - np.median(e))))
    return np.clip(e, -spread, spread) if spread > 0.0 else e


def orthonormal(X: Array, least: float) -> tuple[Array, Array]:
    """Orthonormal basis Q of the columns' span, and M with Q = X M; M Mᵀ inverts XᵀX on it.

    Directions with less than ``least`` of the strongest one's power are left out, columns at
    length 1.
    """
    size = lengths(X)
    unit = X / size
    values, vectors = np.linalg.eigh(unit.T @ unit)
    known = values > least * values[-1]
    turned = vectors[:, known] / np.sqrt(values[known])
    return np.asarray(unit @ turned), turned / size[:, None]


def least_squares(X: Array, Y: Array, rcond: float = 1e-12) -> tuple[Array, Array]:
    """Parameters and remainders of a regression with columns at length 1."""
    size = lengths(X)
    theta = np.linalg.lstsq(X / size, Y, rcond=rcond)[0]
    return np.asarray((theta.T / size).T), np.asarray(Y - X / size @ theta)


def lengths(X: Array) -> Array:
    """Euclidean length of each column, hardly above 0 where it is zero."""
    return np.asarray(np.maximum(np.sqrt(np.sum(X**2, axis=0)), 1e-300))


def correlation(a: Array, b: Array, most: int) -> Array:
    """Σ a(t) b(t−k) for k = 0 … most, by FFT."""
    size = fft.next_fast_len(len(a) + most + 1, real=True)
    spectrum = fft.rfft(a, size) * np.conj(fft.rfft(b, size))
    return np.asarray(fft.irfft(spectrum, size)[: most + 1])


def whitener(parts: Sequence[Array], order: int, ridge: float) -> Array | None:
    """1 + α₁q⁻¹ + … of the autoregression of signals (Yule–Walker), None for a constant.

    Args:
        parts: the signals, (N,) each.
        ridge: power added to the signals, relative to their own.
    """
    r = np.asarray(sum(correlation(x, x, order) for x in parts))
    if r[0] <= 0.0 or order < 1:
        return None
    alpha = solve_toeplitz(np.append(r[0] * (1.0 + ridge), r[1:order]), r[1 : order + 1])
    return np.concatenate([[1.0], -alpha])


def at_most(records: Sequence[Record], samples: int) -> list[Record]:
    """The first so many samples of all records."""
    kept: list[Record] = []
    for r in records:
        if samples > 0:
            kept.append(r.rows(0, samples))
            samples -= len(kept[-1])
    return kept
