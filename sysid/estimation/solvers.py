"""Numerical solvers behind one door: the only importer of scipy.optimize."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.errors import Termination
from sysid.structures.base import Problem

TOLERANCE = 1e-9
"""Relative tolerance on cost and step: three digits below the statistical error of any log."""

HUBER_WIDTH = 1.345
"""Huber's threshold in standard deviations: 95 % efficiency on Gaussian errors (Huber 1981)."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a solver ended.

    Attributes:
        p: parameters and initial states.
        cost: ½‖r‖² (of the robust loss where one was asked).
        residual: r(p).
        jacobian: ∂r/∂p at the solution, shape (M, len(p)), all columns.
        weights: weight of each residual (1 for the quadratic loss).
        termination: why it stopped.
        evaluations: residual evaluations.
        at_bound: entries of p that ended on a bound.
    """

    p: Array
    cost: float
    residual: Array
    jacobian: Array
    weights: Array
    termination: Termination
    evaluations: int
    at_bound: tuple[int, ...] = ()


def levenberg_marquardt(
    problem: Problem,
    p0: Array,
    *,
    free: Array,
    lower: Array,
    upper: Array,
    huber: float | None = None,
    max_evaluations: int = 200,
    tolerance: float = TOLERANCE,
) -> Solution:
    """Minimise ½‖r(p)‖² over the free entries of p.

    Levenberg-Marquardt (Moré 1978) from SciPy; with bounds or the Huber loss its bounded trust
    region instead.

    Args:
        problem: residuals and Jacobian.
        p0: start, fixed entries included.
        free: mask of the entries to estimate.
        lower, upper: bounds of all entries.
        huber: threshold of the Huber loss in units of r, or None for the quadratic loss.
        max_evaluations: limit on residual evaluations.
        tolerance: relative tolerance on cost and step.
    """
    if not free.any():
        return _ended(problem, p0, Termination.NO_FREE_PARAMETERS, 1, huber)
    from scipy.optimize import least_squares

    p = p0.copy()

    def full(x: Array) -> Array:
        p[free] = x
        return p

    bounded = bool(np.any(np.isfinite(lower[free])) or np.any(np.isfinite(upper[free])))
    start = p0[free]
    options: dict[str, Any] = {"method": "lm"}
    if bounded or huber is not None:
        options = {"method": "trf", "bounds": (lower[free], upper[free])}
        start = _inside(start, lower[free], upper[free])
        if huber is not None:
            options |= {"loss": "huber", "f_scale": huber}

    def residual(x: Array) -> Array:
        return problem.residual(full(x))

    known: dict[bytes, Array] = {}

    def jacobian(x: Array) -> Array:
        # SciPy asks again at the solution, and so do we: one evaluation serves all
        key = x.tobytes()
        if key not in known:
            known.clear()
            known[key] = problem.jacobian(full(x))
        return known[key] if free.all() else known[key][:, free]

    with np.errstate(over="ignore", invalid="ignore"):
        found = least_squares(
            residual,
            start,
            jac=jacobian,
            x_scale="jac",
            ftol=tolerance,
            xtol=tolerance,
            gtol=1e-14,
            max_nfev=max_evaluations,
            **options,
        )
    end = p0.copy()
    end[free] = found.x
    where = np.flatnonzero(free)
    stuck = tuple(int(k) for k in where[_touching(found.x, lower[free], upper[free])])
    termination = _ENDINGS.get(int(found.status), Termination.MAX_ITERATIONS)
    if stuck and termination.good:
        termination = Termination.AT_BOUND
    J = known.get(found.x.tobytes())
    return _ended(problem, end, termination, int(found.nfev), huber, stuck, J)


_ENDINGS = {
    0: Termination.MAX_ITERATIONS,
    1: Termination.CONVERGED_GRADIENT,
    2: Termination.CONVERGED_COST,
    3: Termination.CONVERGED_STEP,
    4: Termination.CONVERGED_COST,
}


def _ended(
    problem: Problem,
    p: Array,
    termination: Termination,
    evaluations: int,
    huber: float | None,
    at_bound: tuple[int, ...] = (),
    jacobian: Array | None = None,
) -> Solution:
    r = problem.residual(p)
    weights = np.ones(len(r))
    cost = 0.5 * float(r @ r)
    if huber is not None:
        size = np.abs(r)
        weights = np.minimum(1.0, huber / np.maximum(size, 1e-300))
        cost = float(np.sum(np.where(size <= huber, 0.5 * r**2, huber * (size - 0.5 * huber))))
    if not np.isfinite(cost) or np.max(np.abs(r), initial=0.0) >= 1e99:
        termination = Termination.DIVERGED
    J = problem.jacobian(p) if jacobian is None else jacobian
    return Solution(p, cost, r, J, weights, termination, evaluations, at_bound)


def _inside(x: Array, lower: Array, upper: Array) -> Array:
    """``x`` moved strictly inside its bounds, as the trust region needs it."""
    width = np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    margin = 1e-6 * width
    return np.minimum(np.maximum(x, lower + margin), upper - margin)


def _touching(x: Array, lower: Array, upper: Array) -> NDArray[np.bool_]:
    width = np.where(np.isfinite(upper - lower), upper - lower, np.maximum(1.0, np.abs(x)))
    return np.asarray((x - lower <= 1e-6 * width) | (upper - x <= 1e-6 * width))
