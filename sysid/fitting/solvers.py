"""Numerical solvers; the only module that imports jaxopt."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.errors import Termination
from sysid.fitting.marquardt import Conditions, Method, loss, marquardt, products
from sysid.fitting.problem import LeastSquares

TOLERANCE = 1e-9
"""Relative tolerance on cost and step: three digits below the statistical error of any log."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a solver ended.

    Attributes:
        p: parameters and initial states.
        cost: ½‖r‖² (of the robust loss where one was asked).
        residual: r(p).
        jacobian: ∂r/∂p at the solution, shape (M, len(p)), all columns.
        weights: weight of each residual: 1 for the quadratic loss, 0 where it does not count.
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


@dataclass(frozen=True, eq=False)
class Descent:
    """How a problem is minimised.

    Attributes:
        free: mask of the entries to estimate.
        lower, upper: bounds of all entries, infinite where there are none.
        huber: threshold of the Huber loss for each residual, (M,), or None for the quadratic loss.
        max_evaluations: limit on residual evaluations.
        tolerance: relative tolerance on cost and step.
        patience: stop after so many evaluations in a row that lowered the cost by less than
            ``tolerance``; None for the solver's own criteria alone. Along directions that the
            data hardly show these go on for long without any gain.
        regular: every parameter has a prior among the residuals, so that the Jacobian's squared
            condition does no harm and normal equations serve; not with the Huber loss.
        method: which step an iteration takes.
    """

    free: NDArray[Any]
    lower: Array
    upper: Array
    huber: Array | None = None
    max_evaluations: int = 200
    tolerance: float = TOLERANCE
    patience: int | None = None
    regular: bool = False
    method: Method = Method.LEVENBERG_MARQUARDT

    def conditions(self) -> Conditions:
        """What the iteration has to obey, for the free entries."""
        lower, upper = self.lower[self.free], self.upper[self.free]
        bounded = bool(np.isfinite(lower).any() or np.isfinite(upper).any())
        return Conditions(
            self.tolerance,
            self.max_evaluations,
            lower if bounded else None,
            upper if bounded else None,
            self.huber,
            self.method,
        )


def levenberg_marquardt(problem: LeastSquares, p0: Array, how: Descent) -> Solution:
    """Minimise ½‖r(p)‖², or Huber's loss, over the free entries of p, within bounds.

    Args:
        p0: start, fixed entries included.
        how: what is free, bounds, loss, tolerances and method.
    """
    free = how.free
    if not free.any():
        return evaluated(problem, p0, Termination.NO_FREE_PARAMETERS, 1, how.huber)
    p = p0.copy()

    def full(x: Array) -> Array:
        p[free] = x
        return p

    best = _Best()

    def residual(x: Array) -> Array:
        r = problem.residual(full(x))
        if how.patience is not None:
            best.add(x, loss(r, how.huber), how.tolerance, how.patience)
        return r

    known: dict[bytes, Array] = {}

    def jacobian(x: Array) -> Array:
        # we ask again at the solution: one evaluation serves both
        known.clear()
        known[x.tobytes()] = J = problem.jacobian(full(x))
        return J if free.all() else J[:, free]

    lower, upper = how.lower[free], how.upper[free]
    normal = products(jacobian) if how.regular and how.huber is None else None
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            x, evaluations, termination = marquardt(
                residual, np.clip(p0[free], lower, upper), jacobian, how.conditions(), normal
            )
    except _StalledError:
        x, evaluations, termination = best.x, best.evaluations, Termination.CONVERGED_COST
    end = p0.copy()
    end[free] = x
    where = np.flatnonzero(free)
    stuck = tuple(int(k) for k in where[_touching(x, lower, upper)])
    if stuck and termination.good:
        termination = Termination.AT_BOUND
    return evaluated(
        problem, end, termination, evaluations, how.huber, stuck, known.get(x.tobytes())
    )


class _StalledError(Exception):
    """The cost no longer falls: raised by a residual to end the search."""


class _Best:
    """The best point a search has seen, and for how long nothing better came."""

    def __init__(self) -> None:
        self.x: Array = np.zeros(0)
        self.evaluations = 0
        self._cost, self._waited = np.inf, 0

    def add(self, x: Array, cost: float, tolerance: float, patience: int) -> None:
        """Note one evaluation; raise when patience is at an end."""
        self.evaluations += 1
        self._waited = 0 if cost < (1.0 - tolerance) * self._cost else self._waited + 1
        if cost < self._cost or not len(self.x):
            self.x, self._cost = x.copy(), cost
        if self._waited >= patience:
            raise _StalledError


def evaluated(
    problem: LeastSquares,
    p: Array,
    termination: Termination,
    evaluations: int = 1,
    huber: Array | None = None,
    at_bound: tuple[int, ...] = (),
    jacobian: Array | None = None,
) -> Solution:
    """A point as a solution: what the problem and the loss are there."""
    r = problem.residual(p)
    weights = np.ones(len(r))
    cost = loss(r, huber)
    if huber is not None:
        weights = np.minimum(1.0, huber / np.maximum(np.abs(r), 1e-300))
    if problem.counts is not None:
        weights = weights * problem.counts
    if not np.isfinite(cost) or np.max(np.abs(r), initial=0.0) >= 1e99:
        termination = Termination.DIVERGED
    J = problem.jacobian(p) if jacobian is None else jacobian
    return Solution(p, cost, r, J, weights, termination, evaluations, at_bound)


def _touching(x: Array, lower: Array, upper: Array) -> NDArray[np.bool_]:
    width = np.where(np.isfinite(upper - lower), upper - lower, np.maximum(1.0, np.abs(x)))
    return np.asarray((x - lower <= 1e-6 * width) | (upper - x <= 1e-6 * width))


@dataclass(frozen=True, eq=False)
class Ending:
    """Where one of many simultaneous starts ended.

    Attributes:
        z: parameters.
        cost: ½‖r‖² there, None where it is not finite.
    """

    z: Array
    cost: float | None
    iterations: int


CLIPPED = 1e6
"""Residuals are kept below this: jaxopt multiplies rejected steps by zero, and 0·∞ is no number."""


def many_starts(
    residual: Callable[[Any, Any, Any, Any, Any], Any],
    starts: Array,
    each: Any,
    shared: Any,
    iterations: int = 20,
    tolerance: float = 1e-7,
    jacobian: Callable[[Any, Any, Any, Any, Any], Any] | None = None,
) -> tuple[Ending, ...]:
    """Levenberg-Marquardt from many starts at once: jaxopt's, vmapped and compiled.

    The same functions with the same limits are compiled once for every shape of their arguments.

    Args:
        residual: (jax.numpy, jax.lax, z, each, shared) → r, of about unit norm at a poor start
            (divide by √N: jaxopt's damping is absolute).
        starts: z of every start, (S, n).
        each: arrays whose first axis belongs to the starts.
        shared: arrays all starts share; passed as arguments, so that a compilation serves any data.
        tolerance: on the gradient's norm.
        jacobian: of ``residual``, with the same arguments; forward-mode unless given.
    """
    solutions = _batch_solver(residual, jacobian, iterations, tolerance)(starts, each, shared)
    ends, costs, counts = (np.asarray(part, dtype=np.float64) for part in solutions)
    return tuple(
        Ending(z, float(cost) if np.isfinite([cost, *z]).all() else None, int(count))
        for z, cost, count in zip(ends, costs, counts, strict=True)
    )


@lru_cache(maxsize=16)
def _batch_solver(
    residual: Callable[[Any, Any, Any, Any, Any], Any],
    jacobian: Callable[[Any, Any, Any, Any, Any], Any] | None,
    iterations: int,
    tolerance: float,
) -> Callable[..., Any]:
    """(starts, each, shared) → ends, costs and iterations, compiled."""
    with warnings.catch_warnings():
        # it says on import that nobody develops it further; its version is pinned here
        warnings.simplefilter("ignore", DeprecationWarning)
        from jaxopt import LevenbergMarquardt

    from sysid.runners.compiled import jax_module

    jax = jax_module()
    jnp, lax = jax.numpy, jax.lax

    def clipped(z: Any, bounds: Any, data: Any) -> Any:
        r = jnp.nan_to_num(residual(jnp, lax, z, bounds, data), nan=CLIPPED)
        return jnp.clip(r, -CLIPPED, CLIPPED)

    # compiled on their own, they are traced once although jaxopt calls them in many places
    clipped = jax.jit(clipped)
    slopes = None
    if jacobian is not None:
        slopes = jax.jit(lambda z, bounds, data: jacobian(jnp, lax, z, bounds, data))

    class Solver(LevenbergMarquardt):  # type: ignore[misc]
        """jaxopt's: with the Jacobian kept, as here, it forgets to take ``jac_fun``."""

        def __post_init__(self) -> None:
            super().__post_init__()
            if self.jac_fun is not None:
                self._jac_fun = self.jac_fun

    solver = Solver(
        residual_fun=clipped,
        jac_fun=slopes,
        materialize_jac=True,
        solver="cholesky",
        damping_parameter=1e-3,
        maxiter=iterations,
        tol=tolerance,
        implicit_diff=False,
        jit=True,
    )

    def run(z: Any, bounds: Any, data: Any) -> Any:
        end, state = solver.run(z, bounds, data)
        return end, state.value, state.iter_num

    compiled: Callable[..., Any] = jax.jit(jax.vmap(run, in_axes=(0, 0, None)))
    return compiled
