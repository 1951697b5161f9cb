"""All experiments of a motor at once: weighted least squares with a noise estimate for each.

Every measurement is compared with what the constants predict at its voltage. Each quantity of each
file has a noise level of its own, estimated along with the constants from its residuals over its
degrees of freedom (iteratively reweighted least squares, restricted maximum likelihood).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.errors import DataError, Termination
from sysid.fitting.differences import slopes
from sysid.fitting.problem import Problem
from sysid.fitting.solvers import Descent, levenberg_marquardt
from sysid.fitting.uncertainty import uncertainty
from sysid.testbench.motor.equations import MotorConstants, steady_state
from sysid.testbench.motor.experiments import CONSTANTS, Kind, KnownValue, SteadyTest

ROUNDS = 30
"""Limit of the reweighting; noise levels settle within ten rounds."""

SETTLED = 1e-4
"""Relative change of every noise estimate below which the iteration has settled."""

MIN_DEGREES_OF_FREEDOM = 2.5
"""Degrees of freedom that a group needs for a noise estimate from its residuals: at two the
variance of Student's distribution is infinite."""

ACCURACY = 0.01
"""Unknown noise of a measurement, as a share of the largest one: bench instruments are
specified to about 1 %."""

TOLERANCE = 1e-7
"""Relative change of cost and step at which a search has converged: noise levels change by more."""

_STEP = 1e-6
"""Relative step of a central difference: its error is 1e-12 of the slope, rounding 1e-10."""

Predict = Callable[[MotorConstants, Array], tuple[Array, ...]]


@dataclass(frozen=True, eq=False)
class Part:
    """Measurements of one experiment, and how the constants predict them.

    Attributes:
        kind: the experiment in words.
        quantities: what was read, by name.
        measured: (N,) each.
        floor: smallest noise level of each: that of its resolution.
        predict: constants and initial state → the same quantities.
        start: first guess of the initial state; empty in steady state.
        known: whether ``floor`` is the noise level itself.
    """

    name: str
    kind: str
    quantities: tuple[str, ...]
    measured: tuple[Array, ...]
    floor: tuple[float, ...]
    predict: Predict
    start: Array = field(default_factory=lambda: np.zeros(0))
    known: bool = False


@dataclass(frozen=True)
class Group:
    """The residuals of one quantity of one experiment.

    Attributes:
        noise: estimated noise level, in SI.
        relative: noise level over the root mean square of the measurements.
        freedom: degrees of freedom it comes from.
        floor: whether the resolution of the measurements decides it.
        residuals: measured less predicted, in SI.
    """

    name: str = field(metadata={"alias": "file"})
    kind: str = field(metadata={"alias": "experiment"})
    quantity: str
    noise: float
    relative: float = field(metadata={"alias": "noise_relative"})
    freedom: float = field(metadata={"alias": "degrees_of_freedom"})
    floor: bool = field(metadata={"alias": "at_resolution"})
    residuals: tuple[float, ...] = field(metadata={"exclude": True})


@dataclass(frozen=True, eq=False)
class JointFit:
    """Constants from all experiments.

    Attributes:
        theta, covariance: estimates and their covariance.
        at_bound: names of those that ended at zero.
        sigma: noise levels by (file, quantity).
        undetermined: names about which the measurements say nothing.
    """

    names: tuple[str, ...]
    theta: Array
    covariance: Array
    constants: MotorConstants
    groups: tuple[Group, ...]
    at_bound: tuple[str, ...]
    termination: Termination
    sigma: Mapping[tuple[str, str], float]
    undetermined: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Constants, correlations, residuals by file and quantity, and the ending."""
        errors = np.sqrt(np.diag(self.covariance)).tolist()
        return {
            "parameters": [
                {"name": n, "value": v, "std_error": e, "unit": CONSTANTS[n][0]}
                for n, v, e in zip(self.names, self.theta.tolist(), errors, strict=True)
            ],
            "correlations": {"names": self.names, "matrix": correlations(self.covariance)},
            "residuals": self.groups,
            "at_bound": self.at_bound,
            "termination": self.termination.code,
        }


def correlations(covariance: Array) -> Array:
    """Correlation matrix of estimates, (n, n); the unit matrix where one is not determined."""
    s = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        matrix = covariance / np.outer(s, s)
    return np.where(np.isfinite(matrix), matrix, np.eye(len(s)))


def steady_part(test: SteadyTest, gear: float) -> Part:
    """A test in steady state as a part of the fit."""
    quantities = test.answers()
    rows = [np.isfinite(test.of(q)) for q in quantities]
    torque = test.motor_torque(gear)

    def predict(c: MotorConstants, _: Array) -> tuple[Array, ...]:
        if test.kind in (Kind.BLOCKED, Kind.STALL):
            stalled = test.voltage / c.R
            net = c.Kc * stalled - np.sign(test.voltage) * c.C0
            every = {"current": stalled, "torque": net if test.motor_side else net * gear}
        else:
            load = gear * np.abs(torque)
            speed, current = steady_state(c, test.voltage, load)
            every = {"current": current, "speed": speed}
        return tuple(every[q][ok] for q, ok in zip(quantities, rows, strict=True))

    measured = tuple(test.of(q)[ok] for q, ok in zip(quantities, rows, strict=True))
    floor = tuple(test.resolution.get(q, 0.0) / np.sqrt(12.0) for q in quantities)
    return Part(test.name, test.kind.value, quantities, measured, floor, predict)


def known_part(value: KnownValue) -> Part:
    """A known value as a measurement of the constant itself."""
    name = value.name

    def predict(c: MotorConstants, _: Array) -> tuple[Array, ...]:
        return (np.array([float(getattr(c, name))]),)

    return Part(
        value.source,
        "known value",
        (name,),
        (np.array([value.value]),),
        (max(value.std_error, 1e-9 * value.value),),
        predict,
        known=True,
    )


def fit_jointly(
    parts: Sequence[Part], names: Sequence[str], starts: Sequence[MotorConstants], tied: bool
) -> JointFit:
    """Estimate constants from all parts.

    min Σ (reading − prediction)²/σ² over the constants, σ² of each group its residual sum of
    squares over its degrees of freedom, not below its resolution.

    Args:
        starts: where the search may begin, the one that errs least is taken; others than these
            constants are held there.
        tied: whether Kc is Kem.
    """
    measurements = sum(len(m) for part in parts for m in part.measured)
    if measurements < len(names):
        raise DataError(
            f"{measurements} measurements do not determine {len(names)} constants "
            f"({', '.join(names)}); measure at more voltages"
        )
    problem = min((_Bench(parts, names, s, tied) for s in starts), key=lambda b: b.cost(b.first()))
    # with equal weights first: levels from residuals of a poor start hold the search there
    p = levenberg_marquardt(problem, problem.first(), problem.descent()).p
    groups = _groups(problem, p)
    for _ in range(ROUNDS):
        problem.noise_levels = np.array([g.noise for g in groups])
        solution = levenberg_marquardt(problem, p, problem.descent())
        p = solution.p
        after = _groups(problem, p)
        change = max(abs(a.noise / b.noise - 1.0) for a, b in zip(after, groups, strict=True))
        groups = after
        if change < SETTLED:
            break
    r, J = problem.residual(p), problem.jacobian(p)
    stretches = list(zip(problem.channels, problem.lengths, strict=True))
    worth = uncertainty(J, r, stretches, np.ones(len(r)))
    n = len(names)
    # noise levels are estimated per group, or known: no common factor is left to estimate
    if worth.coloured:
        covariance = worth.covariance
    else:
        covariance = _with_uneven_noise(worth.covariance / worth.variance, J, r)
    stuck = tuple(names[k] for k in solution.at_bound if k < n)
    undetermined = tuple(names[k] for k in range(n) if not np.isfinite(covariance[k, k]))
    return JointFit(
        tuple(names),
        p[:n],
        covariance[:n, :n],
        problem.constants(p),
        groups,
        stuck,
        solution.termination,
        {(g.name, g.quantity): g.noise for g in groups},
        undetermined,
    )


class _Bench(Problem):
    """Residuals of all parts over their noise levels."""

    def __init__(
        self, parts: Sequence[Part], names: Sequence[str], fixed: MotorConstants, tied: bool
    ) -> None:
        self.parts, self.names, self.fixed, self.tied = tuple(parts), tuple(names), fixed, tied
        self.index = np.arange(len(names))
        self.n_initial = sum(len(part.start) for part in parts)
        sizes = [len(m) for part in parts for m in part.measured]
        self.lengths, self.channels = tuple(sizes), tuple(range(len(sizes)))
        # before any residual is known: a twentieth of each quantity
        sizes_of = [float(np.sqrt(np.mean(m**2))) for part in parts for m in part.measured]
        self.noise_levels: Array = np.array([0.05 * s if s > 0.0 else 1.0 for s in sizes_of])
        self.scale = np.array([max(abs(float(getattr(fixed, n))), 1e-12) for n in names])

    def first(self) -> Array:
        starts = [part.start for part in self.parts]
        values = np.array([float(getattr(self.fixed, n)) for n in self.names])
        return np.concatenate([values, *starts])

    def cost(self, p: Array) -> float:
        """Sum of squares, infinite where that is no number."""
        r = self.residual(p)
        return float(r @ r) if np.all(np.isfinite(r)) else np.inf

    def descent(self) -> Descent:
        """Friction, inertia and inductance not below zero, the rest above."""
        free = np.ones(len(self.names) + self.n_initial, dtype=bool)
        lower = np.full(len(free), -np.inf)
        for k, name in enumerate(self.names):
            lower[k] = 0.0 if name in ("f", "C0", "L") else 1e-6 * self.scale[k]
        return Descent(free, lower, np.full(len(free), np.inf), tolerance=TOLERANCE)

    def constants(self, p: Array) -> MotorConstants:
        values = dict(zip(self.names, p.tolist(), strict=False))
        if self.tied and "Kem" in values:
            values["Kc"] = values["Kem"]
        return replace(self.fixed, **values)

    def differences(self, p: Array) -> list[Array]:
        """Measured less predicted of every group, in SI."""
        c, at, differences = self.constants(p), len(self.names), []
        for part in self.parts:
            unknowns = p[at : at + len(part.start)]
            at += len(part.start)
            predicted = part.predict(c, unknowns)
            differences += [m - q for m, q in zip(part.measured, predicted, strict=True)]
        return differences

    def residual(self, p: Array) -> Array:
        return np.concatenate(
            [d / s for d, s in zip(self.differences(p), self.noise_levels, strict=True)]
        )

    def jacobian(self, p: Array) -> Array:
        """Central differences, of initial states over ``_STEP``."""
        steps = np.full(len(p), _STEP)
        n = len(self.names)
        steps[:n] *= np.maximum(np.abs(p[:n]), 1e-3 * self.scale)
        return slopes(self.residual, p, steps)


def _groups(problem: _Bench, p: Array) -> tuple[Group, ...]:
    """Noise level of every group: residuals over degrees of freedom, not below the resolution."""
    differences = problem.differences(p)
    leverage = _leverage(problem.jacobian(p))
    groups, at, k = [], 0, 0
    for part in problem.parts:
        for q, m, floor in zip(part.quantities, part.measured, part.floor, strict=True):
            n, d = len(m), differences[k]
            freedom = n - float(np.sum(leverage[at : at + n]))
            size = float(np.sqrt(np.mean(m**2))) or 1.0
            estimated = freedom > MIN_DEGREES_OF_FREEDOM and not part.known
            # a level from few residuals may be small by chance: Student's variance is that of ν − 2
            level = float(np.sqrt(d @ d / (freedom - 2.0))) if estimated else 0.0
            least = floor if estimated or part.known else max(floor, ACCURACY * size)
            noise = max(level, least, 1e-12 * size)
            groups.append(
                Group(
                    part.name, part.kind, q, noise, noise / size, freedom, level <= least,
                    tuple(d.tolist()),
                )
            )  # fmt: skip
            at, k = at + n, k + 1
    return tuple(groups)


def _with_uneven_noise(covariance: Array, J: Array, r: Array) -> Array:
    """The covariance with errors not below what residuals of uneven size say.

        C' = C Jᵀ diag(r²/(1 − h)²) J C

    (MacKinnon and White 1985, HC3.) Instruments err by a share of the measurement: large
    measurements, which turn a line the most, err by more than the one level of their group. Errors
    are widened, never made smaller, and correlations are kept.

    Args:
        covariance: (JᵀJ)⁻¹, (n, n).
        J, r: of residuals over their noise levels, (M, n) and (M,).
    """
    free = 1.0 - _leverage(J)
    enough = free > LEAST_FREE
    size = np.where(enough, np.square(r / np.where(enough, free, 1.0)), 1.0)
    known = np.isfinite(np.diag(covariance))
    C = np.where(np.outer(known, known), covariance, 0.0)
    uneven = np.diag(C @ (J.T * size) @ J @ C)
    even = np.where(known & (np.diag(C) > 0.0), np.diag(C), np.inf)
    wider = np.sqrt(np.maximum(uneven / even, 1.0))
    return np.asarray(covariance * np.outer(wider, wider))


LEAST_FREE = 0.05
"""Share of a measurement that the estimates leave free below which its residual gives no noise
estimate: a value that is known is taken up whole."""


def _leverage(J: Array) -> Array:
    """Diagonal of J (JᵀJ)⁺ Jᵀ: how much of each measurement the estimates take up, (M,)."""
    size = np.linalg.norm(J, axis=0)
    size[size == 0.0] = 1.0
    U, s, _ = np.linalg.svd(J / size, full_matrices=False)
    kept = U[:, s > 1e-10 * s.max(initial=0.0)]
    return np.asarray(np.sum(kept**2, axis=1))
