"""Parameters of the slipping vehicle, from increments of its pose over two seconds.

Robust least squares with a weak prior: errors beyond a few times the typical one count less (Huber
1964), because a lidar's pose now and then is late by a second; and every number is drawn to what it
would be without any log, as loosely as one knows it then, so a parameter that the log does not
determine keeps the uncertainty it had. Optional terms come one at a time while the log shows them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.fitting.differences import slopes
from sysid.fitting.problem import LeastSquares
from sysid.fitting.solvers import Descent, levenberg_marquardt
from sysid.robot.calibration.geometry import LEFT_OUT
from sysid.robot.calibration.ground_fit import with_memory
from sysid.robot.calibration.slip_estimate import SlipFit
from sysid.robot.calibration.slip_model import AT, LOWER, NULLS, TERMS, Kinematic
from sysid.robot.calibration.trajectory import Part
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

STEP = 1e-3
"""Differences that make the Jacobian, in units of the prior."""

NOTHING = 1e-4, 1e-4, 1e-4
"""Smallest typical errors [m, m, rad], which logs without noise have."""


@dataclass(frozen=True, eq=False)
class _SlipProblem(LeastSquares):
    """White, weighted errors of the windows, then what pulls every number to its prior."""

    parts: tuple[Part, ...]
    geometry: Geometry
    typical: Array
    weights: Array
    prior: Array
    free: tuple[int, ...]

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Which numbers are free, (n,)."""
        return np.isin(np.arange(len(TERMS)), self.free)

    def residual(self, p: Array) -> Array:
        """Errors in units of the typical ones, each window with its weight, and the prior's."""
        errors = Kinematic(self.geometry, p).errors(self.parts) / self.typical
        white = (errors * np.sqrt(self.weights)[:, None]).ravel()
        return np.concatenate([white, (p - NULLS) / self.prior])

    def jacobian(self, p: Array) -> Array:
        """Central differences in the free numbers; other columns are zero."""
        steps = np.where(self.mask, STEP * self.prior, 0.0)
        return slopes(self.residual, p, steps, LOWER)


def fit_slip(parts: Sequence[Part], start: Geometry, terms: Sequence[str] | None = None) -> SlipFit:
    """The numbers that bring the predicted increments next to the measured ones.

    Args:
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
        # a later term may have made optional ones as good as nothing
        away = np.abs(more.q - NULLS) / np.maximum(more.std_errors, 1e-300)
        needless = {k for k in more.free if TERMS[k].optional and away[k] < MAYBE}
        dropped |= needless
        kept = tuple(k for k in more.free if k not in needless)
        fit = _settled(replace(problem, free=kept), more.q) if needless else more


def _one_more(problem: _SlipProblem, fit: SlipFit, dropped: set[int]) -> SlipFit | None:
    ratio = np.abs(fit.if_added - NULLS) / np.maximum(fit.std_errors, 1e-300)
    ratio[[*fit.free, *dropped]] = 0.0
    ratio[(fit.if_added - NULLS < 0.0) & (LOWER == NULLS)] = 0.0  # it would be less than nothing
    for best in np.argsort(-ratio)[: int(np.sum(ratio >= MAYBE))].tolist():
        more = tuple(sorted((*fit.free, best)))
        tried = _settled(replace(problem, free=more), fit.q)
        away = abs(tried.q[best] - NULLS[best]) / max(tried.std_errors[best], 1e-300)
        if away >= SHOWN or (away >= MAYBE and _halves_agree(problem, fit, tried)):
            return tried
    return None


def _halves_agree(problem: _SlipProblem, plain: SlipFit, richer: SlipFit) -> bool:
    halves: tuple[list[Part], list[Part]] = ([], [])
    for p in problem.parts:
        cut = len(p.windows) // 2
        clear = p.windows[cut:, 0] >= (p.windows[cut - 1, 1] if cut else 0)
        halves[0].append(replace(p, windows=p.windows[:cut]))
        halves[1].append(replace(p, windows=p.windows[cut:][clear]))
    for first, other in (halves, halves[::-1]):
        cost = []
        for model in (plain, richer):
            small = replace(problem, parts=tuple(first), free=model.free)
            q = _solved(small, model.q, 8, 1)
            errors = Kinematic(problem.geometry, q).errors(other)
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
    return _SlipProblem(parts, start, np.ones(3), np.ones(1), spread, free)


def _best_lag(problem: _SlipProblem) -> Array:
    """Parameters from the lag at which radii and width alone fit best."""
    few = (AT["radius_left"], AT["radius_right"], AT["effective_width"])
    costs = []
    for lag in LAGS:
        q = NULLS.copy()
        q[[AT["pose_lag"], AT["heading_lag"]]] = lag
        q = _solved(replace(problem, free=few), q, 10, 2)
        errors = Kinematic(problem.geometry, q).errors(problem.parts)
        costs.append((np.median(np.abs(errors), axis=0), q))
    typical = np.maximum(np.min([t for t, _ in costs], axis=0), NOTHING)
    return min(costs, key=lambda item: float(np.sum(np.log(np.maximum(item[0], typical)))))[1]


def _weighed(problem: _SlipProblem, q: Array) -> _SlipProblem:
    """The problem with typical errors and weights as these numbers leave them."""
    errors = Kinematic(problem.geometry, q).errors(problem.parts)
    typical = np.maximum(1.4826 * np.median(np.abs(errors), axis=0), NOTHING)
    size = np.linalg.norm(errors / typical, axis=1) / np.sqrt(3.0)
    weights = np.minimum(1.0, FAR / np.maximum(size, 1e-300))
    return replace(problem, typical=typical, weights=weights)


def _solved(problem: _SlipProblem, q: Array, evaluations: int, rounds: int) -> Array:
    """The numbers after some rounds, each with the weights that the one before has left."""
    how = Descent(problem.mask, LOWER, np.full(len(TERMS), np.inf), max_evaluations=evaluations)
    for _ in range(rounds):
        q = levenberg_marquardt(_weighed(problem, q), q, how).p
    return q


def _settled(problem: _SlipProblem, q: Array) -> SlipFit:
    """The numbers with weights that have settled, and their covariance; others do nothing."""
    q = np.where(problem.mask, q, NULLS)
    q = _solved(problem, q, 20, ROUNDS)
    return _judged(_weighed(problem, q), q)


def _judged(problem: _SlipProblem, q: Array) -> SlipFit:
    """The covariance of the numbers, and what those that are not in the model would be.

    Of numbers in the model it is H⁻¹SH⁻¹ with H = JᵀWJ + P⁻¹ and S the covariance of the score,
    whose memory is that of the errors (windows overlap, and wheels slip for seconds at a time).
    """
    n, free = len(TERMS), list(problem.free)
    J = replace(problem, free=tuple(range(n))).jacobian(q)
    covariance, added = np.zeros((n, n)), q.copy()
    covariance[np.ix_(free, free)] = _linear(problem, J, q, free)[1]
    for k in (k for k in range(n) if k not in free):
        step, both = _linear(problem, J, q, [*free, k])
        covariance[k, k] = both[-1, -1]
        added[k] = q[k] + step[-1]
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


def _linear(problem: _SlipProblem, J: Array, q: Array, free: Sequence[int]) -> tuple[Array, Array]:
    """Step from q to where some numbers fit best if all are lines, (k,), and their covariance."""
    residual = problem.residual(q)
    rows = len(residual) - len(TERMS)
    j, prior = J[:rows, free], problem.prior[free]
    data, pull = j.T @ j, np.diag(prior**-2.0)
    inverse = np.linalg.inv(data + pull)
    step = -inverse @ (j.T @ residual[:rows] + (q - NULLS)[free] / prior**2)
    remainder = residual[:rows] + j @ step  # with a number that is added in its place
    windows = rows / 3
    freedom = max(windows / OVERLAP - len(free), 1.0) * OVERLAP / windows
    white = inverse @ data @ inverse * float(np.mean(remainder**2)) / freedom
    influence = remainder[:, None] * (j @ inverse) / np.sqrt(freedom)
    each = [3 * len(p.windows) for p in problem.parts]
    # the prior leaves open where the log is silent
    covariance = with_memory(white, influence, each) + inverse @ pull @ inverse
    # lengths are no surer than speeds between two samples let them be
    sampled = [i for i, k in enumerate(free) if k <= AT["effective_width"]]
    covariance[sampled, sampled] += (LEFT_OUT * q[[free[i] for i in sampled]]) ** 2
    return step, covariance
