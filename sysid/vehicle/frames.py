"""Rotations and moving frames of a rigid body: (2.1)–(2.11) of the thesis.

Body frame b with x forward, y left, z up; inertial frame i with X, Y in the floor; φ, θ, ψ are
roll, pitch and yaw, ψ counter-clockwise positive.
"""

import math

import numpy as np

from sysid.data.record import Array


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


def to_inertial_twist(twist: Array, psi: float) -> Array:
    """Return ξⁱ = Rⁱ_b ξᵇ, shape (3,): (V_X, V_Y, ψ̇) of (V_x, V_y, ψ̇) (thesis 2.10, 2.11).

    Args:
        twist: ξᵇ, in the body frame [m/s, m/s, rad/s].
        psi: yaw [rad].
    """
    turned: Array = rotation_z(psi) @ twist
    return turned
