"""The motor of a track as a source of torque at its sprocket."""

import math
from typing import Any, NamedTuple

from sysid.vehicle.kinematics import Real


class Motor(NamedTuple):
    """A geared motor, everything reckoned at the sprocket of its track.

        J ω̇ = S (sat(d) − o) − D ω − friction − r F        d: share of full drive, −1 … 1
        |friction| ≤ M (1 + (k − 1)/(1 + (ω/ω_s)²)) + q ω²    backward: × r_c and + (r_v − 1) D|ω|

    R, K_em, K_c of (2.53)–(2.56) with L di/dt neglected make S = n K_c U/R and
    D = n²(K_c K_em/R + f): a motor that turns faster than its voltage allows brakes.
    Every number may be traced by a compiler.

    Attributes:
        torque: S, stall torque at full drive [Nm].
        damping: D, torque that speed takes away [Nm s/rad].
        inertia: J of rotor, gear and sprocket [kg m²].
        friction: M, torque of dry friction when it slides [Nm].
        breakaway: k, friction at standstill over M [1].
        stribeck: ω_s, speed at which half of that extra friction is gone [rad/s].
        limit: drive beyond which there is no more torque [1].
        offset: o, drive that a constant load takes away [1].
        friction_back, damping_back: r_c, r_v, of the way back over those of the way forth [1].
        drag: q, torque that grows with the square of speed [Nm s²/rad²].
    """

    torque: Real
    damping: Real
    inertia: Real
    friction: Real
    breakaway: Real = 1.0
    stribeck: Real = 1.0
    limit: Real = math.inf
    offset: Real = 0.0
    friction_back: Real = 1.0
    damping_back: Real = 1.0
    drag: Real = 0.0


class TorqueSource(NamedTuple):
    """The motors of an identified plant, one or the left and the right one.

    Attributes:
        motors: of each output; ``drive`` counts in the unit of the plant's input, of which
            ``torque`` is the stall torque of one and ``limit`` and ``offset`` are values.
        body: what of the inertia the plant shares between its tracks or has beside its motors, as
            a part of theirs: 0 with the tracks lifted, more where the body moved along.
    """

    motors: tuple[Motor, ...]
    body: Real = 0.0


class Bench(NamedTuple):
    """Constants of one geared motor as the bench gives them (thesis 2.53–2.61, §5.2).

    Attributes:
        resistance: R of the armature [Ω].
        back_emf: K_em, on the motor's side of the gear [V s/rad].
        torque_constant: K_c, likewise [Nm/A].
        viscous: f, likewise [Nm s/rad].
        inertia: J of the rotor with its load, likewise [kg m²].
        friction: C₀, likewise [Nm].
        gear: turns of the motor for one of the sprocket.
    """

    resistance: Real = 3.1
    back_emf: Real = 0.0023
    torque_constant: Real = 8.6626e-4
    viscous: Real = 1.0651e-7
    inertia: Real = 1e-7
    friction: Real = 2.9658e-5
    gear: Real = 120.0

    def motor(self, volts: Real = 7.5) -> Motor:
        """The motor where full drive puts this voltage on it [V]."""
        n, per_volt = self.gear, self.torque_constant / self.resistance
        return Motor(
            torque=n * per_volt * volts,
            damping=n * n * (per_volt * self.back_emf + self.viscous),
            inertia=n * n * self.inertia,
            friction=n * self.friction,
        )


def lumped_motor(stall: Real, gain: Real, time_constant: Real, friction: Real) -> Motor:
    """The motor of T ω̇ = K d − ω − K c sign(ω), once its stall torque is known.

    S = stall torque; then D = S/K, J = T D and M = S c.

    Args:
        stall: S at full drive [Nm].
        gain: K, speed at full drive without friction [rad/s].
        time_constant: T [s].
        friction: c, drive that sliding friction takes away [1].
    """
    damping = stall / gain
    return Motor(stall, damping, time_constant * damping, stall * friction)


def friction_limits(motor: Motor, omega: Real, xp: Any) -> tuple[Real, Real]:
    """Largest friction against backward and against forward motion at a speed.

    Args:
        omega: ω [rad/s].

    Returns:
        Two torques, both ≥ 0 [Nm].
    """
    ratio = omega / (motor.stribeck + 1e-12)
    dry = motor.friction * (1.0 + (motor.breakaway - 1.0) / (1.0 + ratio * ratio))
    drag = motor.drag * omega * omega
    slower = (motor.damping_back - 1.0) * motor.damping * xp.maximum(-omega, 0.0)
    back = xp.maximum(motor.friction_back * dry + drag + slower, 0.0)
    return back, dry + drag


def applied_torque(motor: Motor, drive: Real, xp: Any) -> Real:
    """S (sat(d) − o): torque before damping and friction [Nm].

    Args:
        drive: d, share of full drive [1].
    """
    within = xp.minimum(xp.maximum(drive, -motor.limit), motor.limit)
    return motor.torque * (within - motor.offset)
