"""A plain robot that can carry any effect: the truth behind the logs of ``hidden_effects.py``.

It imports nothing from the workbench that is tested on its logs. Without effects each track is
first order and linear, apart from the other one:

    τ dω/dt = T − ω,   T = K d,   d = PWM / 20000                       (ω, T, K in rad/s)

and, a command being held over a sample, ω(k+1) = a ω(k) + (1 − a) K d(k) with a = exp(−Δt/τ) holds
to rounding. Every effect is a number of its own that changes one place of the chain and does
nothing at its default. The chain of a track, in this order:

    command → delay → rate limit → dead zone → saturation → concave gain → weaker backward drive
            → supply (sag, discharge) → heat → lag → dead time → current limit → T
    T − coupling − load − drag − friction → motor → gap → wheel
    wheel → lag → ripple, bias, noise, unsigned, clip → quantisation, dropouts → reading

Time is continuous: steps of at most 2 ms, each solved exactly for the linear part; a track that
friction would turn back within a step stops there. The pose follows from the wheels at their
effective radii, less slip.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING or __package__:
    from sysid_datasets.effect_robot import DISTANCE, PWM_FULL, RADIUS, WARM, Robot, Track
else:  # run as a file, from a checkout in which nothing is installed
    from effect_robot import DISTANCE, PWM_FULL, RADIUS, WARM, Robot, Track

Array = NDArray[np.float64]

FINE_STEP = 0.002
"""Longest step of the integration [s]."""


@dataclass(frozen=True, eq=False)
class Chance:
    """Everything random that befalls a log, drawn beforehand; arrays (samples, 2)."""

    noise: Array
    """Added to the speeds [rad/s]."""
    load: Array
    """Torque against each track during a sample [rad/s]."""
    events: Array
    """Uniform in 0 … 1: decides on dropouts and slipping gears."""
    phase: tuple[float, float] = (0.0, 0.0)
    """φ of the ripple [rad]."""

    @classmethod
    def none(cls, samples: int) -> "Chance":
        """Nothing befalls it: no noise, no load, no event."""
        zero = np.zeros((samples, 2))
        return cls(noise=zero, load=zero, events=zero + 0.5)


@dataclass(frozen=True, eq=False)
class Run:
    """What happened; time along axis 0, rows read just before their command takes effect."""

    t: Array
    """Instants [s], shape (N,)."""
    pwm: Array
    """Commands [µs], shape (N, 2)."""
    omega: Array
    """True speeds of the wheels [rad/s], shape (N, 2)."""
    reading: Array
    """What the sensors gave [rad/s], shape (N, 2)."""
    clean: Array
    """What they would have given without ``Chance.noise`` [rad/s], shape (N, 2)."""
    pose: Array
    """x, y [m] and psi [rad], shape (N, 3)."""


Driver = Callable[[int, tuple[float, float]], Sequence[float] | None]
"""From the sample's number and readings to its commands [µs]; None ends the log."""


def table(pwm: NDArray[np.int64]) -> Driver:
    """The driver that plays a schedule of commands, shape (N, 2)."""
    rows = pwm.tolist()
    return lambda k, _: rows[k] if k < len(rows) else None


def simulate(robot: Robot, driver: Driver, sample_time: float, chance: Chance) -> Run:
    """Drive ``robot`` from rest until the driver or ``chance`` ends."""
    steps = max(1, math.ceil(sample_time / FINE_STEP - 1e-9))
    moving = [_Moving(track, sample_time / steps, sample_time) for track in robot.tracks]
    sensors = [_Sensor(track, sample_time, chance.phase[i]) for i, track in enumerate(robot.tracks)]
    pose = (0.0, 0.0, 0.0)
    rows: list[tuple[float, ...]] = []
    noise, load, events = chance.noise.tolist(), chance.load.tolist(), chance.events.tolist()
    for k in range(len(noise)):
        pairs = [
            sensor.read(wheel, noise[k][i], events[k][i])
            for i, (sensor, wheel) in enumerate(zip(sensors, moving, strict=True))
        ]
        readings = (pairs[0][0], pairs[1][0])
        commands = driver(k, readings)
        if commands is None:
            break
        cleans = (pairs[0][1], pairs[1][1])
        speeds = (moving[0].wheel, moving[1].wheel)
        rows.append((*commands, *speeds, *readings, *cleans, *pose))
        for i in (0, 1):
            moving[i].command(commands[i] / PWM_FULL, load[k][i], events[k][i])
        for n in range(steps):
            t = k * sample_time + n * moving[0].h
            _together(robot, moving, t)
            pose = _moved(robot, pose, (moving[0].mean, moving[1].mean), moving[0].h)
    columns = np.array(rows, dtype=np.float64).reshape(-1, 11)
    t_axis = sample_time * np.arange(len(columns), dtype=np.float64)
    return Run(
        t_axis, columns[:, :2], columns[:, 2:4], columns[:, 4:6], columns[:, 6:8], columns[:, 8:]
    )


def _together(robot: Robot, moving: "list[_Moving]", t: float) -> None:
    """One fine step of both tracks: what they share stands between drive and torque."""
    left, right = moving
    d_left, d_right = left.shaped(t), right.shaped(t)
    supply = (1.0 - robot.sag * 0.5 * (abs(d_left) + abs(d_right))) * (1.0 - robot.discharge * t)
    t_left, t_right = left.torque(d_left * supply), right.torque(d_right * supply)
    # the other track's inertia acts on this one through the body, with its last acceleration
    shared = robot.inertia * math.sqrt(left.inertia * right.inertia)
    on_left, on_right = shared * right.acceleration, shared * left.acceleration
    left.step(t_left - left.track.coupling * t_right - on_left, t)
    right.step(t_right - right.track.coupling * t_left - on_right, t)


def _moved(
    robot: Robot, pose: tuple[float, float, float], wheels: tuple[float, float], h: float
) -> tuple[float, float, float]:
    x, y, psi = pose
    left, right = wheels
    if robot.slip > 0.0 and left != right:
        kept = 1.0 - robot.slip * abs(right - left) / (abs(right) + abs(left))
        left, right = left * kept, right * kept
    left *= RADIUS * robot.tracks[0].radius_ratio * h
    right *= RADIUS * robot.tracks[1].radius_ratio * h
    turn = (right - left) / (DISTANCE * robot.width_ratio)
    along, middle = 0.5 * (left + right), psi + 0.5 * turn
    return x + along * math.cos(middle), y + along * math.sin(middle), psi + turn


@dataclass
class _Moving:
    """A track on the move: its state between fine steps of ``h`` seconds."""

    track: Track
    h: float
    sample_time: float
    wheel: float = 0.0
    mean: float = 0.0
    acceleration: float = 0.0
    motor: float = 0.0
    angle: float = 0.0
    lagged: float = 0.0
    _commands: list[float] = field(default_factory=list)
    _limited: float = 0.0
    _heat: float = 0.0
    _drive: float = 0.0
    _play: float = 0.0
    _load: float = 0.0
    _chance: float = 1.0
    _released: float = 0.0
    _lets_go: bool = False
    _memory: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def __post_init__(self) -> None:
        track, h = self.track, self.h
        self._play = track.backlash
        self._tau = track.time_constant * track.time_constant_factor
        self._gain = track.gain * track.gain_factor
        self._drive_share = _share(h, track.actuator_lag)
        self._read_share = _share(h, track.sensor_lag)

    def command(self, drive: float, load: float, chance: float) -> None:
        """Hold a new command; ``load`` acts and ``chance`` decides until the next."""
        self._commands.append(drive)
        self._load = load
        self._released = self.track.outside.release(chance, self._released, self.sample_time)

    def _held(self, t: float) -> tuple[float, float]:
        """The command that has arrived at time t and the one before it."""
        late = t + 0.5 * self.h - self.track.delay - self.track.outside.extra_delay(t)
        k = math.floor(late / self.sample_time + 1e-9)
        k = min(k, len(self._commands) - 1)
        return (self._commands[k] if k >= 0 else 0.0), (self._commands[k - 1] if k > 0 else 0.0)

    def shaped(self, t: float) -> float:
        """The drive up to the supply: delay, rate limit and the static curves."""
        track = self.track
        d, before = self._held(t)
        self._lets_go = d == 0.0 or (d * before > 0.0 and abs(d) < abs(before))
        if track.rate_limit < math.inf:
            most = track.rate_limit * self.h
            change = min(max(d - self._limited, -most), most)
            d = self._limited + 0.5 * change
            self._limited += change
        edge = track.dead_forward if d > 0.0 else track.dead_backward
        if edge > 0.0:
            over = abs(d) - edge
            d = math.copysign(over + track.dead_jump, d) if over > 0.0 else 0.0
        if abs(d) > track.saturation:
            d = math.copysign(track.saturation, d)
        d *= 1.0 - track.concavity * abs(d)
        return d * track.backward_gain if d < 0.0 else d

    def torque(self, d: float) -> float:
        """T of a drive that has passed the supply: heat, lag, gain."""
        track = self.track
        if track.fade > 0.0:
            self._heat += (d * d - self._heat) * self.h / track.fade_time
            d *= max(0.0, 1.0 - track.fade * self._heat / WARM)
        if track.actuator_lag <= 0.0:
            self._drive = d
            return self._through_bridge(self._gain * d)
        change = (d - self._drive) * self._drive_share
        self._drive += change
        return self._through_bridge(self._gain * (self._drive - 0.5 * change))

    def _through_bridge(self, torque: float) -> float:
        """T behind the bridge, which looks at the current T − ω; a short has no dead time."""
        current = size = torque - self.wheel
        if torque != 0.0:
            size = max(abs(current) - self._gain * self.track.dead_time, 0.0)
        size = min(abs(size), self.track.current_limit)
        return self.wheel + math.copysign(size, current)

    def step(self, torque: float, t: float) -> None:
        """Move motor and wheel by one fine step under ``torque``."""
        track, h = self.track, self.h
        torque -= track.load + self._load
        before = self.wheel
        torque -= track.outside.torque(self.wheel, self.angle, t, self._memory, h)
        if self._released > 0.0:
            self._released -= h
            self.wheel *= math.exp(-h / (4.0 * self._tau))
            self.motor = self.wheel
        elif track.backlash > 0.0:
            self._with_gap(torque)
        else:
            self.wheel = self._turned(self.wheel, torque)
        self.acceleration = (self.wheel - before) / h
        self.mean = 0.5 * (before + self.wheel)
        self.angle += self.mean * h
        if track.sensor_lag > 0.0:
            self.lagged += (self.mean - self.lagged) * self._read_share
        else:
            self.lagged = self.wheel

    @property
    def inertia(self) -> float:
        """τ of the track on this log [s]."""
        return self._tau

    def _with_gap(self, torque: float) -> None:
        """Motor and wheel turn as one while the motor pushes, apart while the gap is crossed."""
        gap = self.track.backlash
        pushes = (self._play >= gap and torque >= 0.0) or (self._play <= 0.0 and torque <= 0.0)
        self.motor = self._turned(self.motor, torque)
        if pushes:
            self.wheel = self.motor
            return
        self.wheel = self._turned(self.wheel, 0.0, coasting=True)
        self._play += (self.motor - self.wheel) * self.h
        if not 0.0 < self._play < gap:
            self._play = min(max(self._play, 0.0), gap)
            self.wheel = self.motor

    def _turned(self, omega: float, torque: float, coasting: bool = False) -> float:
        """τ dω/dt = T − ρ ω − q ω|ω| − c(ω) sign ω over one step, exact for constant T − q ω|ω|."""
        track, h = self.track, self.h
        if (track.coulomb > 0.0 or track.breakaway > 0.0) and not coasting:
            level = track.coulomb
            if track.breakaway > 0.0:
                level += track.breakaway * math.exp(-((omega / track.stribeck_speed) ** 2))
            if omega == 0.0 and abs(torque) <= level:
                return 0.0
            sense = math.copysign(1.0, omega if omega != 0.0 else torque)
            torque -= level * sense
        else:
            sense = 0.0
        torque -= track.drag * omega * abs(omega)
        viscous = track.backward_viscous if omega < 0.0 else 1.0
        tau = self._tau * track.outside.stretch(self._drive)
        if track.coast_ratio != 1.0 and omega * (torque - viscous * omega) < 0.0:
            tau *= track.coast_ratio
        target = torque / viscous
        after = target + (omega - target) * math.exp(-viscous * h / tau)
        if track.freewheel > 0.0 and self._free(omega, torque):
            caught = track.freewheel_overrun > 0.0 and omega * torque > 0.0
            slowest = abs(torque) if caught else 0.0
            slower = max(abs(omega) - track.freewheel_decay * h, slowest)
            rolling = math.copysign(slower, omega)
            after += track.freewheel * (rolling - after)
        return 0.0 if sense != 0.0 and after * sense < 0.0 else after

    def _free(self, omega: float, torque: float) -> bool:
        if self.track.freewheel_overrun > 0.0:
            return omega * torque >= 0.0 and abs(omega) > abs(torque)
        return self._lets_go


@dataclass
class _Sensor:
    """What turns a wheel's speed into readings, with noise and without."""

    track: Track
    sample_time: float
    phase: float
    _counted: float = 0.0
    _lost: int = 0
    _last: tuple[float, float] = (0.0, 0.0)

    def read(self, wheel: _Moving, noise: float, chance: float) -> tuple[float, float]:
        """The reading at an instant, and the same without noise [rad/s]."""
        track = self.track
        speed = wheel.lagged + track.sensor_bias
        if track.ripple > 0.0:
            angle = self._counted if track.ripple_from_reading > 0.0 else wheel.angle
            speed += track.ripple * math.sin(track.ripple_lines * angle + self.phase)
        early, late = (0.0, noise) if track.noise_last > 0.0 else (noise, 0.0)
        pair = (
            self._counts(self._shown(speed + early) + late),
            self._counts(self._shown(speed)),
        )
        self._counted += pair[0] * self.sample_time
        # A burst of 1 to 4 readings, 2.5 on average, begins with this chance.
        begins = track.dropout_share / 2.5
        if chance < begins and self._lost == 0:
            self._lost = 1 + int(4.0 * chance / begins)
        if self._lost > 0:
            self._lost -= 1
            return self._last if track.dropout_holds > 0.0 else (0.0, 0.0)
        self._last = pair
        return pair

    def _shown(self, speed: float) -> float:
        limit = self.track.sensor_limit
        speed = abs(speed) if self.track.unsigned > 0.0 else speed
        return min(max(speed, -limit), limit)

    def _counts(self, speed: float) -> float:
        quantum = self.track.quantum
        return quantum * round(speed / quantum) if quantum > 0.0 else speed


def _share(h: float, lag: float) -> float:
    """Share of the way a first-order lag goes in a step; all of it without lag."""
    return 1.0 - math.exp(-h / lag) if lag > 0.0 else 1.0
