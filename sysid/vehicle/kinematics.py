"""Planar kinematics of a tracked or differential-drive robot, and the frame transforms behind it.

Symbols and equation numbers are the thesis's (chapter 2): body frame b with x forward, y left,
z up; inertial frame i with X, Y in the floor; yaw ψ counter-clockwise positive; r the sprocket
radius [m], B the distance of the track centre lines [m], ω the sprocket speeds [rad/s].

Every function is pure and written with operators, so that floats, NumPy and JAX arrays all work;
functions that need a sine take the namespace as ``xp`` (``numpy``, ``jax.numpy``, or ``math`` for
plain floats, which is some ten times faster than NumPy on scalars).
"""

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError

Real: TypeAlias = Any
"""A float, or a NumPy or JAX array of floats that broadcasts against the other arguments."""


@dataclass(frozen=True)
class Geometry:
    """What turns sprocket speeds into the motion of the body.

    Attributes:
        r: sprocket radius [m].
        B: distance between the centre lines of the tracks [m].

    A length that a compiler traces is not checked.

    Raises:
        ModelError: a length is not positive and finite.
    """

    r: Real = 0.0215
    B: Real = 0.186

    def __post_init__(self) -> None:
        for name, value in (("sprocket radius r", self.r), ("track distance B", self.B)):
            if isinstance(value, int | float) and not (math.isfinite(value) and value > 0):
                raise ModelError(f"the {name} is {value}: give a length in metres above 0")


# Motion in the plane: (2.10)–(2.14) ---------------------------------------------------------------


def body_velocity(omega_l: Real, omega_r: Real, geometry: Geometry) -> tuple[Real, Real]:
    """Return the forward speed Vx [m/s] and the yaw rate ψ̇ [rad/s] of the body.

    Vx = (r/2)(ω_L + ω_R),  Vy = 0,  ψ̇ = (r/B)(ω_R − ω_L)     (thesis 2.13)
    """
    forward = 0.5 * geometry.r * (omega_l + omega_r)
    yaw_rate = geometry.r / geometry.B * (omega_r - omega_l)
    return forward, yaw_rate


def wheel_speeds(forward: Real, yaw_rate: Real, geometry: Geometry) -> tuple[Real, Real]:
    """Return the sprocket speeds ω_L, ω_R [rad/s] of a forward speed and a yaw rate.

    ω_L = (Vx − ψ̇B/2)/r,  ω_R = (Vx + ψ̇B/2)/r     (thesis 2.13, inverted)
    """
    sideways = 0.5 * geometry.B * yaw_rate
    return (forward - sideways) / geometry.r, (forward + sideways) / geometry.r


def step_pose(
    x: Real, y: Real, psi: Real, forward: Real, yaw_rate: Real, dt: Real, xp: Any = np
) -> tuple[Real, Real, Real]:
    """Move a pose along the arc of constant Vx and ψ̇ for ``dt`` seconds; exact, not Euler.

    The chord of the arc has length Vx·dt·sin(a)/a with a = ψ̇·dt/2, in the direction ψ + a;
    this solves (2.14) exactly for constant speeds, straight lines (a = 0) included.

    Args:
        x, y: position in the inertial frame [m].
        psi: yaw [rad].
        forward: Vx [m/s].
        yaw_rate: ψ̇ [rad/s].
        dt: duration [s]; negative runs the arc backwards.
        xp: array namespace with ``cos`` and ``sin``.

    Returns:
        The new x, y [m] and ψ [rad], ψ wrapped to (−π, π].
    """
    half = 0.5 * yaw_rate * dt
    # sin(a)/a without a branch: value 1 and derivative 0 at a = 0, for floats and traced arrays.
    straight = half == 0
    chord = forward * dt * (xp.sin(half) + straight) / (half + straight)
    return (
        x + chord * xp.cos(psi + half),
        y + chord * xp.sin(psi + half),
        wrap_angle(psi + 2.0 * half),
    )


def wrap_angle(angle: Real) -> Real:
    """Return the angle [rad] plus the multiple of 2π that brings it into (−π, π]."""
    wrapped = math.pi - (math.pi - angle) % (2.0 * math.pi)
    # A remainder that rounds up to 2π would give −π, which the half-open interval leaves out.
    return wrapped + 2.0 * math.pi * (wrapped <= -math.pi)


# Rotations and moving frames: (2.1)–(2.9) ---------------------------------------------------------


def rotation_x(phi: float) -> Array:
    """Return R_x(φ), shape (3, 3): a roll of φ [rad] about x."""
    c, s = math.cos(phi), math.sin(phi)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_y(theta: float) -> Array:
    """Return R_y(θ), shape (3, 3): a pitch of θ [rad] about y."""
    c, s = math.cos(theta), math.sin(theta)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_z(psi: float) -> Array:
    """Return R_z(ψ), shape (3, 3): a yaw of ψ [rad] about z; in the plane it is Rⁱ_b of (2.10)."""
    c, s = math.cos(psi), math.sin(psi)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation(phi: float, theta: float, psi: float) -> Array:
    """Return Rᵃ_b = R_z(ψ) R_y(θ) R_x(φ), shape (3, 3), with vᵃ = Rᵃ_b vᵇ (thesis 2.1).

    The Euler angles turn a into b: ψ about z, θ about the new y, φ about the newest x [rad].
    The inverse is the transpose, and rotations chain as Rᵃ_c = Rᵃ_b Rᵇ_c.
    """
    return rotation_z(psi) @ rotation_y(theta) @ rotation_x(phi)


def angular_velocity(euler: tuple[float, float, float], rates: tuple[float, float, float]) -> Array:
    """Return ωᵃ_ab, shape (3,) [rad/s]: the angular velocity of b against a, in a's coordinates.

    ωᵃ_ab = (0, 0, ψ̇)ᵀ + R_z(ψ)(0, θ̇, 0)ᵀ + R_z(ψ)R_y(θ)(φ̇, 0, 0)ᵀ     (thesis, after 2.1)

    Args:
        euler: φ, θ, ψ [rad].
        rates: φ̇, θ̇, ψ̇ [rad/s].
    """
    _, theta, psi = euler
    yaw = rotation_z(psi)
    roll_rate, pitch_rate, yaw_rate = rates
    omega: Array = (
        np.array([0.0, 0.0, yaw_rate])
        + yaw @ np.array([0.0, pitch_rate, 0.0])
        + yaw @ rotation_y(theta) @ np.array([roll_rate, 0.0, 0.0])
    )
    return omega


def to_inertial(point: Array, origin: Array, attitude: Array) -> Array:
    """Return r_P = r₀ + Rⁱ_b rᵇ (thesis 2.3): body coordinates (…, 3) to inertial ones [m]."""
    moved: Array = origin + point @ attitude.T
    return moved


def to_body(point: Array, origin: Array, attitude: Array) -> Array:
    """Return rᵇ = (Rⁱ_b)ᵀ(r_P − r₀): inertial coordinates (…, 3) to body ones [m]."""
    moved: Array = (point - origin) @ attitude
    return moved


def point_velocity(v0: Array, omega: Array, arm: Array, arm_rate: Array) -> Array:
    """Return v_P = v₀ + ᵇdr/dt + ω_ib × r, shape (3,) [m/s] (thesis 2.2, 2.7).

    Args:
        v0: velocity of the body's reference point [m/s].
        omega: angular velocity ω_ib [rad/s].
        arm: r, from the reference point to P [m].
        arm_rate: ᵇdr/dt, the rate of r seen from the body [m/s]; zero for a rigid body.
        All of shape (3,), in the coordinates of one frame.
    """
    velocity: Array = v0 + arm_rate + np.cross(omega, arm)
    return velocity


def point_acceleration(
    a0: Array, omega: Array, omega_rate: Array, arm: Array, arm_rate: Array, arm_rate2: Array
) -> Array:
    """Return a_P, shape (3,) [m/s²] (thesis 2.9).

    a_P = a₀ + ᵇd²r/dt² + 2ω × ᵇdr/dt (Coriolis) + ω̇ × r (transversal) + ω × (ω × r) (centripetal)

    Args:
        a0: acceleration of the reference point [m/s²].
        omega, omega_rate: ω_ib [rad/s] and its derivative [rad/s²].
        arm, arm_rate, arm_rate2: r [m] and its first two derivatives seen from the body.
        All of shape (3,), in the coordinates of one frame.
    """
    acceleration: Array = (
        a0
        + arm_rate2
        + 2.0 * np.cross(omega, arm_rate)
        + np.cross(omega_rate, arm)
        + np.cross(omega, np.cross(omega, arm))
    )
    return acceleration
