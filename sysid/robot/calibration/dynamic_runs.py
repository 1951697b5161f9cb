"""Simulations of the vehicle's dynamics over pieces of a log, batched and with derivatives.

A record is cut into pieces that begin ``LEAD`` seconds before what they are judged on, so that
where a run starts is forgotten. The commands drive the vehicle; the measured speeds draw the run
after them with a memory of ``MEMORY`` seconds, so that an error of the model does not stay for
good, as it would where a torque is known and nothing holds the speed.

What a run says of the pose is how its body moves otherwise than tracks without slip would carry it
at the run's own speeds. That goes on top of the measured speeds, so that errors of the motors do
not leak into the path.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index
from sysid.robot.calibration.trajectory import Trajectory
from sysid.runners.compiled import compiled, jax_module
from sysid.vehicle.dynamics import Scheme, VehicleState, step
from sysid.vehicle.floor import Floor
from sysid.vehicle.kinematics import body_velocity
from sysid.vehicle.motors import Motor
from sysid.vehicle.soil import Soil
from sysid.vehicle.tracked import G, TrackedVehicle

PIECE = 6.0
"""Time that a piece is judged on [s]: the lead costs a third of it, and a minute is ten runs."""

LEAD = 2.0
"""Time before that [s]: ten lags of a small robot, two of a heavy one."""

MEMORY = 2.0
"""Time in which a run forgets an error of its speeds [s], as long as a window of the pose."""

LONGEST_PART = 0.005
"""Longest part of a step [s]: with damping taken at its middle, halving it moves speeds by less
than a thousandth."""

ROUNDS = 6
"""Rounds over the blocks of friction in a part; more change no digit that a log shows."""

NUMBERS = (
    "mass",
    "yaw_inertia",
    "rolling_resistance",
    "turning_resistance",
    "compliance",
    "torque",
    "damping",
    "rotor_inertia",
    "motor_friction",
    "grip",
    "imbalance",
    "delay",
)
"""What a run depends on: m [kg], J [kg m²], R of the whole vehicle [N], M at slow turns [Nm], slip
of a track per thrust [1/N], the motors' four numbers and the largest thrust over what is given for
them [1], share by which the right motor gives more torque than the left [1], and by how much the
command acts later than it is logged [s]."""


@dataclass(frozen=True, eq=False)
class Machine:
    """What of a vehicle is taken as known.

    Attributes:
        vehicle: lengths; its mass and inertia are where a search starts.
        motors: left and right; drive 1 is one unit of the logged command.
        soil: thrust at most; its other numbers are where a search starts.
    """

    vehicle: TrackedVehicle
    motors: tuple[Motor, Motor]
    soil: Soil

    def numbers(self) -> Array:
        """Where a search starts, in the order of ``NUMBERS``."""
        v, s = self.vehicle, self.soil
        weight = v.mass * G
        most = v.contact_length * v.track_width * s.cohesion + 0.5 * weight * s.friction
        return np.array(
            [
                v.mass,
                v.yaw_inertia,
                s.rolling * weight,
                0.25 * s.lateral * weight * v.contact_length,
                2.0 * s.shear_modulus / (most * v.contact_length),
                *(1.0,) * 5,
                *(0.0,) * 2,
            ]
        )

    def parts(self, theta: Any, h: float) -> tuple[TrackedVehicle, tuple[Motor, Motor], Floor]:
        """The vehicle, its motors and its floor with these numbers, for parts of length h [s].

        A step takes damping at a part's end; an inertia that is less by hD/2 makes that its mean
        over the part, which is exact to the second order.
        """
        m, J, rolling, turning, compliance = theta[:5]
        vehicle = replace(self.vehicle, mass=m, yaw_inertia=J)
        length, width = vehicle.contact_length, vehicle.track_width
        most = length * width * self.soil.cohesion + 0.5 * m * G * self.soil.friction
        most = most * theta[9]
        # the loads do not change: all of the largest thrust may stand in the cohesion
        soil = replace(
            self.soil,
            cohesion=most / (length * width),
            friction_angle=0.0,
            rolling=rolling / (m * G),
            lateral=4.0 * turning / (m * G * length),
            shear_modulus=0.5 * compliance * most * length,
            std=(),
        )
        left, right = (
            _scaled(motor, theta, side, h)
            for motor, side in zip(self.motors, (-0.5, 0.5), strict=True)
        )
        return vehicle, (left, right), Floor(soil)


def _scaled(motor: Motor, theta: Any, side: float, h: float) -> Motor:
    """A motor with these ``NUMBERS``, for parts of length h [s]."""
    damping, inertia = motor.damping * theta[6], motor.inertia * theta[7]
    return motor._replace(
        torque=motor.torque * theta[5] * (1.0 + side * theta[10]),
        damping=damping,
        inertia=inertia * inertia / (inertia + 0.5 * h * damping),  # never below 0
        friction=motor.friction * theta[8],
    )


@dataclass(frozen=True, eq=False)
class Log:
    """A record as the runs need it.

    Attributes:
        trajectory: the same record as the fit of the pose sees it.
        command: left and right, in the unit that the motors' drive counts in, (N, 2).
        omega: measured speeds, (N, 2) [rad/s]; NaN where there is none.
        dt: sample time [s].
    """

    trajectory: Trajectory
    command: Array
    omega: Array
    dt: float


@dataclass(frozen=True, eq=False)
class Pieces:
    """All pieces of logs of one sample time.

    Attributes:
        dt: sample time [s].
        command, omega: (S, T, 2).
        log: number of each piece's, (S,).
        counted: samples that a piece is judged on: every row of a log is in one piece, (S, T).
    """

    dt: float
    command: Array
    omega: Array
    log: Index
    counted: NDArray[np.bool_]

    def joined(self, values: Array, which: int) -> Array:
        """What a log's samples have in the pieces (S, T, n), row after row, (N, n)."""
        return np.asarray(values[self.counted & (self.log == which)[:, None]])


def pieces_of(logs: Sequence[Log]) -> Pieces:
    """The pieces of logs, which have one sample time."""
    dt = logs[0].dt
    judged, lead = max(round(PIECE / dt), 1), round(LEAD / dt)
    parts: list[tuple[Array, Array, int, NDArray[np.bool_]]] = []
    for which, log in enumerate(logs):
        n = len(log.omega)
        for k in range(0, n, judged):
            row = np.arange(max(k - lead, 0), max(k - lead, 0) + lead + judged)
            at = np.minimum(row, n - 1)
            counts = (row >= k) & (row < min(k + judged, n))
            parts.append((log.command[at], log.omega[at], which, counts))
    command, omega, log_of, counted = (np.stack(p) for p in zip(*parts, strict=True))
    return Pieces(dt, command, omega, log_of, counted)


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of a machine over pieces.

    Attributes:
        machine: what is known of it.
        pieces: what drives it.
    """

    machine: Machine
    pieces: Pieces

    def outputs(self, theta: Array) -> tuple[Array, Array]:
        """Speeds at every sample (S, T, 2) [rad/s], and what slip adds to forward speed, speed to
        the left and yaw rate until the next, (S, T, 3) [m/s, m/s, rad/s]; at these ``NUMBERS``.
        """
        run, _ = _functions(self.machine, self.pieces.dt)
        speeds, slip = run(theta, self.pieces.command, self.pieces.omega)
        return np.asarray(speeds), np.asarray(slip)

    def slopes(self, theta: Array, free: Sequence[int]) -> tuple[Array, Array]:
        """Their derivatives by some of the numbers, (n, S, T, 2) and (n, S, T, 3)."""
        _, slopes = _functions(self.machine, self.pieces.dt)
        directions = np.eye(len(theta))[list(free)]
        speeds, slip = slopes(theta, directions, self.pieces.command, self.pieces.omega)
        return np.asarray(speeds), np.asarray(slip)


@lru_cache(maxsize=8)
def _functions(machine: Machine, dt: float) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """(θ, commands, speeds) → outputs, and their derivatives along directions; compiled."""
    jax = jax_module()

    def run(theta: Any, command: Any, measured: Any) -> Any:
        return _run(machine, dt, theta, command, measured)

    def slopes(theta: Any, directions: Any, command: Any, measured: Any) -> Any:
        def along(direction: Any) -> Any:
            return jax.jvp(lambda t: run(t, command, measured), (theta,), (direction,))[1]

        return jax.vmap(along)(directions)

    return compiled(run), compiled(slopes)


def _run(machine: Machine, dt: float, theta: Any, command: Any, measured: Any) -> tuple[Any, Any]:
    jax = jax_module()
    jnp = jax.numpy
    parts = max(1, int(np.ceil(dt / LONGEST_PART - 1e-9)))
    vehicle, motors, floor = machine.parts(theta, dt / parts)
    scheme = Scheme(parts, ROUNDS)
    gain = 1.0 - np.exp(-dt / MEMORY)
    geometry = machine.vehicle.geometry

    def advance(state: Any, now: Any) -> Any:
        drive, read = now
        omega = jnp.stack(state.omega)
        off = gain * jnp.where(jnp.isfinite(read), read - omega, 0.0)
        forward, yaw_rate = body_velocity(off[0], off[1], geometry)
        zero = jnp.float64(0.0)
        drawn = state._replace(
            x=zero,
            y=zero,
            psi=zero,
            omega=(state.omega[0] + off[0], state.omega[1] + off[1]),
            vx=state.vx + forward,
            yaw_rate=state.yaw_rate + yaw_rate,
        )
        after = step(drawn, (drive[0], drive[1]), dt, vehicle, motors, floor, jnp, scheme)
        return after, (omega, _slipped(drawn, after, dt, geometry, jnp))

    def one(drive: Any, read: Any) -> Any:
        first = jnp.where(jnp.isfinite(read[0]), read[0], 0.0)
        forward, yaw_rate = body_velocity(first[0], first[1], geometry)
        rest = jax.tree.map(jnp.float64, VehicleState())
        start = rest._replace(vx=forward, yaw_rate=yaw_rate, omega=(first[0], first[1]))
        return jax.lax.scan(advance, start, (drive, read))[1]

    runs: tuple[Any, Any] = jax.vmap(one)(_delayed(command, theta[11] / dt, jnp), measured)
    return runs


def _slipped(before: Any, after: Any, dt: float, geometry: Any, jnp: Any) -> Any:
    """What slip added to the body's mean speeds between two states, (3,).

    The first state lies in the origin; the chord of an arc is along its middle heading.
    """
    turn = after.psi
    c, s = jnp.cos(0.5 * turn), jnp.sin(0.5 * turn)
    arc = 1.0 / jnp.sinc(turn / (2.0 * np.pi)) / dt
    mean = [0.5 * (a + b) for a, b in zip(before.omega, after.omega, strict=True)]
    forward, yaw_rate = body_velocity(mean[0], mean[1], geometry)
    return jnp.stack(
        [
            (c * after.x + s * after.y) * arc - forward,
            (c * after.y - s * after.x) * arc,
            turn / dt - yaw_rate,
        ]
    )


def _delayed(command: Any, samples: Any, jnp: Any) -> Any:
    """Held commands that act so many samples later: their mean over every interval, (S, T, 2)."""
    n = command.shape[1]
    at = jnp.arange(n) - samples
    below = jnp.floor(at)
    share = (at - below)[None, :, None]
    lower, upper = (jnp.clip(below.astype(int) + k, 0, n - 1) for k in (0, 1))
    return (1.0 - share) * command[:, lower] + share * command[:, upper]
