"""Parameters of the slipping vehicle, from increments of its pose over two seconds.

Robust least squares with a weak prior: errors beyond a few times the typical one count less (Huber
1964), because a lidar's pose now and then is late by a second; and every number is drawn to what it
would be without any log, as loosely as one knows it then, so a parameter that the log does not
determine keeps the uncertainty it had. Optional terms come one at a time while the log shows them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.data.record import Array, Index
from sysid.fitting.problem import Problem
from sysid.fitting.solvers import Descent, levenberg_marquardt
from sysid.robot.calibration.geometry import LEFT_OUT
from sysid.robot.calibration.ground_fit import with_memory
from sysid.robot.calibration.slip_model import AT, LOWER, NULLS, TERMS, window_errors
from sysid.robot.calibration.trajectory import Trajectory
from sysid.robot.calibration.windows import OVERLAP
from sysid.vehicle.kinematics import Geometry

FAR = 3.0
"""Windows that err by more than so many times the typical error count less."""

ROUNDS = 4
"""Times that the weights and the typical errors are found anew; they hardly move after three."""

SHOWN = 4.0
"""Standard errors by which an optional term must be off doing nothing: five terms are tried up to
five times, and their errors are known to a fifth."""

MAYBE = 2.0
"""… or by so many, where it also lowers the errors of each half of the log with the numbers of the
other: grounds that change along the way make standard errors large and a term no less real."""

BETTER = 0.98
"""Share of its squared error to which a term must lower that of each half."""

LAGS = (-0.25, 0.0, 0.25, 0.5, 0.75, 1.0, 1.5)
"""Lags of the pose [s] from which a fit starts: a lidar's pose comes up to a second late."""

IDENTIFIABLE_SHARE = 0.1
"""A parameter is identifiable if less than this share of its prior uncertainty remains."""

ALIKE = 0.9
"""Numbers whose effects have such a cosine are one number to a log: a fifth of the noise would do
to change one for the other."""

STEP = 1e-3
"""Differences that make the Jacobian, in units of the prior."""

NOTHING = 1e-4, 1e-4, 1e-4
"""Smallest typical errors [m, m, rad], which logs without noise have."""


@dataclass(frozen=True, eq=False)
class Part:
    """Windows of one trajectory.

    Attributes:
        windows: first and last measurement of each, (W, 2).
    """

    trajectory: Trajectory
    windows: Index


@dataclass(frozen=True, eq=False)
class SlipFit:
    """Numbers found, and what they are worth.

    Attributes:
        q: every number, in the order of ``TERMS``; lengths relative to those of ``geometry``.
        geometry: lengths that q multiplies.
        free: which of them are in the model.
        covariance: of all numbers; those that are not in the model as if each was added to it.
        added: what each number would be if it was added to the model; q for those that are in it.
        typical: typical errors of the increments, (3,) [m, m, rad].
        prior: what one would guess each number may be off by without a log.
        likeness: cosine of what every two optional numbers do to the increments beyond what all
            others can do, (n, n); 0 for the others.
    """

    q: Array
    geometry: Geometry
    free: tuple[int, ...]
    covariance: Array
    added: Array
    typical: Array
    prior: Array
    likeness: Array

    @property
    def std_errors(self) -> Array:
        """Of every number."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @property
    def identifiable(self) -> tuple[bool, ...]:
        """Whether each parameter is identifiable; significant optional ones are."""
        sure = self.std_errors < IDENTIFIABLE_SHARE * self.prior
        return tuple(bool(sure[k]) or (t.optional and k in self.free) for k, t in enumerate(TERMS))

    def like(self, k: int) -> tuple[int, ...]:
        """Optional numbers that would do nearly the same as this one on these logs."""
        row = np.abs(self.likeness[k])
        return tuple(j for j in range(len(TERMS)) if j != k and row[j] > ALIKE)


@dataclass(frozen=True, eq=False)
class _SlipProblem(Problem):
    """White, weighted errors of the windows, then what pulls every number to its prior."""

    parts: tuple[Part, ...]
    geometry: Geometry
    typical: Array
    weights: Array
    centre: Array
    prior: Array
    free: tuple[int, ...]
    index: Index = field(default_factory=lambda: np.arange(len(TERMS)))
    n_initial: int = 0

    @property
    def lengths(self) -> tuple[int, ...]:  # type: ignore[override]
        """Residuals of each trajectory, and the prior's."""
        return (*(3 * len(p.windows) for p in self.parts), len(TERMS))

    @property
    def channels(self) -> tuple[int, ...]:  # type: ignore[override]
        """All count as one output."""
        return (0,) * (len(self.parts) + 1)

    def white(self, q: Array) -> Array:
        """Errors in units of the typical ones, each window with its weight, (3W,)."""
        errors = errors_of(q, self.parts, self.geometry) / self.typical
        return np.asarray((errors * np.sqrt(self.weights)[:, None]).ravel())

    def residual(self, p: Array) -> Array:
        """Those of the windows, and of the prior."""
        return np.concatenate([self.white(p), (p - self.centre) / self.prior])

    def jacobian(self, p: Array) -> Array:
        """Central differences in the free numbers; other columns are zero."""
        J = np.zeros((sum(self.lengths), len(TERMS)))
        for k in self.free:
            h = STEP * self.prior[k]
            up, down = p.copy(), p.copy()
            up[k], down[k] = up[k] + h, max(down[k] - h, LOWER[k])
            J[:, k] = (self.residual(up) - self.residual(down)) / (up[k] - down[k])
        return J


def errors_of(q: Array, parts: Sequence[Part], geometry: Geometry) -> Array:
    """Measured less predicted increments of all windows, (W, 3) [m, m, rad]."""
    return np.concatenate([window_errors(q, p.trajectory, geometry, p.windows) for p in parts])


def fit_slip(parts: Sequence[Part], start: Geometry, terms: Sequence[str] | None = None) -> SlipFit:
    """The numbers that bring the predicted increments next to the measured ones.

    Args:
        parts: windows of every trajectory.
        start: lengths near those of the vehicle as it turns.
        terms: optional terms to free; None to find out which.
    """
    parts = tuple(parts)
    always = tuple(k for k, t in enumerate(TERMS) if not t.optional)
    problem = _first(parts, start, always)
    q = _best_lag(problem)
    fit = _settled(replace(problem, free=always), q)
    if terms is not None:
        asked = tuple(sorted({*always, *(AT[t] for t in terms)}))
        return _settled(replace(problem, free=asked), fit.q)
    dropped: set[int] = set()
    while True:
        more = _one_more(problem, fit, dropped)
        if more is None:
            return fit
        needless = _needless(more)
        dropped |= needless
        kept = tuple(k for k in more.free if k not in needless)
        fit = _settled(replace(problem, free=kept), more.q) if needless else more


def _needless(fit: SlipFit) -> set[int]:
    """Optional terms that a later one has made as good as nothing."""
    away = np.abs(fit.q - NULLS) / np.maximum(fit.std_errors, 1e-300)
    return {k for k in fit.free if TERMS[k].optional and away[k] < MAYBE}


def _one_more(problem: _SlipProblem, fit: SlipFit, dropped: set[int]) -> SlipFit | None:
    """The fit with the optional term that the log shows most, None where it shows none."""
    ratio = np.abs(fit.added - NULLS) / np.maximum(fit.std_errors, 1e-300)
    ratio[[*fit.free, *dropped]] = 0.0
    ratio[(fit.added - NULLS < 0.0) & (LOWER == NULLS)] = 0.0  # it would be less than nothing
    for best in np.argsort(-ratio)[: int(np.sum(ratio >= MAYBE))].tolist():
        more = tuple(sorted((*fit.free, best)))
        tried = _settled(replace(problem, free=more), fit.q)
        away = abs(tried.q[best] - NULLS[best]) / max(tried.std_errors[best], 1e-300)
        if away >= SHOWN or (away >= MAYBE and _halves_agree(problem, fit, tried)):
            return tried
    return None


def _halves_agree(problem: _SlipProblem, plain: SlipFit, richer: SlipFit) -> bool:
    """Whether the richer model of each half predicts the other half better."""
    halves: tuple[list[Part], list[Part]] = ([], [])
    for p in problem.parts:
        cut = len(p.windows) // 2
        clear = p.windows[cut:, 0] >= (p.windows[cut - 1, 1] if cut else 0)
        halves[0].append(replace(p, windows=p.windows[:cut]))
        halves[1].append(replace(p, windows=p.windows[cut:][clear]))
    for first, other in (halves, halves[::-1]):
        cost = []
        for model in (plain, richer):
            count = sum(len(p.windows) for p in first)
            small = replace(problem, parts=tuple(first), free=model.free, weights=np.ones(count))
            q = _solved(_weighed(small, model.q), model.q, 8)
            errors = errors_of(q, other, problem.geometry)
            size = np.linalg.norm(errors / plain.typical, axis=1)
            cost.append(float(np.sum(np.minimum(size, FAR * np.sqrt(3.0)) ** 2)))
        if not cost[1] < BETTER * cost[0]:
            return False
    return True


def _first(parts: tuple[Part, ...], start: Geometry, free: tuple[int, ...]) -> _SlipProblem:
    """The problem before anything is known of its errors."""
    spread = np.array([t.spread for t in TERMS])
    fastest = start.r * max(float(np.abs(p.trajectory.omega).mean(axis=1).max()) for p in parts)
    for k, t in enumerate(TERMS):
        if t.unit == "m" and k > AT["effective_width"]:
            spread[k] *= start.B
        elif t.unit == "s/m":
            spread[k] /= max(fastest, 1e-9)
    count = sum(len(p.windows) for p in parts)
    return _SlipProblem(parts, start, np.ones(3), np.ones(count), NULLS.copy(), spread, free)


def _best_lag(problem: _SlipProblem) -> Array:
    """Parameters from the lag at which radii and width alone fit best."""
    few = (AT["radius_left"], AT["radius_right"], AT["effective_width"])
    costs = []
    for lag in LAGS:
        q = NULLS.copy()
        q[[AT["pose_lag"], AT["heading_lag"]]] = lag
        for _ in range(2):
            weighed = _weighed(replace(problem, free=few), q)
            q = _solved(weighed, q, 10)
        errors = errors_of(q, problem.parts, problem.geometry)
        costs.append((np.median(np.abs(errors), axis=0), q))
    typical = np.maximum(np.min([t for t, _ in costs], axis=0), NOTHING)
    return min(costs, key=lambda item: float(np.sum(np.log(np.maximum(item[0], typical)))))[1]


def _weighed(problem: _SlipProblem, q: Array) -> _SlipProblem:
    """The problem with typical errors and weights as these numbers leave them."""
    errors = errors_of(q, problem.parts, problem.geometry)
    typical = np.maximum(1.4826 * np.median(np.abs(errors), axis=0), NOTHING)
    size = np.linalg.norm(errors / typical, axis=1) / np.sqrt(3.0)
    weights = np.minimum(1.0, FAR / np.maximum(size, 1e-300))
    return replace(problem, typical=typical, weights=weights)


def _solved(problem: _SlipProblem, q: Array, evaluations: int) -> Array:
    free = np.zeros(len(TERMS), dtype=bool)
    free[list(problem.free)] = True
    how = Descent(free, LOWER, np.full(len(TERMS), np.inf), max_evaluations=evaluations)
    return levenberg_marquardt(problem, q, how).p


def _settled(problem: _SlipProblem, q: Array) -> SlipFit:
    """The numbers with weights that have settled, and their covariance; others do nothing."""
    q = q.copy()
    outside = [k for k in range(len(TERMS)) if k not in problem.free]
    q[outside] = NULLS[outside]
    for _ in range(ROUNDS):
        problem = _weighed(problem, q)
        q = _solved(problem, q, 20)
    return _judged(_weighed(problem, q), q)


def _judged(problem: _SlipProblem, q: Array) -> SlipFit:
    """The covariance of the numbers, and what those that are not in the model would be.

    Of numbers in the model it is H⁻¹SH⁻¹ with H = JᵀWJ + P⁻¹ and S the covariance of the score,
    whose memory is that of the errors (windows overlap, and wheels slip for seconds at a time).
    """
    n, free = len(TERMS), list(problem.free)
    J = replace(problem, free=tuple(range(n))).jacobian(q)
    covariance, added = np.zeros((n, n)), q.copy()
    covariance[np.ix_(free, free)] = _Linear.of(problem, J, q, free).covariance(problem, q, free)
    for k in (k for k in range(n) if k not in free):
        both = _Linear.of(problem, J, q, [*free, k])
        covariance[k, k] = both.variances(problem, [-1])[0]
        added[k] = q[k] + both.step[-1]
    return SlipFit(
        q,
        problem.geometry,
        problem.free,
        covariance,
        added,
        problem.typical,
        problem.prior,
        _likeness(J[: -len(TERMS)]),
    )


def _likeness(J: Array) -> Array:
    """Cosines between the columns of optional numbers after all others explain what they can."""
    optional = [k for k, t in enumerate(TERMS) if t.optional]
    plain = J[:, [k for k in range(len(TERMS)) if k not in optional]]
    rest = J[:, optional] - plain @ np.linalg.lstsq(plain, J[:, optional], rcond=None)[0]
    rest /= np.maximum(np.linalg.norm(rest, axis=0), 1e-300)
    likeness = np.zeros((len(TERMS), len(TERMS)))
    likeness[np.ix_(optional, optional)] = rest.T @ rest
    return likeness


@dataclass(frozen=True, eq=False)
class _Linear:
    """The problem around q as a line in some numbers.

    Attributes:
        silent: variance that the prior leaves open where the log is silent, (k, k).
        plain: variance of white errors, (k, k).
        influence: what each error does to each number, (3W, k).
        step: from q to where they all fit best, (k,).
        freedom: share of the windows that are left when as many as there are numbers are used up.
    """

    silent: Array
    plain: Array
    influence: Array
    step: Array
    freedom: float

    @classmethod
    def of(cls, problem: _SlipProblem, J: Array, q: Array, free: list[int]) -> "_Linear":
        residual = problem.residual(q)
        rows = len(residual) - len(TERMS)
        j, prior = J[:rows, free], problem.prior[free]
        data, pull = j.T @ j, np.diag(prior**-2.0)
        inverse = np.linalg.inv(data + pull)
        step = -inverse @ (j.T @ residual[:rows] + (q - problem.centre)[free] / prior**2)
        remainder = residual[:rows] + j @ step  # with a number that is added in its place
        windows = rows / 3
        freedom = max(windows / OVERLAP - len(free), 1.0) * OVERLAP / windows
        plain = inverse @ data @ inverse * float(np.mean(remainder**2)) / freedom
        influence = remainder[:, None] * (j @ inverse)
        return cls(inverse @ pull @ inverse, plain, influence, step, freedom)

    def variances(self, problem: _SlipProblem, which: Sequence[int]) -> Array:
        """Of some numbers, with the memory of the errors where they have one, (len(which),)."""
        at = list(which)
        each = with_memory(self.influence[:, at], problem.lengths[:-1]) / self.freedom
        return np.asarray(np.maximum(each, np.diag(self.plain)[at]) + np.diag(self.silent)[at])

    def covariance(self, problem: _SlipProblem, q: Array, free: list[int]) -> Array:
        """Of all numbers; lengths are no surer than speeds between two samples let them be."""
        white = np.diag(self.plain)
        wanted = self.variances(problem, range(len(free))) - np.diag(self.silent)
        size = np.sqrt(wanted / np.maximum(white, 1e-300))
        covariance = self.plain * np.outer(size, size) + self.silent
        sampled = [i for i, k in enumerate(free) if k <= AT["effective_width"]]
        covariance[sampled, sampled] += (LEFT_OUT * q[[free[i] for i in sampled]]) ** 2
        return np.asarray(covariance)
