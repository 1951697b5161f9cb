"""Plain machines by seed: linear drives of first order, as a log of 20 Hz sees them.

They are drawn by what a data sheet or a bench tells (free speed, time constant, resistance, ratio),
from which the constants follow. Nothing of the catalogue is in them; ``causes.py`` puts it
there.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from sysid_datasets.physics.parameters import (
    Battery,
    Body,
    Drive,
    Friction,
    Gearbox,
    Machine,
    Motor,
    Sensor,
)
from sysid_datasets.physics.simulate import Telemetry
from sysid_datasets.physics.wire import PoseSensor, Wire

Change = Callable[[Drive, float], Drive]
"""Puts something into a drive, its size times a factor near 1."""


@dataclass(frozen=True)
class Rig:
    """A machine with its clocks and lines: all that a log depends on but commands and noise."""

    machine: Machine
    telemetry: Telemetry = field(default_factory=Telemetry)
    wire: Wire = field(default_factory=Wire)
    pose: PoseSensor | None = None
    """Where the log has a pose."""
    lengths: tuple[float, float] | None = None
    """Radius and width as a drawing has them [m], where the log has a pose."""


@dataclass(frozen=True)
class Figures:
    """What sizes are drawn in shares of."""

    speed: float
    """Of the faster output at full drive without load [rad/s]."""
    time_constant: float
    """[s]."""
    stall_torque: float
    """At the output [N m]."""
    stall_current: float
    """[A]."""


def plain_machine(rng: np.random.Generator, drives: int = 2, volts: float = 12.0) -> Machine:
    """Drives whose speed is 15 … 35 rad/s at full drive, with time constants of 0.1 … 0.35 s."""
    speed, lag = rng.uniform(15.0, 35.0), rng.uniform(0.1, 0.35)
    resistance, ratio = log_uniform(rng, 0.8, 6.0), rng.uniform(15.0, 60.0)
    viscous_share = rng.uniform(0.05, 0.25)
    made = []
    for k in range(drives):
        spread = 1.0 + (0.0 if k == 0 else rng.choice([-1.0, 1.0]) * rng.uniform(0.02, 0.1))
        constant = volts * (1.0 - viscous_share) / (speed * spread * ratio)
        damping = (constant * ratio) ** 2 / resistance / (1.0 - viscous_share)
        inertia = lag * spread * damping
        share = rng.uniform(0.3, 0.7)
        viscous = viscous_share * damping
        made.append(
            Drive(
                motor=Motor(
                    resistance=resistance,
                    inductance=resistance * rng.uniform(2e-4, 4e-4),
                    constant=constant,
                    inertia=share * inertia / ratio**2,
                ),
                gearbox=Gearbox(ratio=ratio, load_inertia=(1.0 - share) * inertia),
                friction=Friction(viscous_forward=viscous, viscous_backward=viscous),
                sensor=Sensor(lines=0.0),
            )
        )
    return Machine(drives=tuple(made), battery=Battery(full=volts))


def figures(machine: Machine) -> Figures:
    """Free speed, time constant and stall of a plain machine's first drive."""
    d, volts = machine.drives[0], machine.battery.full
    k = d.motor.constant * d.gearbox.ratio
    damping = k**2 / d.motor.resistance + d.friction.viscous_forward
    inertia = d.gearbox.load_inertia + d.motor.inertia * d.gearbox.ratio**2
    current = volts / d.motor.resistance
    return Figures(k * current / damping, inertia / damping, k * current, current)


def with_body(machine: Machine, rng: np.random.Generator, *, coupled: float = 0.0) -> Machine:
    """The same drives under a body that grips firmly: it doubles their inertia.

    Args:
        machine: in the air.
        rng: of mass and width.
        coupled: Jz/(m B²/4) − 1: where it is 0 the tracks do not feel each other.
    """
    d = machine.drives[0]
    inertia = d.gearbox.load_inertia + d.motor.inertia * d.gearbox.ratio**2
    mass = log_uniform(rng, 2.0, 20.0)
    radius = math.sqrt(2.0 * inertia / mass)
    width = radius * rng.uniform(6.0, 12.0)
    body = Body(
        mass=mass,
        yaw_inertia=mass * width**2 / 4.0 * (1.0 + coupled),
        radius_left=radius,
        radius_right=radius,
        width=width,
        length=0.0,
        side_grip=0.8,
        slip_speed=0.002,
    )
    return replace(machine, body=body)


FIRM = 2.2
"""A track turns on firm ground however hard its drive pulls: at stall, or twice that when it is
reversed from speed."""


def on_firm_ground(machine: Machine) -> Machine:
    """A machine with a body whose tracks do not slide along the ground, which gives as before."""
    b = machine.body
    weight = 0.5 * b.mass * b.gravity * b.radius_left
    grip = max(b.grip, FIRM * figures(machine).stall_torque / weight)
    return replace(machine, body=replace(b, grip=grip, slip_speed=b.slip_speed * grip / b.grip))


SPREAD = 0.08
"""By what share a cause may be larger or smaller in a drive."""


def each(machine: Machine, rng: np.random.Generator, change: Change) -> tuple[Machine, list[int]]:
    """Change both drives (three times in five) or one of them, by up to ``SPREAD`` more or less."""
    count = len(machine.drives)
    chosen = list(range(count)) if rng.uniform() < 0.6 else [int(rng.integers(count))]
    spread = 1.0 + SPREAD * rng.uniform(-1.0, 1.0, count)
    drives = tuple(
        change(d, float(spread[k])) if k in chosen else d for k, d in enumerate(machine.drives)
    )
    return replace(machine, drives=drives), chosen


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """As often between 1 and 2 as between 10 and 20."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def seen_from_above(rig: Rig) -> Rig:
    """The rig with a pose in its log; its lengths as they are now are those of the drawing."""
    body = rig.machine.body
    return replace(rig, pose=PoseSensor(), lengths=(body.radius_left, body.width))
