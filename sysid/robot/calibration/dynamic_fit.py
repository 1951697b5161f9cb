"""Masses, friction and stiffness of a vehicle, from commands, speeds and pose.

Errors of the wheel speeds in runs of the dynamics, and errors of increments of the pose over two
seconds, both in units of their typical size, are fitted together: torques determine masses and
friction through the speeds, the pose determines the slip under these forces. Lengths, marker and
lags of the pose are fitted along, so that a constant share of slip, which is nothing but another
radius or width, is not taken for the ground's stiffness.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from sysid.data.record import Array, Index
from sysid.errors import DataError
from sysid.fitting.normal_equations import RANK_TOLERANCE
from sysid.fitting.problem import Problem
from sysid.fitting.solvers import Descent, levenberg_marquardt
from sysid.fitting.uncertainty import sandwich, with_infinite
from sysid.robot.calibration.dynamic_runs import NUMBERS, Log, Machine, Runs, pieces_of
from sysid.robot.calibration.slip_fit import Part, SlipFit, fit_slip
from sysid.robot.calibration.slip_model import AT, LOWER, TERMS, window_errors
from sysid.robot.calibration.trajectory import Trajectory
from sysid.robot.calibration.windows import OVERLAP
from sysid.vehicle.kinematics import Geometry

BODY = slice(0, 5)
"""Mass, yaw inertia, resistances and compliance among ``NUMBERS``."""

MOTOR = slice(5, 9)
"""The motors' numbers. They are held at what the bench says, and its errors are carried into those
of the result: rotors and mass look alike, and a drive distinguishes them only by what the
model has wrong."""

DRAWN = NUMBERS.index("grip")
"""The largest thrust, which is drawn to what is given as far as that is uncertain."""

GRIP = 0.3
"""Standard deviation of the largest thrust over what is given: floors of one name differ by it."""

IMBALANCE, DELAY = NUMBERS.index("imbalance"), NUMBERS.index("delay")

N = len(NUMBERS)

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

LENGTHS = ("radius_left", "radius_right", "effective_width")
PLACE = ("marker_x", "marker_y", "heading_offset")
LAGS = ("pose_lag", "heading_lag")


@dataclass(frozen=True, eq=False)
class Powered:
    """What drives a vehicle, as far as it is known.

    Attributes:
        machine: lengths, motors and soil; its masses are where a search starts.
        logs: commands and speeds of every trajectory.
        spreads: standard errors of the motors' torque, damping, inertia and friction over their
            values, (4,); 0 for what counts as exact.
        torque_known: whether the torque per unit of command is known. Else damping is 1, and all
            other numbers come in units of it.
        rotors_known: whether the motors' damping and inertia are known, too. Else what moves with
            the rotors counts as the vehicle's.
    """

    machine: Machine
    logs: tuple[Log, ...]
    spreads: Array
    torque_known: bool = True
    rotors_known: bool = True
    unit: str = ""

    @cached_property
    def runs(self) -> Runs:
        """Runs over all logs.

        Raises:
            DataError: their sample times differ.
        """
        times = sorted({log.dt for log in self.logs})
        if times[-1] > 1.001 * times[0]:
            raise DataError(
                f"the logs have sample times from {times[0]:g} to {times[-1]:g} s: give logs of "
                "one sample time (`ts`), or fit them separately"
            )
        return Runs(self.machine, pieces_of(self.logs))

    def log_of(self, trajectory: Trajectory) -> int:
        """Number of the log that holds a trajectory."""
        return next(k for k, log in enumerate(self.logs) if log.trajectory is trajectory)


@dataclass(frozen=True, eq=False)
class DynamicFit:
    """Numbers found, and what they are worth.

    Attributes:
        p: every number as it is searched: logarithms of masses, others over where they start, the
            motors' logarithms, imbalance and delay, then those of the slip model.
        free: which of them are in the model.
        covariance: of the free ones; infinite where the log says nothing.
        geometry: lengths that the slip model's numbers multiply.
        typical: of the speeds' errors [rad/s] and of the increments' [m, m, rad], (5,).
        before: the slip model with lengths, marker and lags alone.
    """

    powered: Powered
    p: Array
    free: tuple[int, ...]
    covariance: Array
    geometry: Geometry
    typical: Array
    before: SlipFit

    @property
    def theta(self) -> Array:
        """``NUMBERS``."""
        return theta_of(self.powered.machine, self.p)

    @property
    def q(self) -> Array:
        """Numbers of the slip model."""
        return self.p[N:]

    @cached_property
    def slipped(self) -> Array:
        """What slip adds to the body's speeds, in all pieces."""
        return self.powered.runs.outputs(self.theta)[1]

    def errors(self, parts: Sequence[Part]) -> Array:
        """Measured minus predicted increments of windows, (W, 3) [m, m, rad]."""
        errors = [
            window_errors(self.q, p.trajectory, self.geometry, p.windows, self.added(p.trajectory))
            for p in parts
        ]
        return np.concatenate(errors)

    def added(self, trajectory: Trajectory) -> Array:
        """Way and turn that slip adds in each step of a trajectory's grid, (N, 3) [m, m, rad]."""
        return on_grid(self.powered, trajectory, self.slipped)


def theta_of(machine: Machine, p: Array) -> Array:
    """``NUMBERS`` of a vector as it is searched."""
    theta = machine.numbers()
    theta[:2] *= np.exp(p[:2])
    theta[2:5] *= p[2:5]
    theta[5:10] = np.exp(p[5:10])
    theta[IMBALANCE], theta[DELAY] = p[IMBALANCE], p[DELAY]
    return theta


def on_grid(powered: Powered, trajectory: Trajectory, slipped: Array) -> Array:
    """Speeds of all samples in the pieces, (S, T, 3), as increments on a grid, (N, 3)."""
    which = powered.log_of(trajectory)
    dt = powered.logs[which].dt
    rows = powered.runs.pieces.joined(slipped, which)
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(rows * dt, axis=0)])
    at = np.arange(len(total)) * dt
    columns = [np.interp(trajectory.nodes, at, total[:, k]) for k in range(3)]
    return np.diff(np.column_stack(columns), axis=0)


@dataclass(frozen=True, eq=False)
class _DynamicProblem(Problem):
    """White errors of speeds and increments, then what draws the grip to what is given."""

    powered: Powered
    parts: tuple[Part, ...]
    geometry: Geometry
    typical: Array
    free: tuple[int, ...]
    steps: Array
    index: Index = field(default_factory=lambda: np.arange(N + len(TERMS)))
    n_initial: int = 0

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
    def lengths(self) -> tuple[int, ...]:  # type: ignore[override]
        """Residuals of each stretch."""
        return tuple(n for _, n in self.stretches)

    @property
    def channels(self) -> tuple[int, ...]:  # type: ignore[override]
        """Output of each."""
        return tuple(c for c, _ in self.stretches)

    def differences(self, p: Array) -> tuple[list[Array], list[Array]]:
        """Errors of the speeds (rows, 2) log by log, and of increments (W, 3) part by part."""
        speeds, slipped = self.powered.runs.outputs(theta_of(self.powered.machine, p))
        return self._speed_errors(speeds), self._way_errors(p[N:], slipped)

    def _speed_errors(self, speeds: Array) -> list[Array]:
        pieces = self.powered.runs.pieces
        return [
            self.powered.logs[k].omega[rows] - pieces.joined(speeds, k)[rows]
            for k, rows in self.judged
        ]

    def _way_errors(self, q: Array, slipped: Array) -> list[Array]:
        return [
            window_errors(
                q,
                p.trajectory,
                self.geometry,
                p.windows,
                on_grid(self.powered, p.trajectory, slipped),
            )
            for p in self.parts
        ]

    def _white(self, speeds: Sequence[Array], ways: Sequence[Array]) -> Array:
        """In units of the typical errors; overlapping windows share their information."""
        rolled = [np.nan_to_num(e / self.typical[:2]).T.ravel() for e in speeds]
        moved = [(e / self.typical[2:]).T.ravel() / np.sqrt(OVERLAP) for e in ways]
        return np.concatenate([*rolled, *moved])

    def residual(self, p: Array) -> Array:
        """Of speeds, of increments, and of what is given for the grip."""
        return np.append(self._white(*self.differences(p)), p[DRAWN] / GRIP)

    def jacobian(self, p: Array) -> Array:
        """Slopes of the runs by JAX, of the pose by central differences along them."""
        J = np.zeros((sum(self.lengths), N + len(TERMS)))
        runs, q = self.powered.runs, p[N:]
        theta = theta_of(self.powered.machine, p)
        inner = [k for k in self.free if k < N]
        _, slipped = runs.outputs(theta)
        by_speed, by_slip = runs.slopes(theta, inner)
        stretch = _stretched(self.powered.machine, theta)
        for k, dspeeds, dslipped in zip(inner, by_speed, by_slip, strict=True):
            rolled = [-e for e in self._changes(dspeeds * stretch[k])]
            change = dslipped * stretch[k]
            moved = self._along(q, slipped, change)
            J[:-1, k] = self._white(rolled, moved)
        for k in (k for k in self.free if k >= N):
            h = self.steps[k - N]
            up, down = q.copy(), q.copy()
            up[k - N] += h
            down[k - N] -= h
            none = [np.zeros((len(rows), 2)) for _, rows in self.judged]
            both = zip(self._way_errors(up, slipped), self._way_errors(down, slipped), strict=True)
            J[:-1, k] = self._white(none, [(a - b) / (2.0 * h) for a, b in both])
        J[-1, DRAWN] = 1.0 / GRIP
        return J

    def _changes(self, speeds: Array) -> list[Array]:
        pieces = self.powered.runs.pieces
        return [
            np.where(
                np.isfinite(self.powered.logs[k].omega[rows]),
                pieces.joined(speeds, k)[rows],
                0.0,
            )
            for k, rows in self.judged
        ]

    def _along(self, q: Array, slipped: Array, change: Array) -> list[Array]:
        """Change of the increments' errors per unit of a change of the slip."""
        h = SMALL / (float(np.abs(change).max()) or 1.0)
        up = self._way_errors(q, slipped + h * change)
        down = self._way_errors(q, slipped - h * change)
        return [(a - b) / (2.0 * h) for a, b in zip(up, down, strict=True)]


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
    mask = np.zeros(len(p), dtype=bool)
    mask[list(problem.free)] = True
    solution = None
    for _ in range(ROUNDS):
        problem = _weighed(problem, p)
        huber = np.full(sum(problem.lengths), FAR)
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
    return DynamicFit(
        problem.powered,
        p,
        problem.free,
        covariance,
        problem.geometry,
        problem.typical,
        before,
    )


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
    speeds, ways = problem.differences(p)
    rolled, moved = np.concatenate(speeds), np.concatenate(ways)
    typical = np.concatenate(
        [
            1.4826 * np.nanmedian(np.abs(rolled), axis=0),
            1.4826 * np.median(np.abs(moved), axis=0),
        ]
    )
    other = replace(problem, typical=np.maximum(typical, SMALLEST))
    for name in ("judged", "stretches"):
        other.__dict__[name] = getattr(problem, name)
    return other


def _covariance(J: Array, residual: Array, weights: Array, problem: _DynamicProblem) -> Array:
    """H⁻¹ S H⁻¹: H = JᵀJ with the priors, S the covariance of the score with the errors' memory.

    Windows overlap and what the model leaves lasts for samples; both are in the autoregression
    that is fitted to the errors of each output.
    """
    scale = np.linalg.norm(J, axis=0)
    scale[scale == 0.0] = 1.0
    _, s, Vt = np.linalg.svd(J / scale, full_matrices=False)
    keep = s > s.max(initial=0.0) * RANK_TOLERANCE
    half = Vt[keep].T / s[keep] / scale[:, None]
    score = residual * weights
    edges = np.cumsum([0, *problem.lengths])
    pieces: dict[int, list[slice]] = {}
    for (channel, _), a, b in zip(problem.stretches, edges[:-1], edges[1:], strict=True):
        pieces.setdefault(channel, []).append(slice(int(a), int(b)))
    drawn = J[pieces.pop(5)[0]] @ half
    covariance = half @ (drawn.T @ drawn) @ half.T
    rows = edges[-2]
    for where in pieces.values():
        covariance += sandwich(half, [J[w] for w in where], [score[w] for w in where])
    covariance *= rows / max(rows - len(s), 1)
    return with_infinite(covariance, Vt[~keep].T)
