"""Masses, friction and stiffness of a vehicle, from commands, speeds and pose.

Errors of the wheel speeds in runs of the dynamics, and errors of increments of the pose over two
seconds, both in units of their typical size, are fitted together: torques determine masses and
friction through the speeds, the pose determines the slip under these forces. Lengths, marker and
lags of the pose are fitted along, so that a constant share of slip, which is nothing but another
radius or width, is not taken for the ground's stiffness.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid.data.record import Array, Index
from sysid.fitting.differences import slopes
from sysid.fitting.problem import LeastSquares
from sysid.fitting.solvers import Descent, Solution, levenberg_marquardt
from sysid.fitting.uncertainty import half_and_null, sandwich, slices_by_output, with_infinite
from sysid.robot.calibration.dynamic_estimate import (
    DELAY,
    IMBALANCE,
    LENGTHS,
    DynamicFit,
    N,
    Powered,
    on_grid,
    theta_of,
)
from sysid.robot.calibration.dynamic_runs import NUMBERS, Machine
from sysid.robot.calibration.slip_estimate import SlipFit
from sysid.robot.calibration.slip_fit import fit_slip
from sysid.robot.calibration.slip_model import AT, LOWER, TERMS, Kinematic
from sysid.robot.calibration.trajectory import Part
from sysid.robot.calibration.windows import OVERLAP
from sysid.vehicle.kinematics import Geometry

MOTOR = slice(5, 9)
"""The motors' numbers. They are held at what the bench says, and its errors are carried into those
of the result: rotors and mass look alike, and a drive distinguishes them only by what the
model has wrong."""

DRAWN = NUMBERS.index("grip")
"""The largest thrust, which is drawn to what is given as far as that is uncertain."""

GRIP = 0.3
"""Standard deviation of the largest thrust over what is given: floors of one name differ by it."""

FAR = 3.0
"""Errors beyond so many times the typical one count less (Huber 1964): stones, late poses."""

ROUNDS = 3
"""Times that typical errors are found anew; they hardly move after two."""

EVALUATIONS = 25
"""Of each round; a fit that begins with masses ten times too large needs fifteen."""

WIDEST = 4.0
"""Masses may be e⁴ times as large or small as where the search starts."""

SHOWN = 4.0
"""Standard errors by which a lag must be off nothing to be in the model."""

SMALLEST = 1e-6
"""Typical errors are not taken to be smaller (logs without noise) [rad/s, m, rad]."""

SMALL = 1e-3
"""Largest change of a speed [m/s, rad/s] in the differences along a slope of the slip."""

LATEST = 1.0
"""Commands act within so many seconds of where they are logged; a log may also hold them late."""

PLACE = ("marker_x", "marker_y", "heading_offset")
LAGS = ("pose_lag", "heading_lag")


@dataclass(frozen=True, eq=False)
class _DynamicProblem(LeastSquares):
    """White errors of speeds and increments, then what draws the grip to what is given."""

    powered: Powered
    parts: tuple[Part, ...]
    geometry: Geometry
    typical: Array
    free: tuple[int, ...]
    steps: Array

    @cached_property
    def judged(self) -> tuple[tuple[int, Index], ...]:
        """Logs with the rows that their windows span."""
        judged: dict[int, Index] = {}
        for part in self.parts:
            which = self.powered.log_of(part.trajectory)
            log = self.powered.logs[which]
            t = np.arange(len(log.omega)) * log.dt
            begin, end = (
                part.trajectory.at[part.windows[0, 0]],
                part.trajectory.at[part.windows[:, 1].max()],
            )
            judged[which] = np.flatnonzero((t >= begin - 1e-9) & (t <= end + 1e-9))
        return tuple(judged.items())

    @cached_property
    def stretches(self) -> tuple[tuple[int, int], ...]:
        """(output, residuals) of each stretch of time: two speeds, three increments; the priors."""
        speeds = [(side, len(rows)) for _, rows in self.judged for side in (0, 1)]
        windows = [(2 + k, len(p.windows)) for p in self.parts for k in range(3)]
        return (*speeds, *windows, (5, 1))

    @property
    def size(self) -> int:
        """How many residuals there are."""
        return sum(n for _, n in self.stretches)

    def speed_errors(self, speeds: Array, share: float = 1.0) -> list[Array]:
        """A share of the measured speeds less those of a run, (rows, 2) log by log."""
        joined = self.powered.runs.pieces.joined
        return [
            share * self.powered.logs[k].omega[rows] - joined(speeds, k)[rows]
            for k, rows in self.judged
        ]

    def way_errors(self, q: Array, slipped: Array) -> list[Array]:
        """Errors of increments, (W, 3) part by part."""
        motion = Kinematic(self.geometry, q, lambda d: on_grid(self.powered, d, slipped))
        return [motion.errors([p]) for p in self.parts]

    def _white_speeds(self, errors: Sequence[Array]) -> Array:
        """In units of the typical ones; a speed that is not there errs by nothing."""
        white = [np.nan_to_num(e / self.typical[:2]).T.ravel() for e in errors]
        return np.concatenate(white)

    def _white_ways(self, q: Array, slipped: Array) -> Array:
        """In units of the typical errors; overlapping windows share their information."""
        errors = self.way_errors(q, slipped)
        white = [(e / self.typical[2:]).T.ravel() / np.sqrt(OVERLAP) for e in errors]
        return np.concatenate(white)

    def residual(self, p: Array) -> Array:
        """Of speeds, of increments, and of what is given for the grip."""
        speeds, slipped = self.powered.runs.outputs(theta_of(self.powered.machine, p))
        rolled = self._white_speeds(self.speed_errors(speeds))
        return np.concatenate([rolled, self._white_ways(p[N:], slipped), [p[DRAWN] / GRIP]])

    def jacobian(self, p: Array) -> Array:
        """Slopes of the runs by JAX, of the pose by central differences along them."""
        J = np.zeros((self.size, N + len(TERMS)))
        runs, q = self.powered.runs, p[N:]
        theta = theta_of(self.powered.machine, p)
        inner = [k for k in self.free if k < N]
        _, slipped = runs.outputs(theta)
        stretch = _stretched(self.powered.machine, theta)
        ways = slice(2 * sum(len(rows) for _, rows in self.judged), -1)
        for k, dspeeds, dslipped in zip(inner, *runs.slopes(theta, inner), strict=True):
            rolled, change = dspeeds * stretch[k], dslipped * stretch[k]
            J[: ways.start, k] = self._white_speeds(self.speed_errors(rolled, 0.0))
            step = np.array([SMALL / (float(np.abs(change).max()) or 1.0)])

            def along(x: Array, change: Array = change) -> Array:
                return self._white_ways(q, slipped + x[0] * change)

            J[ways, [k]] = slopes(along, np.zeros(1), step)
        steps = np.where(np.isin(np.arange(N, N + len(TERMS)), self.free), self.steps, 0.0)
        J[ways, N:] = slopes(lambda x: self._white_ways(x, slipped), q, steps)
        J[-1, DRAWN] = 1.0 / GRIP
        return J


def _stretched(machine: Machine, theta: Array) -> Array:
    """∂θ/∂p, (N,)."""
    slopes = np.ones(N)
    slopes[:2] = theta[:2]
    slopes[2:5] = machine.numbers()[2:5]
    slopes[5:10] = theta[5:10]
    return slopes


def fit_dynamics(parts: Sequence[Part], start: Geometry, powered: Powered) -> DynamicFit:
    """The numbers that bring the runs next to what was measured.

    Args:
        parts: windows of every trajectory; speeds count in the time that they span.
        start: lengths near those of the vehicle as it turns.
    """
    parts = tuple(parts)
    before = fit_slip(parts, start, ())
    q, lags = before.q.copy(), []
    dt = powered.logs[0].dt
    for name in LAGS:
        k = AT[name]
        if abs(q[k]) > max(SHOWN * before.std_errors[k], 0.5 * dt):
            lags.append(name)
        else:
            q[k] = 0.0
    p = np.concatenate([np.zeros(2), np.ones(3), np.zeros(N - 5), q])
    motors = []
    if not powered.rotors_known:
        weakest = "damping" if powered.torque_known else "torque"
        motors.append(NUMBERS.index(weakest))
    terms = [N + AT[name] for name in (*LENGTHS, *PLACE, *lags)]
    free = (*range(5), *motors, DRAWN, IMBALANCE, DELAY, *terms)
    first = _DynamicProblem(
        powered, parts, start, np.ones(5), tuple(sorted(free)), 1e-3 * before.prior
    )
    return _settled(first, p, before)


def _settled(problem: _DynamicProblem, p: Array, before: SlipFit) -> DynamicFit:
    least = np.array([-WIDEST, -WIDEST, 0.0, 0.0, 1e-4])
    lower = np.concatenate([least, np.full(5, -WIDEST), [-1.0, -LATEST]])
    upper = np.concatenate([np.full(2, WIDEST), np.full(3, 1e4), np.full(5, WIDEST), [1.0, LATEST]])
    mask = np.isin(np.arange(len(p)), problem.free)
    solution: Solution | None = None
    for _ in range(ROUNDS):
        problem = _weighed(problem, p)
        huber = np.full(problem.size, FAR)
        how = Descent(
            mask,
            np.concatenate([lower, LOWER]),
            np.concatenate([upper, np.full(len(TERMS), np.inf)]),
            huber=huber,
            max_evaluations=EVALUATIONS,
            tolerance=1e-6,
        )
        solution = levenberg_marquardt(problem, p, how)
        p = solution.p
    assert solution is not None
    free = list(problem.free)
    J = solution.jacobian[:, free]
    covariance = _covariance(J, solution.residual, solution.weights, problem)
    covariance += _carried(problem, p, J)
    return DynamicFit(problem.powered, p, problem.free, covariance, problem.geometry, before)


def _carried(problem: _DynamicProblem, p: Array, J: Array) -> Array:
    """What the errors of the bench's numbers do to those found: G Σ Gᵀ, G = −(JᵀJ)⁻¹JᵀJ_motor."""
    spreads = problem.powered.spreads
    motors = [MOTOR.start + k for k in range(4) if spreads[k] > 0.0]
    if not motors:
        return np.zeros((J.shape[1], J.shape[1]))
    by_motor = replace(problem, free=tuple(motors)).jacobian(p)[:, motors]
    G = np.linalg.lstsq(J, by_motor, rcond=None)[0] * spreads[spreads > 0.0]
    return np.asarray(G @ G.T)


def _weighed(problem: _DynamicProblem, p: Array) -> _DynamicProblem:
    """The problem with typical errors as these numbers leave them."""
    speeds, slipped = problem.powered.runs.outputs(theta_of(problem.powered.machine, p))
    errors = problem.speed_errors(speeds), problem.way_errors(p[N:], slipped)
    typical = [1.4826 * np.nanmedian(np.abs(np.concatenate(e)), axis=0) for e in errors]
    other = replace(problem, typical=np.maximum(np.concatenate(typical), SMALLEST))
    for name in ("judged", "stretches"):
        other.__dict__[name] = getattr(problem, name)
    return other


def _covariance(J: Array, residual: Array, weights: Array, problem: _DynamicProblem) -> Array:
    """H⁻¹ S H⁻¹: H = JᵀJ with the priors, S the covariance of the score with the errors' memory.

    Windows overlap and what the model leaves lasts for samples; both are in the autoregression
    that is fitted to the errors of each output.
    """
    half, null = half_and_null(J)
    score = residual * weights
    pieces = slices_by_output(problem.stretches)
    drawn = J[pieces.pop(5)[0]] @ half
    covariance = half @ (drawn.T @ drawn) @ half.T
    rows = len(J) - 1
    for where in pieces.values():
        covariance += sandwich(half, [J[w] for w in where], [score[w] for w in where])
    covariance *= rows / max(rows - J.shape[1], 1)
    return with_infinite(covariance, null)
