"""The lumped motor in steady state and after a step (thesis 2.53–2.61, 5.2)."""

from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array


@dataclass(frozen=True)
class MotorConstants:
    """Constants of a geared DC motor, on the side of the motor's shaft.

        V = L di/dt + R i + Kem ω        Kc i = τ Cr + C0 + f ω + J dω/dt        τ = 1/gear

    Attributes:
        R: resistance [Ω].
        Kem: back-EMF constant [V/(rad/s)].
        Kc: torque constant [Nm/A].
        f: viscous friction [Nm/(rad/s)].
        C0: dry friction [Nm].
        J: inertia [kg m²]; 0 where it is not known.
        L: inductance [H], 0 where it is neglected.
        gear: turns of the motor for one of the output shaft.
    """

    R: float
    Kem: float
    Kc: float
    f: float
    C0: float
    J: float = 0.0
    L: float = 0.0
    gear: float = 120.0


PUBLISHED = MotorConstants(3.1, 0.0023, 8.6626e-4, 1.0651e-7, 2.9658e-5, 1e-7)
"""What the thesis prints for its motor (§5.3)."""


def steady_state(
    c: MotorConstants, voltage: Array, load: Array | float = 0.0
) -> tuple[Array, Array]:
    """Speed of the output shaft [rad/s] and current [A] where nothing changes any more.

        ω = (V − R (C0 + τ Cr)/Kc)/(Kem + R f/Kc),        i = (V − Kem ω)/R

    A motor that cannot overcome friction and load stands, and takes the current of a blocked rotor.

    Args:
        voltage: [V], (N,).
        load: torque that resists at the output shaft [Nm], (N,) or one for all.
    """
    resisting = c.R * (c.C0 + np.asarray(load) / c.gear) / c.Kc
    drive = np.maximum(np.abs(voltage) - resisting, 0.0)
    motor = np.sign(voltage) * drive / (c.Kem + c.R * c.f / c.Kc)
    return np.asarray(motor / c.gear), np.asarray((voltage - c.Kem * motor) / c.R)


def torque_speed(c: MotorConstants, voltage: float, points: int = 50) -> tuple[Array, Array, Array]:
    """The characteristic of one voltage, from standstill to the speed without load.

        C = gear (Kc (V − Kem ω)/R − C0 − f ω)

    Args:
        voltage: [V].

    Returns:
        Speed [rad/s] and torque [Nm] of the output shaft, and current [A], (points,) each.
    """
    top = float(steady_state(c, np.array([voltage]))[0][0])
    speed = np.linspace(0.0, top, points)
    motor = c.gear * speed
    current = (voltage - c.Kem * motor) / c.R
    torque = c.gear * (c.Kc * current - np.sign(voltage) * c.C0 - c.f * motor)
    return speed, torque, current


def step_response(
    c: MotorConstants, voltage: float, load: float = 0.0, seconds: float = 1.0, points: int = 201
) -> tuple[Array, Array, Array]:
    """Speed and current after a step of the voltage from standstill, L di/dt neglected.

        ω = ω∞ (1 − e^(−t/T)),        T = J/(f + Kc Kem/R)

    Args:
        c: the motor; J must be known.
        voltage: [V].
        load: torque that resists at the output shaft [Nm].

    Returns:
        Time [s], speed of the output shaft [rad/s] and current [A], (points,) each.
    """
    t = np.linspace(0.0, seconds, points)
    end = float(steady_state(c, np.array([voltage]), load)[0][0])
    speed = end * (1.0 - np.exp(-t / time_constant(c)))
    return t, speed, np.asarray((voltage - c.Kem * c.gear * speed) / c.R)


def time_constant(c: MotorConstants) -> float:
    """Mechanical time constant J/(f + Kc Kem/R) [s]."""
    return c.J / (c.f + c.Kc * c.Kem / c.R)
