"""Logs of a tracked vehicle in MuJoCo under given voltages: the judge of our own dynamics.

The vehicle is that of :mod:`sysid.cosim.multibody`. Needs the extra ``physics`` (the package
``mujoco``); run as a file, it writes a log.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sysid.cosim.multibody import machine as multibody
from sysid.cosim.multibody.engine import engine
from sysid.vehicle.motors import Bench, Motor
from sysid.vehicle.wheels.mjcf_parts import STEP, Axle

Array: TypeAlias = NDArray[np.float64]


PER_VOLT = Bench().motor(1.0)
"""The thesis's motor and gear (2.53–2.61, §5.2), driven by volts."""


@dataclass(frozen=True)
class Machine(multibody.Machine):
    """A box on two rows of wheels, each turned by a motor.

    Its wheels' joints carry motor, gear and rolling resistance, which acts on the sprocket as the
    force on the vehicle does: r μr N.

    Attributes:
        rolling: rolling resistance over load [1].
        motor: of each side, driven by volts.
    """

    yaw_inertia: float | None = 0.02
    friction: float = 0.6
    rolling: float = 0.03
    motor: Motor = PER_VOLT

    @property
    def axle(self) -> Axle:
        m = self.motor
        rolling = self.rolling * self.load * self.wheels * self.r
        return Axle(float(m.inertia), float(m.damping), float(m.friction) + rolling)

    @property
    def actuators(self) -> list[str]:
        return [f'<motor {row.acts} gear="{float(self.motor.torque)!r}"/>' for row in self.rows]


def scrub(machine: multibody.Machine) -> tuple[float, float]:
    """Turning on the spot on points of isotropic friction: moment [Nm], effective width [m].

    Every wheel slides with (c, ψ̇x) and is pushed back by μN along it. Both rows must give the
    moment that the sideways parts need, which settles the creep c:

        B Σ c/√(c² + x²) = 2 Σ x²/√(c² + x²)    (c in units of ψ̇; sums over one row)

    The moment on the sprockets is B/2 of the forces forward, and rω = ψ̇(B/2 + c).
    """
    x2 = machine.places**2
    low, high = 0.0, machine.L
    for _ in range(60):
        c = 0.5 * (low + high)
        size = np.sqrt(c * c + x2)
        more = machine.B * float(np.sum(c / size)) < 2.0 * float(np.sum(x2 / size))
        low, high = (c, high) if more else (low, c)
    forward = machine.friction * machine.load * float(np.sum(c / np.sqrt(c * c + x2)))
    return forward * machine.B, machine.B + 2.0 * c


@dataclass(frozen=True, eq=False)
class Drive:
    """What the engine did, at the instants of the commands.

    Attributes:
        t: time [s], (N,).
        volts: left and right [V], (N, 2).
        omega: speeds of the rows [rad/s], (N, 2).
        pose: x, y [m] of the centre of mass, ψ [rad] not wrapped, (N, 3).
        velocity: forward, to the left [m/s], yaw rate [rad/s], (N, 3).
    """

    t: Array
    volts: Array
    omega: Array
    pose: Array
    velocity: Array


def drive(machine: Machine, volts: Array, dt: float) -> Drive:
    """Drive a machine from rest with voltages that are held between instants ``dt`` apart.

    Args:
        machine: what is driven.
        volts: left and right [V], (N, 2).
        dt: time between instants [s], a whole number of ``STEP``.

    Raises:
        ModelError: MuJoCo is not installed.
        ValueError: ``dt`` is no multiple of the engine's step.
    """
    every = round(dt / STEP)
    if every < 1 or not math.isclose(every * STEP, dt, rel_tol=1e-9):
        raise ValueError(f"dt is {dt} s: give a multiple of {STEP} s")
    mujoco = engine(machine)
    state, now, _ = mujoco.advance(mujoco.start, np.zeros((0, 2)), 0.0)
    rows, ahead, turns = [], machine.centre, 0.0
    for k, pair in enumerate(volts):
        x, y, psi = now.pose
        turns = psi + 2.0 * math.pi * round((turns - psi) / (2.0 * math.pi))
        x, y = x + ahead * math.cos(turns), y + ahead * math.sin(turns)
        left = now.lateral + ahead * now.yaw_rate
        rows.append((*mujoco.speeds, x, y, turns, now.speed, left, now.yaw_rate))
        state, now, _ = mujoco.advance(state, np.tile(pair, (every, 1)), (k + 1) * dt)
    found = np.array(rows)
    pose = found[:, 2:5]
    c, s = math.cos(pose[0, 2]), math.sin(pose[0, 2])
    moved = (pose - pose[0]) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    t = np.arange(len(volts)) * dt
    return Drive(t, np.asarray(volts, dtype=np.float64), found[:, :2], moved, found[:, 5:])


def schedule(pieces: Sequence[tuple[float, float, float]], dt: float) -> Array:
    """Voltages of (duration [s], left, right) one after the other, (N, 2)."""
    return np.concatenate(
        [np.tile([left, right], (round(span / dt), 1)) for span, left, right in pieces]
    )


def random_schedule(seconds: float, dt: float, rng: np.random.Generator, most: float) -> Array:
    """Voltages of a drive that shows everything: straight ahead and back, spins, arcs and rests.

    Args:
        seconds: length of the drive.
        dt: sample time [s].
        rng: chance.
        most: largest voltage [V].
    """
    pieces: list[tuple[float, float, float]] = [(0.5, 0.0, 0.0)]
    kinds = ((1.0, 1.0), (1.0, -1.0), (0.0, 0.0), (1.0, 0.4), (0.4, 1.0))
    k = 0
    while sum(p[0] for p in pieces) < seconds:
        left, right = kinds[k % len(kinds)]
        size = most * float(rng.uniform(0.4, 1.0)) * float(rng.choice([-1.0, 1.0]))
        pieces.append((float(rng.uniform(0.6, 1.8)), size * left, size * right))
        k += 1
    return schedule(pieces, dt)[: round(seconds / dt)]


def columns(done: Drive, rng: np.random.Generator, noise: Sequence[float]) -> dict[str, Array]:
    """The log of a drive: ``t``, ``u_l``, ``u_r``, ``omega_l``, ``omega_r``, ``x``, ``y``, ``psi``.

    Args:
        done: what happened.
        rng: chance.
        noise: standard deviations of speeds [rad/s], of x and y [m] and of ψ [rad].
    """
    speed, place, angle = noise
    omega = done.omega + speed * rng.standard_normal(done.omega.shape)
    pose = done.pose + np.array([place, place, angle]) * rng.standard_normal(done.pose.shape)
    names = ("u_l", "u_r", "omega_l", "omega_r", "x", "y", "psi")
    values = np.column_stack([done.volts, omega, pose])
    return {"t": done.t} | dict(zip(names, values.T, strict=True))


def text(signals: dict[str, Any]) -> str:
    """The log as CSV, six digits."""
    rows = (",".join(f"{v:.6g}" for v in row) for row in zip(*signals.values(), strict=True))
    return "\n".join([",".join(signals), *rows]) + "\n"


if __name__ == "__main__":
    chance = np.random.default_rng(1)
    volts = random_schedule(60.0, 0.05, chance, 6.0)
    print(text(columns(drive(Machine(), volts, 0.05), chance, (0.05, 0.001, 0.002))), end="")
