"""Simplified refined instrumental variables (SRIV) of a model without noise model.

With y = Σ (B/F) u + v both sides are filtered by 1/F of the last round, in which

    y_f = φ_fᵀ θ + v,   φ_f: lags (or derivatives) of y_f and of u_f

is linear. Instruments ζ_f are φ_f with the model's noise-free output in the place of y, which are
its slopes ∂x/∂θ; θ solves Σ ζ_f (y_f − φ_fᵀ θ) = 0, and gives the next filter (Young & Jakeman
1979, Int. J. Control 29, 1; in continuous time 1980, 31, 741; dead times by their slopes: Chen,
Garnier & Gilson 2015, Automatica 53, 266). Inputs with denominators of their own are solved
together. Where the rounds end, Σ ζ_f ε = 0, as the least squares of ε demand, too: SRIV is another
way to that minimum, efficient under white v and without bias under any that u does not follow.

cov θ = (ZᵀΦ)⁻¹ ZᵀΣZ (ΦᵀZ)⁻¹, Σ the covariance of v (Ljung 1999, eq. 9.83), which is the one of
least squares with Z (ZᵀZ)⁻¹ZᵀΦ for Jacobian.
"""

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.errors import Termination, UsageError
from sysid.fitting.marquardt import loss
from sysid.fitting.problem import Problem
from sysid.fitting.solvers import Descent, Solution, evaluated

HALVINGS = 8
"""Lengths of a round's step that are tried, each half of the last: far off it raises the cost."""


@runtime_checkable
class Regression(Protocol):
    """A problem that says what its slopes become with measured outputs."""

    def regressors(self, p: Array) -> Array:
        """∂ε/∂p with measured outputs for the model's where denominators act, (M, len(p))."""


def refined_instruments(problem: Problem, p0: Array, how: Descent) -> Solution:
    """Rounds of SRIV from a start, within bounds.

    Args:
        problem: a ``Regression``.
        p0: start, entries that are held included.
        how: what is free, bounds, limit and tolerance.
    """
    if not isinstance(problem, Regression):
        raise UsageError("`method='sriv'` knows no weights of single samples: omit `method`")
    free, p = how.free, np.clip(p0, how.lower, how.upper)
    r = problem.residual(p)
    rounds, ending = 1, Termination.MAX_ITERATIONS
    while rounds < how.max_evaluations:
        slopes = problem.jacobian(p)
        size = np.linalg.norm(r)
        # far off, the model's own output for the measured one as well is a step that goes down
        for phi in (problem.regressors(p), slopes):
            step = _step(slopes, phi, r, free)
            outward = (step < 0.0) & (p <= how.lower) | (step > 0.0) & (p >= how.upper)
            if outward.any():
                step = _step(slopes, phi, r, free & ~outward)
            for k in range(HALVINGS):
                trial = np.clip(p + 0.5**k * step, how.lower, how.upper)
                errors = problem.residual(trial)
                rounds += 1
                if loss(errors) < loss(r):
                    break
            else:
                continue
            p, r = trial, errors
            break
        else:
            ending = Termination.CONVERGED_COST
            break
        if np.linalg.norm(slopes @ step) <= np.sqrt(how.tolerance) * size:
            ending = Termination.CONVERGED_STEP
            break
    J = problem.jacobian(p)
    Q = np.linalg.qr(J[:, free] / np.maximum(np.linalg.norm(J[:, free], axis=0), 1e-300))[0]
    J = J.copy()
    J[:, free] = Q @ (Q.T @ problem.regressors(p)[:, free])
    at_bound = np.flatnonzero(free & ((p <= how.lower) | (p >= how.upper)))
    if len(at_bound) and ending.good:
        ending = Termination.AT_BOUND
    return evaluated(problem, p, ending, rounds, at_bound=tuple(at_bound.tolist()), jacobian=J)


def _step(slopes: Array, phi: Array, r: Array, which: NDArray[np.bool_]) -> Array:
    """δ with Zᵀ(ε + Φ δ) = 0 in some entries of p, 0 in the others."""
    Z, phi = slopes[:, which], phi[:, which]
    sizes = [np.maximum(np.linalg.norm(m, axis=0), 1e-300) for m in (Z, phi)]
    Z, phi = Z / sizes[0], phi / sizes[1]
    step = np.zeros(slopes.shape[1])
    step[which] = -np.linalg.lstsq(Z.T @ phi, Z.T @ r, rcond=1e-12)[0] / sizes[1]
    return step
