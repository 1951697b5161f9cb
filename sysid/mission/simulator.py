"""The closed loop guidance → control → plant → navigation, simulated until the mission ends."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

import numpy as np

from sysid.data.record import Array, Channel
from sysid.effects.ground import Ground
from sysid.errors import ModelError
from sysid.mission.control import STANDSTILL, Commands, control
from sysid.mission.guidance import InitialTurn, Pose, References, guide
from sysid.mission.navigation import Estimate, Navigation, Odometry
from sysid.mission.result import (
    COLUMNS,
    STUCK_PROGRESS,
    STUCK_TIME,
    MissionResult,
    Outcome,
    write_log,
)
from sysid.mission.spec import Mission
from sysid.mission.stuck import why_stuck
from sysid.vehicle.kinematics import body_velocity, step_pose, wrap_angle

__all__ = [
    "ROBOT_INPUTS",
    "ROBOT_OUTPUTS",
    "MissionResult",
    "Outcome",
    "SteppablePlant",
    "simulate",
    "write_log",
]

ROBOT_INPUTS = (Channel("pwm_l", "µs"), Channel("pwm_r", "µs"))
ROBOT_OUTPUTS = (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s"))

MOST_SAMPLES = 5_000_000
"""A mission with more plant samples than this would not end while somebody waits."""
_DIVERGED = 1e6
"""No wheel turns this fast [rad/s]; above it the plant's output is running away."""


class SteppablePlant(Protocol):
    """A sampled system that the mission simulator can run: u(k) held over [k dt, (k + 1) dt).

    An optional attribute ``ground`` (:class:`sysid.effects.ground.Ground`) says what the tracks
    lose on their way to the ground. Two more optional attributes, looked up by
    :func:`sysid.mission.mapping.as_robot` on plants that are no robots: ``input_range``,
    (low, high) of each input in the data it was identified from, and ``u_offset``, the value of
    each input around which it was identified.

    Attributes:
        dt: sample time [s].
        inputs, outputs: the channels of u (nu,) and y (ny,), in physical units.
    """

    @property
    def dt(self) -> float: ...

    @property
    def inputs(self) -> tuple[Channel, ...]: ...

    @property
    def outputs(self) -> tuple[Channel, ...]: ...

    def initial_state(self) -> Array:
        """Return the state at rest."""
        ...

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        """Return the next state and the output y(k) at this sample; ``state`` stays as it is."""
        ...


def simulate(
    mission: Mission, plant: SteppablePlant, navigation: Navigation | None = None
) -> MissionResult:
    """Drive a robot plant through a mission.

    Two clocks run on one time line: the plant's, t = k·dt, and the controller's, t = j·period; no
    ratio between them is asked for. At a control instant guidance and control use the latest
    wheel-speed reading, the one of the same instant included; their command is held and reaches
    the plant at its first sample at or after the instant. Between samples of the plant nothing
    new is read, so a controller faster than the plant repeats itself on held readings (its
    integral still counts time), and one slower than the plant holds its command over several.

    A reading at t = k·dt is y(k) under the command held so far. For plants whose y(k) does not
    depend on u(k) that is y(k) itself; with feed-through the logged y(k) belongs to the new u(k).
    The vehicle moves by the kinematics (2.14), the track speeds varying linearly between samples,
    after what the plant's ``ground`` takes off them; navigation sees the wheels alone.

    A mission ends at the first sample where the robot has touched an obstacle (clearance ≤ 0
    anywhere on the way there), guidance reports arrival, the distance to go has shrunk by less
    than 0.05 m in 10 s (stuck), or the timeout is reached. The distance to go is that to the goal
    plus, during the initial turn, the track travel B/2·|angle| still to turn.

    Args:
        mission: what to do.
        plant: inputs ``pwm_l, pwm_r`` [µs], outputs ``omega_l, omega_r`` [rad/s] in this order;
            :func:`sysid.mission.mapping.as_robot` makes one of any plant.
        navigation: the estimator of the pose; odometry when left out.

    Returns:
        The outcome, its figures and the log.

    Raises:
        ModelError: the plant is no robot plant, samples too fast for the timeout, or diverges.
    """
    _check(mission, plant)
    loop = _Loop(mission, plant, navigation or Odometry(mission.vehicle.geometry))
    with np.errstate(over="ignore", invalid="ignore"):  # divergence is reported in words
        outcome = loop.run()
    rows = np.array(loop.rows)
    rows.setflags(write=False)
    log = MappingProxyType({name: rows[:, i] for i, name in enumerate(COLUMNS)})
    final = loop.rows[-1]
    return MissionResult(
        outcome=outcome,
        time_s=final[0],
        final=(final[5], final[6], final[7]),
        path_length_m=loop.path_length,
        min_clearance_m=loop.clearance if mission.obstacles else None,
        max_deviation_m=_deviation(mission, log),
        log=log,
        why=why_stuck(mission, log) if outcome is Outcome.STUCK else "",
    )


class _Loop:
    """The running state of one simulation; private, because it changes in place."""

    def __init__(self, mission: Mission, plant: SteppablePlant, navigation: Navigation) -> None:
        self.mission = mission
        self.plant = plant
        self.navigation = navigation
        self.geometry = mission.vehicle.geometry
        self.ground: Ground = getattr(plant, "ground", Ground())
        self.rows: list[tuple[float, ...]] = []
        self.path_length = 0.0
        self.clearance = math.inf
        x, y, psi = mission.start
        self.pose: Pose = (x, y, wrap_angle(psi))
        self.turn = InitialTurn.plan(self.pose, mission.goal)
        self.integral = 0.0
        self.calls = 0  # control instants so far
        self.commands: Commands = STANDSTILL
        self.references = References(0.0, self.pose[2], math.dist(mission.goal, (x, y)), False)
        self.best, self.best_time = math.inf, 0.0

    def run(self) -> Outcome:
        """Step until the mission ends."""
        plant, dt = self.plant, self.plant.dt
        state = plant.initial_state()
        u = np.zeros(2)
        speeds: tuple[float, float] | None = None
        estimate: Estimate | None = None
        k = 0
        while True:
            t = round(k * dt, 12)  # 5.3, not 5.300000000000001
            if estimate is not None:
                self._command(estimate, t, inclusive=False)
            reading = self._read(plant.step(state, u)[1], t)
            if estimate is None:
                estimate = self.navigation.start(self.pose, *reading)
            else:
                estimate = self.navigation.update(estimate, *reading, dt)
            self._command(estimate, t, inclusive=True)
            arrived = self.references.arrived
            u = np.array((self.commands.pwm_l, self.commands.pwm_r))
            state, y = plant.step(state, u)
            omega = self._read(y, t)
            on_ground = self.ground(*omega) if self.ground else omega
            now = body_velocity(*on_ground, self.geometry)
            before = self.pose
            if speeds is not None:
                self._move(speeds, now, dt)
            speeds = now
            outcome = self._outcome(before, t, arrived)
            self._note(t, omega, now)
            if outcome is not None:
                return outcome
            k += 1

    def _read(self, y: Array, t: float) -> tuple[float, float]:
        left, right = float(y[0]), float(y[1])
        if not (abs(left) < _DIVERGED and abs(right) < _DIVERGED):
            raise ModelError(
                f"the plant's wheel speeds run away at t = {t:g} s: the identified model is "
                "unstable; fit it with stability enforced or with lower orders"
            )
        return left, right

    def _command(self, estimate: Estimate, t: float, inclusive: bool) -> None:
        """Run guidance and control at every control instant before ``t`` (or up to it)."""
        mission, period = self.mission, self.mission.control.period
        slack = 1e-9 * (period + t)  # k·dt and j·period of one instant differ by rounding
        limit = t + slack if inclusive else t - slack
        while self.calls * period < limit:
            self.calls += 1
            self.references, self.turn = guide(mission, estimate.pose, self.turn)
            if self.references.arrived:
                self.commands = STANDSTILL
                continue
            self.commands, self.integral = control(
                self.references.speed,
                self.references.psi,
                estimate.speed,
                estimate.pose[2],
                self.integral,
                mission.control,
            )

    def _move(self, before: tuple[float, float], now: tuple[float, float], dt: float) -> None:
        forward, yaw_rate = 0.5 * (before[0] + now[0]), 0.5 * (before[1] + now[1])
        self.pose = step_pose(*self.pose, forward, yaw_rate, dt, xp=math)
        self.path_length += abs(forward) * dt

    def _outcome(self, before: Pose, t: float, arrived: bool) -> Outcome | None:
        for obstacle in self.mission.obstacles:
            rho = _distance_to_segment((obstacle.x, obstacle.y), before, self.pose)
            self.clearance = min(self.clearance, rho - obstacle.radius)
        if self.clearance <= 0:
            return Outcome.COLLISION
        if arrived:
            return Outcome.ARRIVED
        to_go = math.dist(self.pose[:2], self.mission.goal)
        to_go += 0.5 * self.geometry.B * self.turn.remaining(self.pose[2])
        if to_go < self.best - STUCK_PROGRESS:
            self.best, self.best_time = to_go, t
        elif t - self.best_time >= STUCK_TIME:
            return Outcome.STUCK
        if t + self.plant.dt > self.mission.timeout * (1 + 1e-9):
            return Outcome.TIMEOUT
        return None

    def _note(self, t: float, omega: tuple[float, float], now: tuple[float, float]) -> None:
        c, r = self.commands, self.references
        row = (t, c.pwm_l, c.pwm_r, *omega, *self.pose, *now)
        self.rows.append((*row, r.speed, r.psi, c.v_cmd, c.psi_cmd, r.rho_goal))


def _check(mission: Mission, plant: SteppablePlant) -> None:
    names = tuple(c.name for c in (*plant.inputs, *plant.outputs))
    wanted = tuple(c.name for c in (*ROBOT_INPUTS, *ROBOT_OUTPUTS))
    if names != wanted:
        raise ModelError(
            f"the plant's channels are {', '.join(names)} but a mission needs {', '.join(wanted)}: "
            "map the plant with as_robot first"
        )
    if not (math.isfinite(plant.dt) and plant.dt > 0):
        raise ModelError(f"the plant's sample time is {plant.dt} s: it must be above 0")
    fastest = min(plant.dt, mission.control.period)
    if mission.timeout / fastest > MOST_SAMPLES:
        what = "plant's sample time" if fastest == plant.dt else "control period"
        raise ModelError(
            f"the {what} of {fastest:g} s makes {mission.timeout / fastest:.3g} steps of a mission "
            f"of {mission.timeout:g} s: lower the timeout or lengthen the {what}"
        )


def _distance_to_segment(point: tuple[float, float], a: Pose, b: Pose) -> float:
    """Distance from a point to the way between two poses, so that none is jumped over."""
    ax, ay, dx, dy = a[0], a[1], b[0] - a[0], b[1] - a[1]
    length2 = dx * dx + dy * dy
    along = ((point[0] - ax) * dx + (point[1] - ay) * dy) / length2 if length2 > 0 else 0.0
    along = min(max(along, 0.0), 1.0)
    return math.hypot(point[0] - ax - along * dx, point[1] - ay - along * dy)


def _deviation(mission: Mission, log: Mapping[str, Array]) -> float:
    (x0, y0, _), (xg, yg) = mission.start, mission.goal
    dx, dy = log["x"] - x0, log["y"] - y0
    length = math.hypot(xg - x0, yg - y0)
    if length == 0.0:  # no line: the distance from the point itself
        return float(np.max(np.hypot(dx, dy)))
    return float(np.max(np.abs(dy * (xg - x0) - dx * (yg - y0))) / length)
