"""One sample of the closed loop guidance → control → plant → motion → navigation, as a function.

It knows protocols only, and over ``xp`` it is pure: the next state and a row of the log from the
last state. :mod:`sysid.robot.mission.simulator` runs it sample after sample until the mission ends.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any, NamedTuple

from sysid.data.record import PWM_FULL_SCALE
from sysid.effects.ground import Ground
from sysid.robot.mission.clearance import step_clearance
from sysid.robot.mission.contracts import (
    Body,
    Command,
    ControlInputs,
    Controller,
    Guidance,
    GuidanceInputs,
    Motion,
    MotionInputs,
    Navigation,
    NavigationInputs,
    Readout,
    References,
    Reporting,
    Scene,
    SensorInputs,
    State,
    SteppablePlant,
    TurnsTracks,
    readout_of,
)
from sysid.robot.mission.supply import Feed
from sysid.vehicle.kinematics import Real, body_velocity


def on_ground(
    ground: Ground,
    state: State,
    omega: tuple[Real, Real],
    at: tuple[Real, Real],
    scene: Scene,
) -> tuple[State, MotionInputs]:
    """What moves the vehicle when its tracks turn on an identified ground.

    Args:
        omega: speeds of the left and the right track [rad/s].
        at: instant, and time since the sample before [s].

    Returns:
        What the ground remembers then, and the inputs of the motion.
    """
    (left, right), after = ground.step(state, omega, at[1])
    inputs = MotionInputs(at[0], left, right, scene)
    if not ground.slides:
        return after, inputs
    speeds = body_velocity(left, right, scene.geometry)
    return after, inputs._replace(lateral=ground.lateral(*speeds))


COLUMNS = (
    "t", "pwm_l", "pwm_r", "omega_l", "omega_r", "x", "y", "psi",
    "v", "yaw_rate", "v_ref", "psi_ref", "v_cmd", "psi_cmd", "rho_goal",
)  # fmt: skip
"""Columns of every mission log: the robot log's first, then what the loop was thinking."""


@dataclass(frozen=True)
class StuckRule:
    """When a robot counts as stuck.

    Attributes:
        progress: less than this [m] closer … Half a tolerance: a robot that creeps to its goal
            comes closer faster.
        time: … in this time [s]. The slowest turn on the spot and the slowest lag of a plant that
            has driven a mission are over by then.
    """

    progress: float = 0.05
    time: float = 10.0


STUCK = StuckRule()

THERE = 1.5
"""A robot has arrived when it truly is within so many tolerances of the goal. Guidance stops it at
the edge of the tolerance by the estimated pose, so within one tolerance an error of a millimetre
would decide; half of it is left to navigation."""


class Verdict(IntEnum):
    """Whether a run goes on, as a number that arrays can hold."""

    GOES_ON = 0
    COLLISION = 1
    ARRIVED = 2
    STUCK = 3
    TIMEOUT = 4
    MISSED = 5


class Tick(NamedTuple):
    """One sample of the plant on the time line of both clocks.

    Attributes:
        t: instant [s].
        dt: time since the sample before [s]; 0 at the first.
        before: control instants since the sample before, this one excluded [s].
        now: control instants that fall together with this sample [s].
    """

    t: float
    dt: float
    before: tuple[float, ...]
    now: tuple[float, ...]


def ticks(dt: float, period: float) -> Iterator[Tick]:
    """Every sample of the plant, k·dt, with the control instants j·period; without end."""
    instants = (j * period for j in itertools.count())
    coming = next(instants)
    for k in itertools.count():
        t = round(k * dt, 12)  # 5.3, not 5.300000000000001
        slack = 1e-9 * (period + t)  # k·dt and j·period of one instant differ by rounding
        before: list[float] = []
        now: list[float] = []
        while coming < t + slack:
            (before if coming < t - slack else now).append(coming)
            coming = next(instants)
        yield Tick(t, dt if k else 0.0, tuple(before), tuple(now))


class Progress(NamedTuple):
    """What decides how a run ends, and its figures so far.

    Attributes:
        path_length: way driven [m].
        clearance: smallest distance from the robot's centre to an obstacle's surface [m].
        best, best_time: the smallest distance to go that counted as progress [m], and when [s].
        best_way: the way driven until then [m].
    """

    path_length: Real
    clearance: Real
    best: Real
    best_time: Real
    best_way: Real


class LoopState(NamedTuple):
    """Everything a run remembers from one sample to the next."""

    plant: State
    guidance: State
    control: State
    sensors: tuple[State, ...]
    navigation: State
    ground: State
    motion: State
    estimate: Body
    references: References
    rho_goal: Real
    command: Command
    applied: Command
    pwm: tuple[Real, Real]
    body: Body
    progress: Progress
    verdict: Real


def command_module(command: Command, xp: Any) -> tuple[Real, Real]:
    """Return PWM_l = (V_cmd − ψ_cmd)·20000, PWM_r = (V_cmd + ψ_cmd)·20000 (thesis 6.3).

    Each pulse width is clipped to ±20000 µs, the full scale of the drive.
    """
    v, psi = command
    return (
        PWM_FULL_SCALE * xp.clip(v - psi, -1.0, 1.0),
        PWM_FULL_SCALE * xp.clip(v + psi, -1.0, 1.0),
    )


def plain_shaper(
    command: Command, estimate: Body, t: Real, xp: Any
) -> tuple[tuple[Real, Real], Command]:
    """The command module alone, and what of the command it lets through."""
    pwm = command_module(command, xp)
    left, right = (p / PWM_FULL_SCALE for p in pwm)
    return pwm, Command(0.5 * (left + right), 0.5 * (right - left))


CommandShaper = Callable[[Command, Body, Real, Any], tuple[tuple[Real, Real], Command]]
"""(command, how the robot moves, t, xp) → PWM of both tracks [µs], what of the command it gives."""


Moved = tuple[tuple[Real, Real], tuple[State, State, Body]]
"""Wheel speeds, what the ground and what a motion remembers, and what the motion says."""


@dataclass(frozen=True)
class Loop:
    """The parts of one closed loop.

    Attributes:
        plant: two PWM inputs [µs], two wheel speeds [rad/s].
        timeout: it is given up after this time [s].
        shaper: makes PWM of both tracks [µs] of a command, and says what of the command it gives.
        feed: what battery and bridge make of that PWM; None for nothing.
    """

    guidance: Guidance
    control: Controller
    navigation: Navigation
    motion: Motion
    plant: SteppablePlant
    scene: Scene
    timeout: float
    xp: Any
    shaper: CommandShaper = plain_shaper
    feed: Feed | None = None

    def __post_init__(self) -> None:
        """Put the plant's sample time into the scene, where sensors and filters look for it."""
        object.__setattr__(self, "scene", self.scene._replace(dt=self.plant.dt))

    def start(self) -> LoopState:
        """The state before the first sample: at rest in the start pose, without a command."""
        scene, xp = self.scene, self.xp
        at_rest = Body(scene.start, 0.0, 0.0)
        return LoopState(
            plant=self.plant.initial_state(),
            guidance=self.guidance.start(scene, xp),
            control=self.control.start(scene, xp),
            sensors=tuple(s.start(scene, xp) for s in scene.sensors.values()),
            navigation=self.navigation.start(scene, xp),
            ground=self.plant.ground.start(),
            motion=self.motion.start(scene, xp),
            estimate=at_rest,
            references=References(0.0, scene.start.psi, False),
            rho_goal=scene.to_goal(scene.start, xp),
            command=Command(0.0, 0.0),
            applied=Command(0.0, 0.0),
            pwm=(0.0, 0.0),
            body=at_rest,
            progress=Progress(0.0, xp.inf, xp.inf, 0.0, 0.0),
            verdict=int(Verdict.GOES_ON),
        )

    @cached_property
    def reporting(self) -> tuple[tuple[str, Reporting], ...]:
        """The laws that add columns to the log, with their part's name."""
        parts = ("guidance", "control", "navigation", "motion")
        laws = ((part, getattr(self, part)) for part in parts)
        return tuple((part, law) for part, law in laws if isinstance(law, Reporting))

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the log: what every mission has, what the sensors read, what laws report.

        Where encoders read the wheels, their measurements are ``omega_l``, ``omega_r`` as in a
        robot's log, and the speeds themselves are ``true_omega_l``, ``true_omega_r``.
        """
        read = tuple(name for sensor in self.scene.sensors.values() for name in sensor.names)
        true = (f"true_{name}" if name in read else name for name in COLUMNS)
        shown = (name for _, law in self.reporting for name in law.columns)
        return (*true, *read, *shown)

    def sample(
        self, state: LoopState, tick: Tick, draws: Sequence[Sequence[Real]] = ()
    ) -> tuple[LoopState, tuple[Real, ...]]:
        """Advance to the next sample of the plant.

        At a control instant guidance and control use the latest measurement, the one of the same
        instant included. A measurement at this sample is y(k) under the command held so far; a
        motion that turns the tracks gives it itself, before anything is read.

        Args:
            draws: standard normal numbers of this sample, a row for each sensor.

        Returns:
            The state after it, and its row of the log (:attr:`columns`).
        """
        scene, xp = self.scene, self.xp
        # the measurement is of what was held: what is decided before this sample reaches it only
        # now
        moved = self._driven(state, tick)
        omega = self._turning(state, tick.t) if moved is None else moved[0]
        state, measurements = self._read(state, omega, moved, tick, draws)
        state = self.steered(state, tick, measurements)
        plant = state.plant
        if moved is None:
            plant, omega = self._wheels(state, tick.t)
            moved = omega, self._moved(state, omega, tick)
        ground, remembered, body = moved[1]
        progress, verdict = self._judged(state, body, tick)
        state = state._replace(
            plant=plant,
            ground=ground,
            motion=remembered,
            body=body,
            progress=progress,
            verdict=verdict,
        )
        r, c = state.references, state.command
        row: tuple[Real, ...] = (tick.t, *state.pwm, *omega, *body.pose, body.speed, body.yaw_rate)
        row = (*row, r.speed, r.psi, c.v_cmd, c.psi_cmd, state.rho_goal)
        for sensor in scene.sensors.values():
            row = (*row, *(measurements[name] for name in sensor.names))
        for part, law in self.reporting:
            row = (*row, *law.report(getattr(state, part), xp))
        return state, row

    def steered(self, state: LoopState, tick: Tick, measurements: Mapping[str, Real]) -> LoopState:
        """Navigation, guidance and control at one sample: the part of a robot's computer.

        Args:
            measurements: what the sensors read at it, the wheels among them.

        Returns:
            The state with another estimate and PWM; plant and vehicle have not moved.
        """
        drive = state.pwm[0] / PWM_FULL_SCALE, state.pwm[1] / PWM_FULL_SCALE
        for t in tick.before:
            state = self._decided(state, t)
        seen = NavigationInputs(tick.t, measurements, self.scene, drive)
        remembered, estimate = self.navigation.step(state.navigation, seen, tick.dt, self.xp)
        state = state._replace(navigation=remembered, estimate=estimate)
        for t in tick.now:
            state = self._decided(state, t)
        return state

    def _driven(self, state: LoopState, tick: Tick) -> Moved | None:
        """Wheel speeds and motion at this sample where the motion turns the tracks itself."""
        turning = self._turner
        if turning is None:
            return None
        before = turning.wheel_speeds(state.motion)
        left, right = self._acting(state.pwm, tick.t)
        drive = left / PWM_FULL_SCALE, right / PWM_FULL_SCALE
        inputs = MotionInputs(tick.t, *before, self.scene, drive)
        remembered, body = self.motion.step(state.motion, inputs, tick.dt, self.xp)
        return turning.wheel_speeds(remembered), (state.ground, remembered, body)

    @cached_property
    def _turner(self) -> TurnsTracks | None:
        """The motion, where it turns the tracks itself; asked once, for the answer takes long."""
        return self.motion if isinstance(self.motion, TurnsTracks) else None

    def _turning(self, state: LoopState, t: Real) -> tuple[Real, Real]:
        """Wheel speeds at this sample under the command held so far."""
        y = self._readout(state.plant, self.xp.array(self._acting(state.pwm, t)))
        return self.xp.float64(y[0]), self.xp.float64(y[1])

    def _moved(
        self, state: LoopState, omega: tuple[Real, Real], tick: Tick
    ) -> tuple[State, State, Body]:
        """Where tracks that turn at ``omega`` bring the vehicle at this sample."""
        at = tick.t, tick.dt
        ground, rolled = on_ground(self.plant.ground, state.ground, omega, at, self.scene)
        return ground, *self.motion.step(state.motion, rolled, tick.dt, self.xp)

    def _read(
        self,
        state: LoopState,
        omega: tuple[Real, Real],
        moved: Moved | None,
        tick: Tick,
        draws: Sequence[Sequence[Real]],
    ) -> tuple[LoopState, Mapping[str, Real]]:
        """What the sensors read at this sample; without encoders the wheels are read exactly."""
        measurements = {"omega_l": omega[0], "omega_r": omega[1]}
        sensors = self.scene.sensors
        if not sensors:
            return state, measurements
        body = (self._moved(state, omega, tick) if moved is None else moved[1])[2]
        after = []
        for sensor, last, numbers in zip(sensors.values(), state.sensors, draws, strict=True):
            seen = SensorInputs(tick.t, body, omega[0], omega[1], numbers, self.scene)
            remembered, values = sensor.step(last, seen, tick.dt, self.xp)
            after.append(remembered)
            measurements |= dict(zip(sensor.names, values, strict=True))
        return state._replace(sensors=tuple(after)), measurements

    @cached_property
    def _readout(self) -> Readout:
        return readout_of(self.plant)

    def _acting(self, pwm: tuple[Real, Real], t: Real) -> tuple[Real, Real]:
        """PWM [µs] behind battery and bridge."""
        return pwm if self.feed is None else self.feed(pwm, t, self.xp)

    def _wheels(self, state: LoopState, t: Real) -> tuple[State, tuple[Real, Real]]:
        after, y = self.plant.step(state.plant, self.xp.array(self._acting(state.pwm, t)))
        return after, (self.xp.float64(y[0]), self.xp.float64(y[1]))

    def _decided(self, state: LoopState, t: float) -> LoopState:
        """Guidance and control at one instant; who has arrived stands still from then on."""
        scene, xp, dt = self.scene, self.xp, self.control.period
        asked = GuidanceInputs(t, state.estimate, scene)
        guidance, references = self.guidance.step(state.guidance, asked, dt, xp)
        given = ControlInputs(t, references, state.estimate, scene, state.applied)
        control, command = self.control.step(state.control, given, dt, xp)
        over = references.arrived | references.gives_up
        command = Command(xp.where(over, 0.0, command.v_cmd), xp.where(over, 0.0, command.psi_cmd))
        pwm, applied = self.shaper(command, state.estimate, t, xp)
        left, right = (xp.where(over, 0.0, p) for p in pwm)
        return state._replace(
            guidance=guidance,
            control=control,
            references=references,
            rho_goal=scene.to_goal(state.estimate.pose, xp),
            command=command,
            applied=applied,
            pwm=(left, right),
        )

    def _judged(self, state: LoopState, body: Body, tick: Tick) -> tuple[Progress, Real]:
        xp, scene, last = self.xp, self.scene, state.progress
        passed = step_clearance(scene, state.body.pose, body.pose, tick.t, tick.dt, xp)
        clearance = xp.minimum(last.clearance, passed)
        to_go = self.guidance.to_go(state.guidance, body.pose, scene, xp)
        way = last.path_length + abs(0.5 * (state.body.speed + body.speed)) * tick.dt
        wanted = state.references
        # On a detour any way is progress; where it ends, the distance to go counts from there.
        moving = wanted.detour & (way >= last.best_way + STUCK.progress)
        closer = moving | (to_go < last.best - STUCK.progress)
        late = tick.t + self.plant.dt > self.timeout * (1 + 1e-9)
        standing = xp.logical_not(closer) & (tick.t - last.best_time >= STUCK.time)
        verdict = xp.where(late, Verdict.TIMEOUT, Verdict.GOES_ON)
        there: Real = True
        if self.guidance.traits.ends_at_goal:
            there = scene.to_goal(body.pose, xp) <= THERE * scene.tolerance
        for condition, name in (
            (standing | wanted.gives_up, Verdict.STUCK),
            (wanted.arrived, Verdict.MISSED),
            (wanted.arrived & there, Verdict.ARRIVED),
            (clearance <= 0, Verdict.COLLISION),
        ):
            verdict = xp.where(condition, name, verdict)
        progress = Progress(
            path_length=way,
            clearance=clearance,
            best=xp.where(closer, to_go, last.best),
            best_time=xp.where(closer, tick.t, last.best_time),
            best_way=xp.where(closer, way, last.best_way),
        )
        return progress, verdict
