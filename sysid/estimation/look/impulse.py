"""Impulse response by regularised least squares, its length no question of order.

    y_i(t) = Σ_j Σ_{k=0}^{n−1} g_ijk u_j(t−k) + c + e(t),   g_ij ~ N(0, η P(α, …))

With the covariance P of a response that decays, the posterior mean is the estimate, its covariance
the band; η, α and the noise are those of the highest marginal likelihood. P is TC (tuned and
correlated), DC (diagonal and correlated) or SS (stable spline):

    TC  α^max(k,l)      DC  α^((k+l)/2) ρ^|k−l|      SS  α^(k+l+max)/2 − α^(3 max)/6

Source: Chen, Ohlsson & Ljung (2012), Automatica 48, 1525; the marginal likelihood from the R of one
QR decomposition (Chen & Ljung 2013, Automatica 49, 2213).

Where e is not white, an autoregression of the first fit's errors filters u and y, which leaves g as
it is and makes e white, and the fit is repeated: the bands of the first would be too narrow.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.filtering import lfilter
from sysid.data.impulse import whitener
from sysid.data.record import Array, Record
from sysid.errors import DataError

MOST = 120
"""Coefficients of a response at most."""

LONGEST = 20_000
"""Samples that are used."""

TRIES = 60
"""Evaluations of the marginal likelihood a hyperparameter."""

ORDERS = (1, 2, 4, 8)
"""Of the autoregression that makes errors white."""

TINY = 1e-10
"""Added to the diagonal of P, in shares of its largest entry."""


KERNELS: Mapping[str, Callable[[Array, Array, float, float], Array]] = {
    "TC": lambda k, m, a, rho: a ** np.maximum(k, m),
    "DC": lambda k, m, a, rho: a ** (0.5 * (k + m)) * rho ** abs(k - m),
    "SS": lambda k, m, a, rho: (
        a ** (k + m + np.maximum(k, m)) / 2 - a ** (3 * np.maximum(k, m)) / 6
    ),
}
"""Name → P of lags k and m from 1 on, α and ρ."""

USUAL = "DC"
"""It holds TC (ρ = √α) and need not be smooth. The likeliest of three was tried: SS then often won
where a response jumps, and its bands held 91 % instead of 94 %."""


Signals = Sequence[tuple[Array, Array]]
"""Inputs (N, nu) and one output (N,) of each record."""


@dataclass(frozen=True, eq=False)
class ImpulseResponse:
    """The responses of one output to all inputs.

    Attributes:
        g: response to an impulse of one sample, (n, nu).
        error: its standard error, (n, nu).
        step, step_error: response to a step and its standard error, (n, nu).
        kernel: TC, DC or SS.
        noise: standard deviation of e.
        dt: between coefficients [s].
    """

    g: Array
    error: Array
    step: Array
    step_error: Array
    kernel: str
    noise: float
    dt: float


def impulse_response(
    records: Sequence[Record], output: int, samples: int, kernel: str = USUAL
) -> ImpulseResponse:
    """The impulse responses of one output.

    Args:
        samples: coefficients of each response.
        kernel: TC, DC or SS.
    """
    signals = [(r.u[:LONGEST], r.y[:LONGEST, output]) for r in records]
    found = _of_signals(signals, samples, kernel, records[0])
    errors = [_errors(u, y, found.g) for u, y in signals]
    colour = _colour([e for e in errors if len(e) > 4 * ORDERS[-1]])
    if colour is None:
        return found
    white = [(lfilter(colour, [1.0], u, axis=0), lfilter(colour, [1.0], y)) for u, y in signals]
    white = [(u[len(colour) - 1 :], y[len(colour) - 1 :]) for u, y in white]
    return replace(_of_signals(white, samples, kernel, records[0]), noise=found.noise)


def _errors(u: Array, y: Array, g: Array) -> Array:
    """y less what the responses make of u, where all of it is known."""
    e = y - sum(np.convolve(c, h)[: len(y)] for c, h in zip(u.T, g.T, strict=True))
    e = e[len(g) :]
    return np.asarray(np.where(np.isfinite(e), e - np.nanmean(e), 0.0)) if len(e) else e


def _colour(errors: Sequence[Array]) -> Array | None:
    """The whitening polynomial of lowest BIC; None where errors are white."""
    count = sum(map(len, errors))
    lowest = count * np.log(max(sum(float(e @ e) for e in errors), 1e-300))
    best = None
    for order in ORDERS if errors else ():
        found = whitener(errors, order, 0.0)
        if found is None:
            continue
        left = sum(float(np.sum(lfilter(found, [1.0], e) ** 2)) for e in errors)
        score = count * np.log(max(left, 1e-300)) + order * np.log(count)
        if score < lowest:
            lowest, best = score, found
    return best


def _of_signals(signals: Signals, samples: int, kernel: str, record: Record) -> ImpulseResponse:
    """The responses where e is white."""
    X, y = _regressors(signals, samples)
    width = X.shape[1]
    if len(y) < 20 + samples // 4:
        raise DataError(f"{record.name}: {len(y)} samples are too few for a response")
    # one scale for all lags of an input: the prior is of g itself
    scale = np.sqrt(np.mean(X**2, axis=0)).reshape(-1, samples)[:, 0]
    scale = np.repeat(np.maximum(scale, 1e-300), samples)
    size = max(float(np.std(y)), 1e-300)
    R: Array = np.asarray(np.linalg.qr(np.column_stack([X / scale, y / size]), mode="r"))
    mean, covariance, noise = _fitted(R, len(y), samples, record.nu, kernel)
    g = (mean / scale * size).reshape(-1, samples).T
    covariance = covariance / np.outer(scale, scale) * size**2
    blocks = [covariance[s : s + samples, s : s + samples] for s in range(0, width, samples)]
    error = np.sqrt([np.maximum(np.diag(b), 0.0) for b in blocks]).T
    summed = [np.diag(np.cumsum(np.cumsum(b, axis=0), axis=1)) for b in blocks]
    step_error = np.sqrt(np.maximum(summed, 0.0)).T
    step = np.cumsum(g, axis=0)
    return ImpulseResponse(g, error, step, step_error, kernel, noise * size, record.dt)


def _regressors(signals: Signals, n: int) -> tuple[Array, Array]:
    """u_j(t−k) and y(t) about the means of each record, from its sample n on."""
    rows, targets = [], []
    for u, y in signals:
        if len(y) <= n:
            continue
        X = np.hstack([np.lib.stride_tricks.sliding_window_view(c, n)[:, ::-1] for c in u.T])
        known = np.isfinite(y[n - 1 :]) & np.all(np.isfinite(X), axis=1)
        X, y = X[known], y[n - 1 :][known]
        if len(y):
            rows.append(X - X.mean(axis=0))
            targets.append(y - y.mean())
    if not rows:
        return np.zeros((0, n * signals[0][0].shape[1])), np.zeros(0)
    return np.concatenate(rows), np.concatenate(targets)


def _fitted(R: Array, samples: int, n: int, nu: int, kernel: str) -> tuple[Array, Array, float]:
    """Mean, covariance and σ at the hyperparameters of highest marginal likelihood."""
    from scipy.optimize import minimize

    width = n * nu
    A, b = R[:, :width], R[:, width]
    k = np.arange(1.0, n + 1)

    def root(h: Array) -> Array:
        """A square root of the prior covariance of all responses."""
        blocks = np.zeros((width, width))
        for j in range(nu):
            eta, alpha, rho = h[3 * j : 3 * j + 3]
            P = KERNELS[kernel](k[:, None], k, _unit(alpha), _unit(rho))
            P = P / P[0, 0]
            P[np.diag_indices(n)] += TINY
            s = slice(j * n, (j + 1) * n)
            blocks[s, s] = np.exp(0.5 * eta) * np.linalg.cholesky(P)
        return blocks

    gram, side, whole = A.T @ A, A.T @ b, float(R[:, width] @ R[:, width])

    def negative(h: Array) -> float:
        try:
            return evidence(gram, side, whole, root(h), float(np.exp(h[-1])), samples)
        except np.linalg.LinAlgError:
            return 1e12

    start = [v for _ in range(nu) for v in (-2.0, _logit(0.9), _logit(0.9))] + [-3.0]
    options: Any = {"maxfev": TRIES * (3 * nu + 1), "xatol": 0.02, "fatol": 0.05}
    best = minimize(negative, np.array(start), method="Nelder-Mead", options=options)
    L, variance = root(best.x), float(np.exp(best.x[-1]))
    inner = np.linalg.inv(L.T @ gram @ L + variance * np.eye(width))
    mean = L @ (inner @ (L.T @ side))
    return mean, variance * (L @ inner @ L.T), variance**0.5


def evidence(
    gram: Array, side: Array, whole: float, L: Array, variance: float, samples: int
) -> float:
    """−2 ln p(y) less N ln 2π for y ~ N(0, X L Lᵀ Xᵀ + σ² I).

    Args:
        gram, side, whole: XᵀX, Xᵀy and yᵀy.
        L: square root of the prior covariance.
        variance: σ².
        samples: N.

    Raises:
        LinAlgError: it cannot be computed for these numbers.
    """
    C = np.linalg.cholesky(L.T @ gram @ L + variance * np.eye(len(L)))
    seen = np.linalg.solve(C, L.T @ side)
    rest = max(whole - float(seen @ seen), 1e-12 * whole)
    log_det = 2.0 * float(np.sum(np.log(np.diag(C))))
    return rest / variance + (samples - len(L)) * float(np.log(variance)) + log_det


def _unit(x: float) -> float:
    """A number between 0 and 1."""
    return float(np.clip(1.0 / (1.0 + np.exp(-x)), 1e-3, 0.9999))


def _logit(p: float) -> float:
    return float(np.log(p / (1.0 - p)))
