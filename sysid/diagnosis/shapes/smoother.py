"""Penalised least squares: curves whose bend the data choose, and their effective numbers.

y = X₀ a + X b + v, ‖v‖² + λ bᵀS b least, X₀ unpenalised. With Q an orthonormal basis of X₀ and
X̃ = X − QQᵀX = U D Vᵀ, the smoother is diagonal in the eigenvectors of S in X̃'s metric; λ is that of
the least generalised cross-validation N rss/(N − γ edf)². The numbers that a curve costs are
edf = Σ 1/(1 + λ s_j). The band is that of the posterior, σ²(X̃ᵀX̃ + λS)⁻¹.

Sources: Eilers & Marx (1996), Stat. Sci. 11, 89 (second differences of B-splines); Craven & Wahba
(1979), Numer. Math. 31, 377; Nychka (1988), JASA 83, 1134 (band); Kim & Gu (2004), JRSS B 66, 337
(γ = 1.4 keeps cross-validation from fitting noise).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.shapes.track import Mask
from sysid.diagnosis.validation.error_tests import orthonormal

GAMMA = 1.4
PENALTIES = np.concatenate([np.geomspace(1e-8, 1e8, 33)])
DEGREE = 3
FLAT = 1e-9
"""Directions with less than this part of the strongest one's power are none."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted shape.

    Attributes:
        own: coefficients of X₀, (q,); coefficients of X, (k,), and their covariance for unit noise.
        numbers: edf of X.
        moved: what all columns do, and the residual, of all rows, (N,).
        rss: over the fitted rows.
        on_base: whether a speed in X₀ is that of the base's run, not that of a fit.
    """

    own: Array
    coefficients: Array
    covariance: Array
    numbers: float
    moved: Array
    residual: Array
    rss: float
    on_base: bool = False


def fit(y: Array, own: Array, X: Array, S: Array | None, rows: Mask) -> Fit:
    """Fit the rows that count; the residual is that of all rows.

    Args:
        y: (N,); rows that do not count may be NaN.
        own, X: unpenalised and penalised columns, (N, q) and (N, k).
        S: the penalty, (k, k); none: X is unpenalised.
        rows: which rows count, (N,).
    """
    y0, A, B = y[rows], own[rows], X[rows]
    Q = orthonormal(A)
    e, Z = y0 - Q @ (Q.T @ y0), B - Q @ (Q.T @ B)
    gram = Z.T @ Z
    size = np.sqrt(np.maximum(np.diag(B.T @ B), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    kept = values > FLAT * max(float(values[-1]), 1e-300)
    if values[-1] < FLAT:
        kept[:] = False
    T = (vectors[:, kept] / np.sqrt(values[kept])) / size[:, None]  # ZT orthonormal
    if S is None:
        turn, s = np.eye(int(kept.sum())), np.zeros(int(kept.sum()))
    else:
        s, turn = np.linalg.eigh(T.T @ S @ T)
        s = np.maximum(s, 0.0)
    T = T @ turn
    z = (Z @ T).T @ e
    shrink = 1.0 / (1.0 + _penalty(float(e @ e), z, s, len(e)) * s)
    b = T @ (shrink * z)
    a = _least(A, y0 - B @ b)
    moved = own @ a + X @ b
    residual = y - moved
    inside = residual[rows]
    return Fit(
        a, b, (T * shrink) @ T.T, float(shrink.sum()), moved, residual, float(inside @ inside)
    )


def residual_of(y: Array, own: Array, rows: Mask) -> Array:
    """What the unpenalised columns alone leave, (N,)."""
    return np.asarray(y - own @ _least(own[rows], y[rows]))


def _least(A: Array, y: Array) -> Array:
    return np.asarray(np.linalg.lstsq(A, y, rcond=None)[0]) if A.shape[1] else np.zeros(0)


def _penalty(whole: float, z: Array, s: Array, samples: int) -> float:
    """λ by generalised cross-validation."""
    if not len(s) or s.max() < 1e-14:
        return 0.0
    free = s < 1e-9 * s.max()
    weights = PENALTIES / np.median(s[~free])
    shrink = 1.0 / (1.0 + weights[:, None] * s)
    rss = whole - np.sum(z**2 * (1.0 - (1.0 - shrink) ** 2), axis=1)
    score = rss / np.maximum(samples - GAMMA * shrink.sum(axis=1), 1.0) ** 2
    return float(weights[int(np.argmin(score))])


def spline(low: float, high: float, pieces: int) -> Callable[[Array], Array]:
    """x (N,) → cubic B-splines of equal pieces between two ends, (N, pieces + 3)."""
    step = max((high - low) / pieces, 1e-12)

    def basis(x: Array) -> Array:
        at = np.clip((x - low) / step, 0.0, pieces)
        piece = np.minimum(at.astype(np.intp), pieces - 1)
        u = at - piece
        cubics = (1 - u) ** 3, 4 + 3 * u**2 * (u - 2), 1 + 3 * u * (1 + u - u**2), u**3
        out = np.zeros((len(x), pieces + DEGREE))
        np.put_along_axis(
            out, piece[:, None] + np.arange(DEGREE + 1), np.column_stack(cubics) / 6.0, axis=1
        )
        return out

    return basis


def bend(columns: int) -> Array:
    """DᵀD of second differences, (columns, columns)."""
    D = np.diff(np.eye(columns), 2, axis=0)
    return np.asarray(D.T @ D)
