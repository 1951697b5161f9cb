"""Kinematics: inverses, closed forms and the laws of rotations."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid.errors import ModelError
from sysid.vehicle.frames import (
    angular_velocity,
    point_acceleration,
    point_velocity,
    rotation,
    rotation_x,
    rotation_y,
    rotation_z,
    to_body,
    to_inertial,
    to_inertial_twist,
)
from sysid.vehicle.kinematics import Geometry, body_velocity, step_pose, wheel_speeds, wrap_angle

ROBOT = Geometry()
law = settings(max_examples=100, deadline=None, derandomize=True)
speed = st.floats(-50, 50)
angle = st.floats(-100, 100)

# Sums of a handful of products of numbers of order one; each rounds at 1e-16.
ROUNDING = 1e-12


@law
@given(angle)
def test_wrapping_stays_in_the_interval_and_keeps_the_direction(a: float) -> None:
    wrapped = wrap_angle(a)
    assert -math.pi < wrapped <= math.pi
    assert abs(math.remainder(wrapped - a, 2 * math.pi)) < ROUNDING * (1 + abs(a))


@pytest.mark.parametrize(
    ("given_angle", "wrapped"),
    [
        (0.0, 0.0),
        (math.pi, math.pi),
        (-math.pi, math.pi),
        (3 * math.pi, math.pi),
        (-0.5 * math.pi, -0.5 * math.pi),
        (1.5 * math.pi, -0.5 * math.pi),
        # One rounding step past π: the remainder rounds to a full turn, and −π is not allowed.
        (math.nextafter(math.pi, 4.0), math.pi),
    ],
)
def test_wrapping_at_the_edges(given_angle: float, wrapped: float) -> None:
    assert wrap_angle(given_angle) == pytest.approx(wrapped, abs=ROUNDING)
    assert wrap_angle(np.array([given_angle]))[0] == wrap_angle(given_angle)


@law
@given(speed, speed, st.floats(0.01, 1.0), st.floats(0.05, 2.0))
def test_wheel_speeds_invert_body_velocity(
    omega_l: float, omega_r: float, r: float, B: float
) -> None:
    geometry = Geometry(r, B)
    back = wheel_speeds(*body_velocity(omega_l, omega_r, geometry), geometry)
    assert back == pytest.approx((omega_l, omega_r), abs=1e-9)


def test_straight_and_spot_turn_have_their_textbook_speeds() -> None:
    assert body_velocity(20.0, 20.0, ROBOT) == pytest.approx((0.43, 0.0))  # 20 rad/s · 21.5 mm
    assert body_velocity(-1.0, 1.0, ROBOT) == pytest.approx((0.0, 2 * 0.0215 / 0.186))


@law
@given(angle, st.floats(-1, 1), st.floats(-3, 3), st.floats(0.001, 2.0))
def test_an_arc_is_the_limit_of_small_euler_steps(
    psi: float, forward: float, yaw_rate: float, dt: float
) -> None:
    x, y, heading = 0.3, -0.2, psi
    n = 2000
    for _ in range(n):
        vx, vy = forward * math.cos(heading), forward * math.sin(heading)  # (2.14)
        x, y, heading = x + vx * dt / n, y + vy * dt / n, heading + yaw_rate * dt / n
    exact = step_pose(0.3, -0.2, psi, forward, yaw_rate, dt, xp=math)
    # Euler's error is at most ½·|V ψ̇|·dt²/n ≤ ½·3·4/2000.
    assert exact[:2] == pytest.approx((x, y), abs=3.1e-3)
    assert abs(wrap_angle(exact[2] - heading)) < 1e-9


@law
@given(angle, st.floats(-1, 1), st.floats(-3, 3), st.floats(0.001, 2.0))
def test_two_half_steps_are_one_step_and_backwards_returns(
    psi: float, forward: float, yaw_rate: float, dt: float
) -> None:
    whole = step_pose(0.0, 0.0, psi, forward, yaw_rate, dt, xp=math)
    half = step_pose(0.0, 0.0, psi, forward, yaw_rate, dt / 2, xp=math)
    twice = step_pose(*half, forward, yaw_rate, dt / 2, xp=math)
    assert twice[:2] == pytest.approx(whole[:2], abs=ROUNDING)
    back = step_pose(*whole, forward, yaw_rate, -dt, xp=math)
    assert back[:2] == pytest.approx((0.0, 0.0), abs=ROUNDING)


def test_a_full_circle_closes_and_a_quarter_lands_at_its_radius() -> None:
    radius = 0.5
    assert step_pose(0, 0, 0, radius, 1.0, 2 * math.pi)[:2] == pytest.approx((0, 0), abs=ROUNDING)
    quarter = step_pose(0.0, 0.0, 0.0, radius, 1.0, math.pi / 2)
    assert quarter == pytest.approx((radius, radius, math.pi / 2))


def test_arrays_give_what_floats_give() -> None:
    rates = np.array([-1.0, 0.0, 1e-300, 2.0])
    together = step_pose(1.0, 2.0, 0.5, 0.3, rates, 0.1)
    for i, rate in enumerate(rates):
        one = step_pose(1.0, 2.0, 0.5, 0.3, float(rate), 0.1, xp=math)
        assert [c[i] for c in together] == pytest.approx(one, abs=ROUNDING)


@law
@given(angle, angle, angle)
def test_rotations_are_orthogonal_with_determinant_one(
    phi: float, theta: float, psi: float
) -> None:
    R = rotation(phi, theta, psi)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=ROUNDING)
    assert np.linalg.det(R) == pytest.approx(1.0, abs=ROUNDING)


def test_simple_rotations_turn_the_axes_the_right_way() -> None:
    x, y, z = np.eye(3)
    quarter = math.pi / 2
    np.testing.assert_allclose(rotation_z(quarter) @ x, y, atol=ROUNDING)
    np.testing.assert_allclose(rotation_x(quarter) @ y, z, atol=ROUNDING)
    np.testing.assert_allclose(rotation_y(quarter) @ z, x, atol=ROUNDING)


def test_angular_velocity_is_the_rate_of_the_rotation_matrix() -> None:
    euler, rates, h = np.array([0.3, -0.4, 1.1]), np.array([0.5, 0.2, -0.7]), 1e-6
    R = rotation(*euler)
    R_rate = (rotation(*(euler + h * rates)) - rotation(*(euler - h * rates))) / (2 * h)
    skew = R_rate @ R.T  # Ṙ Rᵀ is the matrix of ω ×
    omega = angular_velocity(tuple(euler), tuple(rates))
    # Central difference: truncation h² and rounding 1e-16/h are both below 1e-9.
    np.testing.assert_allclose([skew[2, 1], skew[0, 2], skew[1, 0]], omega, atol=1e-9)


def test_frames_go_there_and_back() -> None:
    points = np.random.default_rng(0).normal(size=(5, 3))
    origin, attitude = np.array([1.0, -2.0, 0.5]), rotation(0.1, 0.2, 0.3)
    there = to_inertial(points, origin, attitude)
    np.testing.assert_allclose(there[0], origin + attitude @ points[0], atol=ROUNDING)
    np.testing.assert_allclose(to_body(there, origin, attitude), points, atol=ROUNDING)


def test_point_velocity_and_acceleration_are_derivatives_of_its_path() -> None:
    """A point that slides along a body that turns at a changing rate about a moving origin."""

    def place(t: float) -> np.ndarray:
        origin = np.array([0.3 * t, -0.1 * t * t, 0.0])
        return to_inertial(np.array([0.5 + 0.2 * t + t**2, -0.3 * t, 0.0]), origin, yaw(t))

    def yaw(t: float) -> np.ndarray:
        return rotation_z(0.4 + 0.7 * t + 0.6 * t * t)

    t, h = 0.8, 1e-4
    R = yaw(t)
    omega, omega_rate = np.array([0, 0, 0.7 + 1.2 * t]), np.array([0, 0, 1.2])
    arm = R @ [0.5 + 0.2 * t + t**2, -0.3 * t, 0.0]
    arm_rate, arm_rate2 = R @ [0.2 + 2 * t, -0.3, 0.0], R @ [2.0, 0.0, 0.0]
    velocity = point_velocity(np.array([0.3, -0.2 * t, 0.0]), omega, arm, arm_rate)
    acceleration = point_acceleration(
        np.array([0.0, -0.2, 0.0]), omega, omega_rate, arm, arm_rate, arm_rate2
    )
    # Central differences with h = 1e-4: truncation about h²·10, rounding 1e-16/h² for the second.
    np.testing.assert_allclose(velocity, (place(t + h) - place(t - h)) / (2 * h), atol=1e-6)
    second = (place(t + h) - 2 * place(t) + place(t - h)) / h**2
    np.testing.assert_allclose(acceleration, second, atol=1e-6)


@pytest.mark.parametrize("lengths", [(0.0, 0.1), (0.1, -1.0), (math.nan, 0.1), (0.1, math.inf)])
def test_impossible_geometry_is_refused(lengths: tuple[float, float]) -> None:
    with pytest.raises(ModelError, match="above 0"):
        Geometry(*lengths)


@law
@given(angle, speed, speed)
def test_the_inertial_twist_is_the_rate_of_the_pose(psi: float, left: float, right: float) -> None:
    """(2.10), (2.11) of (2.13) give (2.14)."""
    forward, yaw_rate = body_velocity(left, right, ROBOT)
    twist = to_inertial_twist(np.array([forward, 0.0, yaw_rate]), psi)
    expected = [forward * math.cos(psi), forward * math.sin(psi), yaw_rate]
    np.testing.assert_allclose(twist, expected, atol=ROUNDING)
