"""Impulse response by regularised least squares, its length no question of order.

    y_i(t) = Σ_j Σ_{k=0}^{n−1} g_ijk u_j(t−k) + c + e(t),   g_ij ~ N(0, η P(α, …))

With the covariance P of a response that decays, the posterior mean is the estimate, its covariance
the band; η, α and the noise are those of the highest marginal likelihood. P is TC (tuned and
correlated), DC (diagonal and correlated) or SS (stable spline):

    TC  α^max(k,l)      DC  α^((k+l)/2) ρ^|k−l|      SS  α^(k+l+max)/2 − α^(3 max)/6

Source: Chen, Ohlsson & Ljung (2012), Automatica 48, 1525; the marginal likelihood from the R of one
QR decomposition (Chen & Ljung 2013, Automatica 49, 2213).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import DataError

MOST = 120
"""Coefficients of a response at most."""

LONGEST = 20_000
"""Samples that are used."""

TRIES = 60
"""Evaluations of the marginal likelihood a hyperparameter."""

TINY = 1e-10
"""Added to the diagonal of P, in shares of its largest entry."""


def _tc(k: Array, alpha: float, rho: float) -> Array:
    return np.asarray(alpha ** np.maximum.outer(k, k))


def _dc(k: Array, alpha: float, rho: float) -> Array:
    return np.asarray(alpha ** (0.5 * np.add.outer(k, k)) * rho ** abs(np.subtract.outer(k, k)))


def _ss(k: Array, alpha: float, rho: float) -> Array:
    later, both = np.maximum.outer(k, k), np.add.outer(k, k)
    return np.asarray(alpha ** (both + later) / 2.0 - alpha ** (3.0 * later) / 6.0)


KERNELS: Mapping[str, Callable[[Array, float, float], Array]] = {"TC": _tc, "DC": _dc, "SS": _ss}
"""Name → P of lags from 1 on, α and ρ."""


@dataclass(frozen=True, eq=False)
class ImpulseResponse:
    """The responses of one output to all inputs.

    Attributes:
        g: response to an impulse of one sample, (n, nu).
        error: its standard error, (n, nu).
        step, step_error: response to a step and its standard error, (n, nu).
        kernel: TC, DC or SS.
        noise: standard deviation of e.
    """

    g: Array
    error: Array
    step: Array
    step_error: Array
    kernel: str
    noise: float


def impulse_response(
    records: Sequence[Record], output: int, samples: int, kernel: str | None = None
) -> ImpulseResponse:
    """The impulse responses of one output.

    Args:
        samples: coefficients of each response.
        kernel: TC, DC or SS; the one of highest marginal likelihood when None.

    Raises:
        DataError: there are fewer samples than that.
    """
    X, y = _regressors(records, output, samples)
    width = X.shape[1]
    if len(y) < 20 + samples // 4:
        raise DataError(f"{records[0].name}: {len(y)} samples are too few for a response")
    scale = np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-300)
    size = max(float(np.std(y)), 1e-300)
    R: Array = np.asarray(np.linalg.qr(np.column_stack([X / scale, y / size]), mode="r"))
    spread = np.repeat([scale[j * samples] for j in range(records[0].nu)], samples)
    tried = [
        _fitted(R, width, len(y), samples, records[0].nu, name)
        for name in ([kernel] if kernel else KERNELS)
    ]
    best = min(tried, key=lambda t: t[0])
    _, name, mean, covariance, noise = best
    g = (mean / spread * size).reshape(-1, samples).T
    covariance = covariance / np.outer(spread, spread) * size**2
    blocks = [covariance[s : s + samples, s : s + samples] for s in range(0, width, samples)]
    error = np.sqrt([np.maximum(np.diag(b), 0.0) for b in blocks]).T
    summed = [np.diag(np.cumsum(np.cumsum(b, axis=0), axis=1)) for b in blocks]
    return ImpulseResponse(
        g,
        error,
        np.cumsum(g, axis=0),
        np.sqrt(np.maximum(summed, 0.0)).T,
        name,
        noise * size,
    )


def _regressors(records: Sequence[Record], output: int, n: int) -> tuple[Array, Array]:
    """u_j(t−k) and y(t) about the means of each record, from its sample n on."""
    rows, targets = [], []
    for r in records:
        u, y = r.u[:LONGEST], r.y[:LONGEST, output]
        if len(y) <= n:
            continue
        X = np.hstack([np.lib.stride_tricks.sliding_window_view(c, n)[:, ::-1] for c in u.T])
        known = np.isfinite(y[n - 1 :]) & np.all(np.isfinite(X), axis=1)
        X, y = X[known], y[n - 1 :][known]
        if len(y):
            rows.append(X - X.mean(axis=0))
            targets.append(y - y.mean())
    if not rows:
        return np.zeros((0, n * records[0].nu)), np.zeros(0)
    return np.concatenate(rows), np.concatenate(targets)


def _fitted(
    R: Array, width: int, samples: int, n: int, nu: int, kernel: str
) -> tuple[float, str, Array, Array, float]:
    """(−2 ln marginal likelihood, kernel, mean, covariance, σ) at the best hyperparameters."""
    from scipy.optimize import minimize

    A, b = R[:, :width], R[:, width]
    k = np.arange(1.0, n + 1)

    def root(h: Array) -> Array:
        """A square root of the prior covariance of all responses."""
        blocks = np.zeros((width, width))
        for j in range(nu):
            eta, alpha, rho = h[3 * j : 3 * j + 3]
            P = KERNELS[kernel](k, _unit(alpha), _unit(rho))
            P = P / P[0, 0]
            P[np.diag_indices(n)] += TINY
            s = slice(j * n, (j + 1) * n)
            blocks[s, s] = np.exp(0.5 * eta) * np.linalg.cholesky(P)
        return blocks

    gram, side, whole = A.T @ A, A.T @ b, float(R[:, width] @ R[:, width])

    def negative(h: Array) -> float:
        variance = float(np.exp(h[-1]))
        try:
            L = root(h)
            C = np.linalg.cholesky(L.T @ gram @ L + variance * np.eye(width))
        except np.linalg.LinAlgError:
            return 1e12
        seen = np.linalg.solve(C, L.T @ side)
        rest = max(whole - float(seen @ seen), 1e-12 * whole)
        log_det = 2.0 * float(np.sum(np.log(np.diag(C))))
        return rest / variance + (samples - width) * float(h[-1]) + log_det

    start = [v for _ in range(nu) for v in (-2.0, _logit(0.9), _logit(0.9))] + [-3.0]
    options: Any = {"maxfev": TRIES * (3 * nu + 1), "xatol": 0.02, "fatol": 0.05}
    best = minimize(negative, np.array(start), method="Nelder-Mead", options=options)
    L, variance = root(best.x), float(np.exp(best.x[-1]))
    inner = np.linalg.inv(L.T @ gram @ L + variance * np.eye(width))
    mean = L @ (inner @ (L.T @ side))
    return float(best.fun), kernel, mean, variance * (L @ inner @ L.T), variance**0.5


def _unit(x: float) -> float:
    """A number between 0 and 1."""
    return float(np.clip(1.0 / (1.0 + np.exp(-x)), 1e-3, 0.9999))


def _logit(p: float) -> float:
    return float(np.log(p / (1.0 - p)))
