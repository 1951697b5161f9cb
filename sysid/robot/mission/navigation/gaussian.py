"""Algebra of Kalman filters over an array namespace: mean and covariance, predicted, corrected.

It is the textbook's (thesis 4.4–4.11), with what a robot needs besides: measurements that are
missing take no part, angles are subtracted around the circle, and covariances stay symmetric.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

from sysid.robot.mission.navigation.flow import compiled
from sysid.vehicle.kinematics import Real, wrap_angle

LOG_2PI = 1.8378770664093453


class Gaussian(NamedTuple):
    """What a filter believes.

    Attributes:
        x: mean, (n,).
        P: covariance, (n, n).
    """

    x: Any
    P: Any


class Innovation(NamedTuple):
    """How far a measurement lay from its prediction.

    Attributes:
        nis: normalised innovation squared, νᵀS⁻¹ν; χ² of ``dof`` where model and noise are right.
        dof: numbers that were read.
        rejected: 1 where the gate let it not through, else 0.
        log_likelihood: of the measurement, −½(νᵀS⁻¹ν + ln det S + dof ln 2π).
    """

    nis: Real
    dof: Real
    rejected: Real
    log_likelihood: Real


def symmetric(P: Any) -> Any:
    """The covariance without what rounding put on one side of its diagonal only."""
    return 0.5 * (P + P.swapaxes(-1, -2))


@lru_cache(maxsize=64)
def chi2_quantiles(probability: float, up_to: int) -> tuple[float, ...]:
    """Quantiles of χ² for 0 … ``up_to`` degrees of freedom; 0 for none of them."""
    from scipy.special import gammaincinv

    return (0.0, *(2.0 * float(gammaincinv(0.5 * k, probability)) for k in range(1, up_to + 1)))


def innovation(
    nu: Any, S: Any, variance: Any, present: Any, quantiles: Any, xp: Any
) -> tuple[Innovation, Any]:
    """Judge a measurement by its innovation.

    Args:
        nu: z − ẑ, (m,); 0 where nothing was read.
        S: its covariance, (m, m), without coupling to what was not read.
        variance: of the measurements, (m,), for those that were not read.
        present: what was read, (m,).
        quantiles: largest νᵀS⁻¹ν that passes, by the number of measurements, (m + 1,).

    Returns:
        The innovation, and S⁻¹.
    """
    inverse, determinant = inverted(S, len(nu), xp)
    nis = nu @ inverse @ nu
    dof = present.sum()
    volume = xp.log(determinant) - xp.where(present, 0.0, xp.log(variance)).sum()
    log_likelihood = -0.5 * (nis + volume + dof * LOG_2PI)
    rejected = 1.0 * (nis > xp.array(quantiles)[dof])
    return Innovation(nis, 1.0 * dof, rejected, log_likelihood), inverse


def reset(belief: Gaussian, T: Any, least: float, xp: Any) -> Gaussian:
    """x⁺ = Tx, P⁺ = TPTᵀ, where T sets some states to others or to 0; also of many at once.

    Such a copy is as uncertain as its source to the last digit, which makes P singular; ``least``
    is added to the variance of every state that is set.
    """
    kept = xp.eye(len(T)) * T
    added = least * (xp.eye(len(T)) - kept)
    return Gaussian(belief.x @ T.T, symmetric(T @ belief.P @ T.T) + added)


def corrected(
    belief: Gaussian, nu: Any, H: Any, variance: Any, quantiles: Any, xp: Any
) -> tuple[Gaussian, Innovation]:
    """Correct a belief by a measurement z = Hx + v that is linear, or linearised at the mean.

    K = PHᵀ(HPHᵀ + R)⁻¹, x⁺ = x + Kν, P⁺ = (I − KH)P(I − KH)ᵀ + KRKᵀ (thesis 4.9–4.11 in the form
    of Joseph, which keeps P positive definite).

    Args:
        nu: z − h(x), (m,); NaN where nothing was read.
        H: slopes of h, (m, n).
        variance: of the measurements, diagonal of R, (m,).
    """
    present = xp.isfinite(nu)
    nu, H = xp.where(present, nu, 0.0), xp.where(present[:, None], H, 0.0)
    PH = belief.P @ H.T
    innovated, inverse = innovation(
        nu, H @ PH + variance * xp.eye(len(nu)), variance, present, quantiles, xp
    )
    K = PH @ inverse * (1.0 - innovated.rejected)
    rest = xp.eye(len(belief.x)) - K @ H
    P = rest @ belief.P @ rest.T + (K * variance) @ K.T
    return Gaussian(belief.x + K @ nu, symmetric(P)), innovated


def inverted(S: Any, m: int, xp: Any) -> tuple[Any, Real]:
    """Inverse and determinant of a symmetric positive definite matrix of a few rows.

    The sweep operator (Goodnight 1979), written out: two or three measurements come together, for
    which a library's call takes longer than the arithmetic, and compiles for a second.
    """
    a = [[S[i, j] for j in range(m)] for i in range(m)] if compiled(xp) else S.tolist()
    determinant: Real = 1.0
    for k in range(m):
        pivot = a[k][k]
        determinant = determinant * pivot
        row = [value / pivot for value in a[k]]
        for i in range(m):
            if i != k:
                by = a[i][k]
                a[i] = [value - by * of for value, of in zip(a[i], row, strict=True)]
                a[i][k] = -by / pivot
        row[k] = 1.0 / pivot
        a[k] = row
    return xp.array(a), determinant


class Sigma(NamedTuple):
    """Where 2n + 1 sigma points lie and what they weigh (van der Merwe).

    Attributes:
        scale: n + λ = α²(n + κ); points lie at x ± the columns of √(scale·P).
        mean, covariance: weights in means and in covariances, (2n + 1,).
    """

    scale: float
    mean: Any
    covariance: Any


def sigma(n: int, alpha: float, beta: float, kappa: float, xp: Any) -> Sigma:
    """Spread and weights of sigma points."""
    scale = alpha * alpha * (n + kappa)
    first, others = 1.0 - n / scale, (0.5 / scale,) * (2 * n)
    of_square = first + 1.0 - alpha * alpha + beta
    return Sigma(scale, xp.array((first, *others)), xp.array((of_square, *others)))


def around(points: Any, angles: Any, xp: Any) -> Any:
    """Differences of points from the first of them, (p, n), angles around the circle."""
    off = points - points[0]
    return xp.where(angles, wrap_angle(off), off)


def transformed(
    belief: Gaussian, f: Callable[[Any], Any], angles: Any, of: Sigma, xp: Any
) -> tuple[Any, Any, Any]:
    """What a function makes of a belief, by sigma points (unscented transform).

    Args:
        f: from points (p, n) to points (p, m).
        angles: which of its m values are angles, (m,) of truth values.

    Returns:
        The mean (m,), and the deviations of the points before (p, n) and after (p, m).
    """
    root = xp.linalg.cholesky(of.scale * belief.P).T
    points = xp.concatenate([belief.x[None], belief.x + root, belief.x - root])
    out = f(points)
    off = around(out, angles, xp)
    shift = of.mean @ off
    return out[0] + shift, points - belief.x, off - shift


def wrapped(x: Any, at: int, xp: Any) -> Any:
    """The mean with the angle at one place brought into (−π, π]."""
    return x + (wrap_angle(x[at]) - x[at]) * xp.eye(len(x))[at]
