"""Levenberg-Marquardt within bounds, by normal equations: many parameters, each with a prior.

SciPy's trust region takes the singular values of the whole M x n Jacobian at every step; for
10⁴ x 200 that is four fifths of a search. The products JᵀJ take a twentieth of it and are good
enough where every parameter is drawn somewhere, as the residuals of a regularised network do. The
damping follows Madsen, Nielsen & Tingleff 2004 ("Methods for non-linear least squares problems");
parameters on a bound that the gradient pushes further out stand still (projected search).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.blas import dsyrk

from sysid.data.record import Array
from sysid.errors import Termination

FIRST_DAMPING = 1e-4
"""Of the diagonal of JᵀJ: the search starts near its end."""

GRADIENT = 1e-12
"""Decrease that a step promises, relative to the cost, which counts as nothing."""

DAMPED_OUT = 1e12


def bounded_marquardt(
    residual: Callable[[Array], Array],
    start: Array,
    jacobian: Callable[[Array], Array],
    limits: tuple[Array, Array],
    tolerance: float,
    limit: int,
) -> tuple[Array, int, Termination]:
    """Minimise ½‖r(x)‖² for lower ≤ x ≤ upper.

    Args:
        residual: r(x), shape (M,), finite at the start.
        start: first x, shape (n,), within the bounds.
        jacobian: ∂r/∂x, shape (M, n); asked for only where a step ended.
        limits: lower and upper bounds, (n,) each, infinite where there are none.
        tolerance: relative decrease of the cost, or length of a step, that ends the search.
        limit: residual evaluations at most.

    Returns:
        x, the number of residual evaluations, and why it ended.
    """
    lower, upper = limits
    x, r = start.copy(), residual(start)
    cost, evaluations = float(r @ r), 1
    damping, growth = FIRST_DAMPING, 2.0
    scale: Array = np.zeros(len(x))
    while True:
        J = jacobian(x)
        G, g = _products(J), J.T @ r
        if not np.all(np.isfinite(g)):
            return x, evaluations, Termination.DIVERGED
        scale = np.maximum(scale, np.diag(G))
        safe = np.where(scale > 0.0, scale, 1.0)
        moving = ~(((x <= lower) & (g > 0.0)) | ((x >= upper) & (g < 0.0)))
        while True:
            if evaluations >= limit:
                return x, evaluations, Termination.MAX_ITERATIONS
            if damping > DAMPED_OUT:
                return x, evaluations, Termination.CONVERGED_STEP
            trial = np.clip(x + _step(G, g, damping * safe, moving), lower, upper)
            d = trial - x
            promised = -float(2.0 * (d @ g) + d @ G @ d)
            if abs(promised) <= GRADIENT * cost:
                return x, evaluations, Termination.CONVERGED_GRADIENT
            r_trial = residual(trial)
            evaluations += 1
            cost_trial = float(r_trial @ r_trial)
            if cost_trial < cost and promised > 0.0:
                break
            damping, growth = damping * growth, 2.0 * growth
        ratio = (cost - cost_trial) / promised
        damping, growth = damping * max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3), 2.0
        gained = (cost - cost_trial) / cost
        length = float(np.linalg.norm(np.sqrt(safe) * d))
        whole = float(np.linalg.norm(np.sqrt(safe) * trial))
        x, r, cost = trial, r_trial, cost_trial
        if gained <= tolerance and promised <= tolerance * cost:
            return x, evaluations, Termination.CONVERGED_COST
        if length <= tolerance * whole:
            return x, evaluations, Termination.CONVERGED_STEP


def _products(J: Array) -> Array:
    """JᵀJ; one triangle is computed."""
    # the transpose of a row-major J is what BLAS calls a matrix: nothing is copied
    half = dsyrk(1.0, J.T) if J.flags.c_contiguous else np.triu(J.T @ J)
    return np.asarray(half + np.triu(half, 1).T)


def _step(G: Array, g: Array, damping: Array, moving: NDArray[np.bool_]) -> Array:
    """−(G + diag(damping))⁻¹ g in the parameters that move, none in the others."""
    out = np.zeros(len(g))
    if moving.any():
        where = np.flatnonzero(moving)
        M = G[np.ix_(where, where)]
        M[np.diag_indices(len(where))] += damping[where]
        try:
            out[where] = -cho_solve(cho_factor(M, lower=False, overwrite_a=True), g[where])
        except np.linalg.LinAlgError:
            out[where] = -g[where] / (np.diag(M) + damping[where])
    return out
