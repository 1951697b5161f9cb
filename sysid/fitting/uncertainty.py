"""Covariance of estimated parameters, and directions without information."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sysid.criteria.coloured import coloured_gram
from sysid.data.record import Array
from sysid.fitting.normal_equations import RANK_TOLERANCE, triangle

AR_ORDER = 20
WHITE_LAGS = 25

LEAST_SLOPE = 0.1
"""Smallest mean slope of Huber's score that is believed: with fewer residuals inside the width the
width is not that of their bulk."""

PART = 1e-3
"""Weight beyond which a parameter counts as taking part in a direction without information."""


ALONE = 0.999
"""Weight from which a direction without information is a single parameter."""


def unvisited(direction: Mapping[str, float]) -> str:
    """The one parameter that a direction without information consists of; empty for several."""
    name = max(direction, key=lambda n: abs(direction[n]))
    size = sum(w * w for w in direction.values()) ** 0.5
    return name if abs(direction[name]) > ALONE * size else ""


@dataclass(frozen=True, eq=False)
class Determined:
    """What is known of functions of parameters where single ones are not determined.

    Attributes:
        covariance: (n, n), finite: ∇gᵀ P ∇g is the variance of every function g that no open
            direction changes.
        open: (n, m), steps in the parameters' own units that change no error.
    """

    covariance: Array
    open: Array

    def fits(self, n: int) -> bool:
        """Whether its parts are those of n parameters."""
        return self.covariance.shape == (n, n) and self.open.ndim == 2 and len(self.open) == n


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance of the estimates.

    Attributes:
        covariance: (n, n); infinite variance where the data hold no information.
        null: directions without information, (n, n_null): orthonormal weights of the gradient's
            columns scaled to unit norm, so that units do not decide who takes part.
        coloured: whether the sandwich form was used because the residuals are coloured.
        variance: residual variance per degree of freedom.
        plain: diagonal of (JᵀJ)⁻¹, (n,), where the data hold information.
        determined: the same covariance before infinite variances entered it.
    """

    covariance: Array
    null: Array
    coloured: bool
    variance: float
    plain: Array
    determined: Determined


def uncertainty(
    jacobian: Array,
    residual: Array,
    stretches: Sequence[tuple[int, int]],
    weights: Array,
) -> Uncertainty:
    """Covariance of a least-squares (or Huber) estimate.

    With residuals that a portmanteau test takes for white (1 %) σ²(JᵀJ)⁻¹ (Ljung 1999, eq. 9.42);
    with coloured ones the sandwich (JᵀJ)⁻¹ JᵀΣJ (JᵀJ)⁻¹, Σ from an AR(20) fit of the residuals.
    Under the Huber loss ε is replaced by its score ψ(ε), which is bounded, and everything divided
    by the square of the mean slope ψ′, the share of the residuals inside the width (Huber 1981, eq.
    7.6.5):

        E ψ² / (E ψ′)² (JᵀJ)⁻¹,

    times Huber's correction (1 + n var ψ′ / (N (E ψ′)²))² for few samples.

    Args:
        jacobian: ∂ε/∂p of the estimated entries, shape (M, n).
        residual: ε, shape (M,).
        stretches: (output, number of residuals) of each uninterrupted stretch of time, in order.
        weights: weight ψ(ε)/ε of each residual, 0 for those that were left out.
    """
    n = jacobian.shape[1]
    seen = weights > 0.0
    m = int(np.sum(seen))
    slope = float(np.sum(weights == 1.0)) / max(m, 1)
    J = jacobian if np.all(seen) else jacobian * seen[:, None]
    half, null = half_and_null(J)
    inverse = half @ half.T
    dof = max(m - half.shape[1], 1)
    score = residual * weights
    bent = (1.0 + n * (1.0 - slope) / (max(m, 1) * max(slope, LEAST_SLOPE))) / max(
        slope, LEAST_SLOPE
    )
    variance = float(score @ score) / dof * bent**2
    pieces = slices_by_output(stretches)
    scores = {i: [score[p] for p in where] for i, where in pieces.items()}
    is_white = all(portmanteau_white(e) for e in scores.values())
    covariance = variance * inverse
    if not is_white and m > 5 * AR_ORDER:
        # outputs have noise of their own
        covariance = np.zeros((n, n))
        for i, where in pieces.items():
            covariance += sandwich(half, [J[p] for p in where], scores[i])
        covariance *= m / dof * bent**2
    else:
        is_white = True
    size = np.linalg.norm(J, axis=0)
    known = Determined(covariance, null / np.where(size > 0.0, size, 1.0)[:, None])
    covariance = with_infinite(covariance, null)
    return Uncertainty(covariance, null, not is_white, variance, np.diag(inverse), known)


def half_and_null(J: Array) -> tuple[Array, Array]:
    """H with H Hᵀ = (JᵀJ)⁻¹ in the directions with information, (n, k), and those without, (n, m):
    orthonormal weights of J's columns scaled to unit norm."""
    scale = np.linalg.norm(J, axis=0)
    scale[scale == 0] = 1.0
    _, s, Vt = np.linalg.svd(triangle(J / scale), full_matrices=False)
    keep = s > s.max(initial=0.0) * RANK_TOLERANCE
    return Vt[keep].T / s[keep] / scale[:, None], Vt[~keep].T


def slices_by_output(stretches: Sequence[tuple[int, int]]) -> dict[int, list[slice]]:
    """Output → the residuals of its stretches that hold any.

    Args:
        stretches: (output, number of residuals) of each stretch, in order.
    """
    edges = np.cumsum([0, *(n for _, n in stretches)]).tolist()
    pieces: dict[int, list[slice]] = {}
    for (output, _), (a, b) in zip(stretches, pairwise(edges), strict=True):
        if b > a:
            pieces.setdefault(output, []).append(slice(a, b))
    return pieces


def sandwich(half: Array, columns: Sequence[Array], errors: Sequence[Array]) -> Array:
    """H (JH)ᵀΣ(JH) Hᵀ = (JᵀJ)⁻¹ JᵀΣJ (JᵀJ)⁻¹ with H Hᵀ = (JᵀJ)⁻¹, Σ from an AR(20) fit.

    The columns of JH are orthonormal, so the middle is as well conditioned as Σ, and the result is
    positive wherever H is. Multiplying the three large factors instead loses all digits where
    the condition of J comes near 1/√ε: variances then come out negative.

    Args:
        half: H, (n, k), its columns those directions that hold information.
        columns: J, (N, n) a stretch.
        errors: residuals of these stretches, (N,) each.
    """
    middle = coloured_gram([J @ half for J in columns], errors, AR_ORDER)
    return np.asarray(half @ middle @ half.T)


def half_of(inverse: Array) -> Array:
    """H with H Hᵀ = (JᵀJ)⁻¹, from a scaled eigenvalue decomposition; (n, n)."""
    size = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    size = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(inverse / np.outer(size, size))
    return np.asarray(size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def portmanteau_white(residuals: Sequence[Array]) -> bool:
    """Ljung & Box (1978) over 25 lags at 1 %, pooled over the stretches."""
    from scipy.special import chdtri  # a mission waits for no solver

    n = sum(len(e) for e in residuals)
    power = sum(float(e @ e) for e in residuals)
    if power <= 0.0 or n <= 2 * WHITE_LAGS:
        return True
    statistic = 0.0
    for k in range(1, WHITE_LAGS + 1):
        r = sum(float(e[k:] @ e[:-k]) for e in residuals if len(e) > k) / power
        statistic += r * r / (n - k)
    return bool(n * (n + 2) * statistic < chdtri(WHITE_LAGS, 0.01))


def with_infinite(covariance: Array, null: Array) -> Array:
    """Infinite variance for every entry that takes part in a direction without information."""
    out = covariance.copy()
    if null.size:
        for k in np.flatnonzero(np.max(np.abs(null), axis=1) > PART):
            out[k, :] = 0.0
            out[:, k] = 0.0
            out[k, k] = np.inf
    return out
