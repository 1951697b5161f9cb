"""Levenberg-Marquardt for long records: many residuals, few parameters.

The algorithm is that of MINPACK's lmder (Moré 1978; Moré, Garbow & Hillstrom 1980), with its
scaling, trust region, constants and tests; on well-posed problems it takes the same steps. What
differs is the linear algebra: MINPACK factorises the M x n Jacobian column by column, which for
10⁴ residuals takes longer than computing it. Here LAPACK's QR of [J r] leaves a triangle of order
n + 1, and every trial step comes from the singular values of that: searches take half the time.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.errors import Termination
from sysid.fitting.normal_equations import triangle

FIRST_RADIUS = 100.0
"""First trust radius in units of ‖D x‖; the first step cuts it to its own length."""

ACCEPTED = 1e-4
"""Share of the promised decrease from which a step is taken."""

SLACK = 0.1
"""Relative deviation of a step's length from the trust radius that is left alone."""

GRADIENT = 1e-14
"""Cosine between residual and gradients that counts as zero; cost and step decide before."""

EPS = float(np.finfo(np.float64).eps)


def marquardt(
    residual: Callable[[Array], Array],
    start: Array,
    jacobian: Callable[[Array], Array],
    tolerance: float,
    limit: int,
) -> tuple[Array, int, Termination]:
    """Minimise ½‖r(x)‖².

    Args:
        residual: r(x), shape (M,), finite at the start.
        start: first x, shape (n,).
        jacobian: ∂r/∂x, shape (M, n); asked for only where a step ended.
        tolerance: relative tolerance on cost and step.
        limit: residual evaluations at most.

    Returns:
        x, the number of residual evaluations, and why it ended.
    """
    x, r = start.copy(), residual(start)
    norm, evaluations = float(np.linalg.norm(r)), 1
    scale: Array = np.zeros(len(x))
    radius = 0.0
    first = True
    while True:
        model = _LinearModel.of(jacobian(x), r, scale)
        scale = model.scale
        if not np.all(np.isfinite(model.z)):
            return x, evaluations, Termination.DIVERGED
        if first:
            radius = FIRST_RADIUS * (float(np.linalg.norm(scale * x)) or 1.0)
        if model.slope <= GRADIENT * norm:
            return x, evaluations, Termination.CONVERGED_GRADIENT
        taken = False
        while not taken:
            q, damping = model.step(radius)
            length = float(np.linalg.norm(q))
            if first:
                radius, first = min(radius, length), False
            trial = x + q / scale
            r_trial = residual(trial)
            evaluations += 1
            norm_trial = float(np.linalg.norm(r_trial))
            actual = 1.0 - (norm_trial / norm) ** 2 if SLACK * norm_trial < norm else -1.0
            linear, pull = model.change(q, norm), damping * (length / norm) ** 2
            promised = linear + 2.0 * pull
            ratio = actual / promised if promised > 0.0 else 0.0
            radius = _next_radius(radius, length, ratio, actual, linear + pull, damping)
            taken = ratio >= ACCEPTED
            if taken:
                x, r, norm = trial, r_trial, norm_trial
            small = max(abs(actual), promised)
            if small <= max(tolerance, EPS) and ratio <= 2.0:
                return x, evaluations, Termination.CONVERGED_COST
            if radius <= max(tolerance, EPS) * float(np.linalg.norm(scale * x)):
                return x, evaluations, Termination.CONVERGED_STEP
            if norm == 0.0:
                return x, evaluations, Termination.CONVERGED_COST
            if evaluations >= limit:
                return x, evaluations, Termination.MAX_ITERATIONS


@dataclass(frozen=True, eq=False)
class _LinearModel:
    """r + J D⁻¹ q near an iterate, in scaled steps q, by the singular values of J D⁻¹.

    Attributes:
        scale: D, the largest norm that each column of J has had.
        s, Vt: singular values and right vectors of J D⁻¹.
        z: the residual along the left vectors.
        slope: largest projection of the residual on a unit column of J.
    """

    scale: Array
    s: Array
    Vt: Array
    z: Array
    slope: float

    @staticmethod
    def of(J: Array, r: Array, scale: Array) -> "_LinearModel":
        n = J.shape[1]
        stacked = np.empty((n + 1, len(r)))
        stacked[:n], stacked[n] = J.T, r
        both = triangle(stacked.T)
        if not np.all(np.isfinite(both)):
            return _LinearModel(scale, np.ones(1), np.zeros((1, n)), np.full(1, np.nan), np.inf)
        R, z = both[:n, :n], both[:n, n]
        size = np.linalg.norm(R, axis=0)
        along = np.abs(R.T @ z) / np.where(size > 0.0, size, 1.0)
        scale = np.maximum(scale, size)
        scale[scale == 0.0] = 1.0
        U, s, Vt = np.linalg.svd(R / scale, full_matrices=False)
        keep = s > len(s) * EPS * s[0]
        return _LinearModel(scale, s[keep], Vt[keep], (U.T @ z)[keep], float(along.max()))

    def step(self, radius: float) -> tuple[Array, float]:
        """The minimiser within ``radius``, and its damping λ: 0 for the Gauss-Newton step.

        ‖q(λ)‖ = radius is solved for 1/‖q‖, which is nearly linear in λ (Hebden 1973).
        """
        damping = 0.0
        for _ in range(20):
            bottom = self.s**2 + damping
            q = -self.s * self.z / bottom
            length = float(np.linalg.norm(q))
            if length <= (1.0 + SLACK) * radius:
                break
            slope = float(np.sum(q**2 / bottom)) / length
            damping += (length / radius) * (length - radius) / slope
        return self.Vt.T @ q, damping

    def change(self, q: Array, norm: float) -> float:
        """‖J D⁻¹ q‖²/‖r‖²."""
        return float(np.sum((self.s * (self.Vt @ q)) ** 2)) / norm**2


def _next_radius(
    radius: float, length: float, ratio: float, actual: float, descent: float, damping: float
) -> float:
    """Shrink where the model promised too much, grow where it was right."""
    if ratio <= 0.25:
        shrink = 0.5 if actual >= 0.0 else 0.5 * descent / (descent - 0.5 * actual)
        return max(shrink, 0.1) * min(radius, 10.0 * length)
    return 2.0 * length if damping == 0.0 or ratio >= 0.75 else radius
