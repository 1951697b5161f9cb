"""A tracked vehicle in three dimensions, by another physics engine: the judge of our own dynamics.

MuJoCo (Todorov, Erez & Tassa 2012) drives a box on two rows of wheels over a rigid floor. The
wheels of a row turn together, as those under a track do, and touch the floor in points with Coulomb
friction that knows no direction: what it leaves for driving is what the slip to the side does not
need. With an even number of wheels at the middles of equal pieces of the contact length, their mean
distance from the centre is L/4, that of a uniform pressure.

Needs the extra ``physics`` (the package ``mujoco``); run as a file, it writes a log.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

STEP = 0.001
"""Step of the engine [s]: a tenth of the fastest time constant of its contacts."""

G = 9.81
"""Acceleration of free fall [m/s²]."""

WHEEL_MASS = 0.02
"""Of one wheel [kg], part of the machine's mass."""

SAG = 0.002
"""Way by which the wheels' springs give under the load [m]: it spreads the load evenly, as the
road wheels of a track do. Without springs the loads on eight points of a rigid body are undecided,
and a contact model that lifts sliding points a little puts all of it on a few."""

SETTLING = 0.3
"""Time for which it stands before the drive begins [s]: contacts sink in by micrometres."""


@dataclass(frozen=True)
class BenchMotor:
    """One side's motor and gear as the sprocket feels them: τ = k u − d ω − J ω̇ − c sign ω.

    The numbers are the thesis's (2.53–2.61, §5.2): R 3.1 Ω, Kem 0.0023, Kc 8.6626e-4, f 1.0651e-7,
    J 1e-7, C0 2.9658e-5, gear 120.

    Attributes:
        torque_per_volt: k [Nm/V].
        damping: d, friction and back-EMF [Nm/(rad/s)].
        inertia: J [kg m²].
        dry_friction: c [Nm].
    """

    torque_per_volt: float = 120.0 * 8.6626e-4 / 3.1
    damping: float = 120.0**2 * (8.6626e-4 * 0.0023 / 3.1 + 1.0651e-7)
    inertia: float = 120.0**2 * 1e-7
    dry_friction: float = 120.0 * 2.9658e-5


@dataclass(frozen=True)
class Machine:
    """A box on two rows of wheels.

    Attributes:
        mass: of the whole [kg].
        yaw_inertia: of the whole, about the vertical through the centre of mass [kg m²].
        r, B, L: radius of the wheels, distance of the rows, contact length [m].
        size: length, width, height of the box [m].
        height: of the centre of mass over the floor [m].
        centre: how far the centre of mass lies ahead of the middle of the wheels [m].
        wheels: of one row; an even number.
        friction: between wheels and floor [1].
        rolling: rolling resistance over load [1].
        motor: of each side.
    """

    mass: float = 1.5
    yaw_inertia: float = 0.02
    r: float = 0.0215
    B: float = 0.186
    L: float = 0.14
    size: tuple[float, float, float] = (0.19, 0.134, 0.047)
    height: float = 0.03
    centre: float = 0.0
    wheels: int = 4
    friction: float = 0.6
    rolling: float = 0.03
    motor: BenchMotor = BenchMotor()

    @property
    def places(self) -> Array:
        """How far each wheel of a row lies ahead of its middle [m], (wheels,)."""
        return self.L * ((np.arange(self.wheels) + 0.5) / self.wheels - 0.5)

    @property
    def scrub(self) -> tuple[float, float]:
        """Turning on the spot on points of isotropic friction: moment [Nm], effective width [m].

        Every wheel slides with (c, ψ̇x) and is pushed back by μN along it. Both rows must give the
        moment that the sideways parts need, which settles the creep c:

            B Σ c/√(c² + x²) = 2 Σ x²/√(c² + x²)    (c in units of ψ̇; sums over one row)

        The moment on the sprockets is B/2 of the forces forward, and rω = ψ̇(B/2 + c).
        """
        x2 = self.places**2
        low, high = 0.0, self.L
        for _ in range(60):
            c = 0.5 * (low + high)
            size = np.sqrt(c * c + x2)
            more = self.B * float(np.sum(c / size)) < 2.0 * float(np.sum(x2 / size))
            low, high = (c, high) if more else (low, c)
        load = self.mass * G / (2 * self.wheels)
        forward = self.friction * load * float(np.sum(c / np.sqrt(c * c + x2)))
        return forward * self.B, self.B + 2.0 * c


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
        ImportError: MuJoCo is not installed.
        ValueError: ``dt`` is no multiple of the engine's step.
    """
    import mujoco

    every = round(dt / STEP)
    if every < 1 or not math.isclose(every * STEP, dt, rel_tol=1e-9):
        raise ValueError(f"dt is {dt} s: give a multiple of {STEP} s")
    model = mujoco.MjModel.from_xml_string(_scene(machine))
    data = mujoco.MjData(model)
    for _ in range(round(SETTLING / STEP)):
        mujoco.mj_step(model, data)
    n = machine.wheels
    rows = [model.joint(f"{side}0").dofadr[0] for side in "lr"]
    rolled = np.empty((len(volts), 2))
    pose, velocity = np.empty((len(volts), 3)), np.empty((len(volts), 3))
    turns = 0.0
    for k, pair in enumerate(volts):
        rolled[k] = data.qvel[rows]
        forward = data.xmat[1].reshape(3, 3)
        psi = math.atan2(forward[1, 0], forward[0, 0])
        turns = psi + 2.0 * math.pi * round((turns - psi) / (2.0 * math.pi))
        pose[k] = (*data.xipos[1][:2], turns)
        spin = float(data.qvel[5])
        c, s = math.cos(psi), math.sin(psi)
        # the joint's speed is that of the body's origin, which lies behind the centre of mass
        vx, vy = float(data.qvel[0]), float(data.qvel[1])
        velocity[k] = (c * vx + s * vy, c * vy - s * vx + spin * machine.centre, spin)
        data.ctrl[:] = np.repeat(pair, n)
        for _ in range(every):
            mujoco.mj_step(model, data)
    t = np.arange(len(volts)) * dt
    start = pose[0]
    c, s = math.cos(start[2]), math.sin(start[2])
    moved = (pose - start) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Drive(t, np.asarray(volts, dtype=np.float64), rolled, moved, velocity)


def _scene(m: Machine) -> str:
    """The machine and its floor in MuJoCo's XML.

    The wheels' joints carry motor, gear and rolling resistance, which acts on the sprocket as the
    force on the vehicle does: r μr N.
    """
    n = m.wheels
    parts = 2 * n * WHEEL_MASS
    x2 = float(np.sum(m.places**2)) * 2.0
    body = m.mass - parts
    inertia = m.yaw_inertia - WHEEL_MASS * (x2 + 2.0 * n * (m.B / 2.0) ** 2)
    length, width, tall = m.size
    pitch = body / 12.0 * (length**2 + tall**2)
    roll = max(body / 12.0 * (width**2 + tall**2), inertia - pitch + 1e-6)
    load = m.mass * G / (2 * n)
    dry = m.motor.dry_friction / n + m.rolling * load * m.r
    stiff = load / SAG
    damp = 2.0 * math.sqrt(stiff * WHEEL_MASS)
    spots = [
        (f"{side}{j}", x, y)
        for side, y in (("l", m.B / 2.0), ("r", -m.B / 2.0))
        for j, x in enumerate(m.places.tolist())
    ]
    wheels = "".join(
        f"""
        <body name="{name}" pos="{x!r} {y!r} {m.r!r}">
          <joint type="slide" axis="0 0 1" stiffness="{stiff!r}" damping="{damp!r}"/>
          <joint name="{name}" axis="0 1 0" armature="{m.motor.inertia / n!r}"
                 damping="{m.motor.damping / n!r}" frictionloss="{dry!r}"/>
          <inertial pos="0 0 0" mass="{WHEEL_MASS}" diaginertia="1e-7 1e-7 1e-7"/>
          <geom type="sphere" size="{m.r!r}" friction="{m.friction!r}" condim="3"
                contype="0" conaffinity="1"/>
        </body>"""
        for name, x, y in spots
    )
    motors = "".join(
        f'<motor joint="{name}" gear="{m.motor.torque_per_volt / n!r}"/>' for name, _, _ in spots
    )
    rows = "".join(
        f'<joint joint1="{side}{j}" joint2="{side}0" solref="0.002 1"/>'
        for side in "lr"
        for j in range(1, n)
    )
    return f"""
    <mujoco>
      <option timestep="{STEP}" gravity="0 0 -{G}" cone="elliptic" impratio="50"
              integrator="implicitfast"/>
      <default><geom solref="0.007 1" solimp="0.9 0.95 0.001"/>
        <joint solreffriction="0.002 1" solimpfriction="0.99 0.999 0.001"/></default>
      <worldbody>
        <geom type="plane" size="0 0 1" friction="{m.friction!r}" condim="3" conaffinity="0"/>
        <body name="box" pos="0 0 0"><freejoint/>
          <inertial pos="{m.centre!r} 0 {m.height!r}" mass="{body!r}"
                    diaginertia="{roll!r} {pitch!r} {inertia!r}"/>
          {wheels}
        </body>
      </worldbody>
      <equality>{rows}</equality>
      <actuator>{motors}</actuator>
    </mujoco>"""


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
