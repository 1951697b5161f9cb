"""Levenberg–Marquardt with bounds and Huber's loss, used by every fit on the host.

The algorithm is that of MINPACK's lmder (Moré 1978; Moré, Garbow & Hillstrom 1980), with its
scaling, trust region, constants and tests; on well-posed problems it takes the same steps. What
differs is the linear algebra: MINPACK factorises the M x n Jacobian column by column, which for
10⁴ residuals takes longer than computing it. Here LAPACK's QR of [J r] leaves a triangle of order
n + 1, and every trial step comes from the singular values of that; or JᵀJ and Jᵀr are given, where
the problem can sum them piece by piece or bears their squared condition.

Bounds: a step is cut at them, and a parameter that stands on one and is pushed further out stays
(projected search). Huber's loss Σ ρ(r), ρ' = ψ: rows are weighed by its curvature, 1 inside the
width and ``CURVATURE`` outside, with ψ for r; its gradient is exact.

Gauss-Newton and gradient iterations (thesis 3.30-3.34; Ljung 1999, §10.2) share all of this but
the step, which is halved until the cost falls.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.errors import Termination
from sysid.fitting.normal_equations import triangle

FIRST_RADIUS = 100.0
"""First trust radius in units of ‖D x‖; the first step cuts it to its own length."""

ACCEPTED = 1e-4
"""Share of the promised decrease from which a step is taken."""

FIRST_RADIUS_WITHIN = 1.0
"""The same with bounds or Huber's loss, as SciPy has it: bounded numbers are physical ones, and far
from where they are known the errors say little about them."""

SLACK = 0.1
"""Relative deviation of a step's length from the trust radius that is left alone."""

GRADIENT = 1e-14
"""Cosine between residual and gradients that counts as zero; cost and step decide before."""

CURVATURE = 0.1
"""Curvature that Huber's loss is given outside its width, where it has none: a step must end."""

SHORTEST = 1e-8
"""Share of a Gauss-Newton or gradient step below which it is given up."""

GROWTH = 10.0
"""One step takes a number at most so many times as far from its only bound, or as near to it."""

EPS = float(np.finfo(np.float64).eps)

Function = Callable[[Array], Array]
NormalEquations = Callable[[Array, Array], tuple[Array, Array]]
"""(x, r) → (JᵀJ, Jᵀr)."""


class Method(Enum):
    """Which step an iteration takes; ``iv4`` and ``sriv`` are instrumental variables, ``two-stage``
    and ``joint`` what of the input a log of a closed loop is fitted to, by the usual steps."""

    LEVENBERG_MARQUARDT = "levenberg-marquardt"
    GAUSS_NEWTON = "gauss-newton"
    GRADIENT = "gradient"
    IV4 = "iv4"
    SRIV = "sriv"
    TWO_STAGE = "two-stage"
    JOINT = "joint"


@dataclass(frozen=True, eq=False)
class Conditions:
    """What a search has to obey.

    Attributes:
        tolerance: relative tolerance on cost and step.
        limit: residual evaluations at most.
        lower, upper: bounds, (n,) each; None for none.
        huber: width of Huber's loss for each residual, (M,); None for the quadratic loss.
        least_scale: D is at least this times ‖r‖, (n,): a parameter that is hardly felt cannot
            run away with every step.
    """

    tolerance: float
    limit: int
    lower: Array | None = None
    upper: Array | None = None
    huber: Array | None = None
    method: Method = Method.LEVENBERG_MARQUARDT
    least_scale: Array | None = None


def loss(r: Array, huber: Array | None = None) -> float:
    """½‖r‖², or Huber's Σ ρ(r): ½ r² up to the width k, then k (|r| − k/2); inf on overflow."""
    with np.errstate(over="ignore", invalid="ignore"):
        if huber is None:
            return 0.5 * float(r @ r)
        size = np.abs(r)
        return float(np.sum(np.where(size <= huber, 0.5 * size**2, huber * (size - 0.5 * huber))))


def products(jacobian: Function) -> NormalEquations:
    """Normal equations of a Jacobian: a twentieth of its QR's time, of its condition squared."""

    from scipy.linalg.blas import dsyrk  # a mission fits nothing

    def equations(x: Array, r: Array) -> tuple[Array, Array]:
        J = jacobian(x)
        # the transpose of a row-major J is what BLAS calls a matrix: nothing is copied
        half = dsyrk(1.0, J.T) if J.flags.c_contiguous else np.triu(J.T @ J)
        return np.asarray(half + np.triu(half, 1).T), J.T @ r

    return equations


def marquardt(
    residual: Function,
    start: Array,
    jacobian: Function | None,
    conditions: Conditions,
    normal: NormalEquations | None = None,
) -> tuple[Array, int, Termination]:
    """Minimise ½‖r(x)‖², or Huber's loss, for lower ≤ x ≤ upper.

    Args:
        residual: r(x), shape (M,), finite at the start.
        start: first x, shape (n,), within the bounds.
        jacobian: ∂r/∂x, shape (M, n); asked for only where a step ended.
        conditions: tolerance, limit, bounds, loss, method.
        normal: JᵀJ and Jᵀr instead of a Jacobian; of the quadratic loss only.

    Returns:
        x, the number of residual evaluations, and why it ended.
    """
    search = _Search(residual, start, conditions)
    ended: Termination | None = None
    while ended is None:
        model = _linear_model(search.x, search.r, jacobian, normal, conditions.huber)
        ended = search.ended_at(model)
        if ended is None:
            ended = search.descended(model)
    return search.x, search.evaluations, ended


class _Search:
    """Where a search stands, and its trust region."""

    def __init__(self, residual: Function, start: Array, conditions: Conditions) -> None:
        c = conditions
        self._residual, self._conditions = residual, c
        self._box = _Box(c.lower, c.upper)
        self._tolerance = max(c.tolerance, EPS)
        self._scale: Array = np.zeros(len(start))
        self._radius: float | None = None
        self.x, self.r = start.copy(), residual(start)
        self._norm = float(np.sqrt(2.0 * loss(self.r, c.huber)))
        self.evaluations = 1

    def ended_at(self, model: "_LinearModel") -> Termination | None:
        """Whether there is nowhere to go from here; takes over the scale of its columns."""
        if not model.finite:
            return Termination.DIVERGED
        scale = np.maximum(self._scale, model.size)
        if self._conditions.least_scale is not None:
            scale = np.maximum(scale, self._conditions.least_scale * self._norm)
        scale[scale == 0.0] = 1.0
        self._scale = scale
        moving = self._box.moving(self.x, model.gradient)
        flat = model.slope(moving) <= GRADIENT * self._norm
        return Termination.CONVERGED_GRADIENT if flat else None

    def descended(self, model: "_LinearModel") -> Termination | None:
        """Steps of one linear model until one is taken; why the search ended, if it did."""
        steps = model.steps(self._scale, self._box.moving(self.x, model.gradient))
        share, taken, ended = 1.0, False, None
        while not taken and ended is None:
            q, damping = self._proposed(steps, share)
            trial = self._box.cut(self.x + q / self._scale, self.x)
            if self._box.bounded:
                q = (trial - self.x) * self._scale
            r = self._residual(trial)
            self.evaluations += 1
            norm = float(np.sqrt(2.0 * loss(r, self._conditions.huber)))
            actual = 1.0 - (norm / self._norm) ** 2 if SLACK * norm < self._norm else -1.0
            descent, curved = steps.change(q, self._norm)
            promised = 2.0 * descent - curved
            ratio = actual / promised if promised > 0.0 else 0.0
            if self._radius is not None:
                length = float(np.linalg.norm(q))
                self._radius = _next_radius(self._radius, length, ratio, actual, descent, damping)
            taken, share = ratio >= ACCEPTED, 0.5 * share
            if taken:
                self.x, self.r, self._norm = trial, r, norm
            settled = max(abs(actual), promised) <= self._tolerance and ratio <= 2.0
            ended = self._verdict(settled or self._norm == 0.0, share)
        return ended

    def _proposed(self, steps: "_Steps", share: float) -> tuple[Array, float]:
        """The next step in units of D, and its damping."""
        method = self._conditions.method
        if method in (Method.GAUSS_NEWTON, Method.GRADIENT):
            return share * steps.undamped(method), 0.0
        if self._radius is not None:
            return steps.within(self._radius)
        within = self._box.bounded or self._conditions.huber is not None
        first = FIRST_RADIUS_WITHIN if within else FIRST_RADIUS
        radius = first * (float(np.linalg.norm(self._scale * self.x)) or 1.0)
        q, damping = steps.within(radius)
        self._radius = min(radius, float(np.linalg.norm(q)))
        return q, damping

    def _verdict(self, settled: bool, share: float) -> Termination | None:
        if settled:
            return Termination.CONVERGED_COST
        whole = float(np.linalg.norm(self._scale * self.x))
        if self._radius is None:
            short = share <= SHORTEST
        else:
            short = self._radius <= self._tolerance * whole
        if short:
            return Termination.CONVERGED_STEP
        out_of_time = self.evaluations >= self._conditions.limit
        return Termination.MAX_ITERATIONS if out_of_time else None


class _Box:
    """Lower and upper bounds of x."""

    def __init__(self, lower: Array | None, upper: Array | None) -> None:
        self.bounded = lower is not None or upper is not None
        self._lower = -np.inf if lower is None else lower
        self._upper = np.inf if upper is None else upper

    def cut(self, trial: Array, x: Array) -> Array:
        """The nearest point within the bounds and within reach of x.

        A number with one bound has no size but its distance from it: one step multiplies or
        divides that by ``GROWTH`` at most. A step along what is hardly felt (a Stribeck speed
        beside next to no breakaway) would otherwise end beyond all measure or on the bound, where
        nothing depends on it any more.
        """
        if not self.bounded:
            return trial
        below, above = self._lower, self._upper
        with np.errstate(invalid="ignore"):  # of infinite bounds; their reach is not taken
            up, down = x - below, above - x
            floor = np.isfinite(below) & np.isinf(above) & (up > 0.0)
            roof = np.isinf(below) & np.isfinite(above) & (down > 0.0)
            low = np.where(floor, below + up / GROWTH, np.where(roof, above - GROWTH * down, below))
            high = np.where(
                floor, below + GROWTH * up, np.where(roof, above - down / GROWTH, above)
            )
        return np.asarray(np.clip(trial, low, high))

    def moving(self, x: Array, gradient: Array) -> NDArray[np.bool_]:
        """The parameters that do not stand on a bound and are pushed further out."""
        if not self.bounded:
            return np.ones(len(x), dtype=bool)
        out = ((x <= self._lower) & (gradient > 0.0)) | ((x >= self._upper) & (gradient < 0.0))
        return np.asarray(~out)


def _linear_model(
    x: Array,
    r: Array,
    jacobian: Function | None,
    normal: NormalEquations | None,
    huber: Array | None,
) -> "_LinearModel":
    if normal is not None:
        return _LinearModel(*normal(x, r), None, None)
    assert jacobian is not None
    J = jacobian(x)
    if huber is not None:
        curvature = np.sqrt(np.where(np.abs(r) <= huber, 1.0, CURVATURE))
        J, r = curvature[:, None] * J, np.clip(r, -huber, huber) / curvature
    n = J.shape[1]
    stacked = np.empty((n + 1, len(r)))
    stacked[:n], stacked[n] = J.T, r
    both = triangle(stacked.T)
    R, z = both[:n, :n], both[:n, n]
    with np.errstate(invalid="ignore", over="ignore"):
        return _LinearModel(None, R.T @ z, R, z)


class _LinearModel:
    """r + J d near an iterate: a triangle R of J and z = Qᵀr, or JᵀJ; and the gradient Jᵀr."""

    def __init__(
        self, gram: Array | None, gradient: Array, R: Array | None, z: Array | None
    ) -> None:
        self.gram, self.gradient, self.R, self.z = gram, gradient, R, z
        if gram is not None:
            self.size: Array = np.sqrt(np.maximum(np.diag(gram), 0.0))
        else:
            assert R is not None
            self.size = np.linalg.norm(R, axis=0)

    @property
    def finite(self) -> bool:
        """Whether anything overflowed."""
        return bool(np.all(np.isfinite(self.size)) and np.all(np.isfinite(self.gradient)))

    def slope(self, moving: NDArray[np.bool_]) -> float:
        """Largest projection of the residual on a unit column of J."""
        along = np.abs(self.gradient) / np.where(self.size > 0.0, self.size, 1.0)
        return float(np.max(along[moving], initial=0.0))

    def steps(self, scale: Array, moving: NDArray[np.bool_]) -> "_Steps":
        """The steps of the moving parameters in units of D."""
        D = scale[moving]
        if self.gram is not None:
            squares, vectors = np.linalg.eigh(self.gram[np.ix_(moving, moving)] / np.outer(D, D))
            s, Vt = np.sqrt(np.maximum(squares[::-1], 0.0)), vectors[:, ::-1].T
            keep = s**2 > len(s) * EPS * s[0] ** 2
            s, Vt = s[keep], Vt[keep]
            z = (Vt @ (self.gradient[moving] / D)) / s
            return _Steps(moving, s, Vt, z)
        assert self.R is not None
        assert self.z is not None
        U, s, Vt = np.linalg.svd(self.R[:, moving] / D, full_matrices=False)
        keep = s > len(s) * EPS * s[0]
        return _Steps(moving, s[keep], Vt[keep], (U.T @ self.z)[keep])


@dataclass(frozen=True, eq=False)
class _Steps:
    """Scaled steps q = D d of a linear model, by the singular values of J D⁻¹.

    Attributes:
        moving: which parameters move, (n,).
        s, Vt: singular values and right vectors of J D⁻¹.
        z: the residual along the left vectors.
    """

    moving: NDArray[np.bool_]
    s: Array
    Vt: Array
    z: Array

    def within(self, radius: float) -> tuple[Array, float]:
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
        return self._whole(self.Vt.T @ q), damping

    def undamped(self, method: Method) -> Array:
        """The Gauss-Newton step, or the minimiser along the gradient."""
        if method is Method.GAUSS_NEWTON:
            return self._whole(-self.Vt.T @ (self.z / self.s))
        g = self.s * self.z
        return self._whole(-self.Vt.T @ g * (float(g @ g) / float(np.sum((self.s * g) ** 2))))

    def change(self, q: Array, norm: float) -> tuple[float, float]:
        """(−gᵀq, ‖J D⁻¹ q‖²)/‖r‖²: how fast the cost falls, and what its curvature takes back."""
        along = self.s * (self.Vt @ q[self.moving])
        return -float(self.z @ along) / norm**2, float(along @ along) / norm**2

    def _whole(self, q: Array) -> Array:
        out = np.zeros(len(self.moving))
        out[self.moving] = q
        return out


def _next_radius(
    radius: float, length: float, ratio: float, actual: float, descent: float, damping: float
) -> float:
    """Shrink where the model promised too much, grow where it was right."""
    if ratio <= 0.25:
        shrink = 0.5 if actual >= 0.0 else 0.5 * descent / (descent - 0.5 * actual)
        return max(shrink, 0.1) * min(radius, 10.0 * length)
    return 2.0 * length if damping == 0.0 or ratio >= 0.75 else radius
