"""Gains from the plant alone and margins of the loop, against closed forms and poles."""

import math

import numpy as np
import pytest
from mission_cases import Robot

from sysid.robot.mission.control.linear import PIDTerms
from sysid.robot.mission.tuning.axes import Axis, AxisAnswer, answer
from sysid.robot.mission.tuning.linear_loops import SampledLoop
from sysid.robot.mission.tuning.rules import LagModel, from_edge, from_lag, lag_model
from sysid.vehicle.kinematics import Geometry

PERIOD = 0.1
ROBOT = Robot()


@pytest.mark.parametrize("axis", Axis)
def test_the_lag_of_a_robot_is_read_off_its_answer(axis: Axis) -> None:
    model = lag_model(answer(ROBOT, Geometry(), axis), PERIOD)
    gain = ROBOT.top_speed if axis is Axis.SPEED else 2 * ROBOT.top_speed / Geometry().B
    # The answer is cut where it is within 0.1 % of its end.
    assert model.gain == pytest.approx(gain, rel=1e-3)
    assert model.lag == pytest.approx(ROBOT.lag, rel=5e-3)
    assert model.dead_time == pytest.approx(0.5 * PERIOD, abs=1e-3)  # the hold alone


@pytest.mark.parametrize("dead", [0.1, 0.3])
def test_a_dead_time_is_seen(dead: float) -> None:
    t = np.arange(100) * 0.1
    step = 2.0 * np.where(t > dead, -np.expm1(-np.maximum(t - dead, 0) / 0.5), 0.0)
    model = lag_model(AxisAnswer(Axis.SPEED, 0.1, step), PERIOD)
    assert (model.gain, model.lag) == pytest.approx((2.0, 0.5), rel=5e-3)
    assert model.dead_time == pytest.approx(dead + 0.5 * PERIOD, abs=5e-3)


def test_the_rules_are_those_of_the_papers() -> None:
    """K = 2, τ = 10, θ = 1: a = Kθ/τ = 0.2, r = 0.1."""
    rules = from_lag(Axis.SPEED, LagModel(2.0, 10.0, 1.0))
    zn, cc = rules["ziegler-nichols"], rules["cohen-coon"]
    assert zn["p"].kp == pytest.approx(5.0)
    assert (zn["pi"].kp, zn["pi"].ki) == pytest.approx((4.5, 4.5 * 0.3))
    assert (zn["pid"].kp, zn["pid"].ki, zn["pid"].kd) == pytest.approx((6.0, 3.0, 3.0))
    assert cc["p"].kp == pytest.approx(5 * (1 + 0.1 / 3))
    ti = (30 + 0.3) / (9 + 2.0)
    assert (cc["pi"].kp, cc["pi"].kp / cc["pi"].ki) == pytest.approx((5 * (0.9 + 0.1 / 12), ti))
    assert cc["pid"].kd / cc["pid"].kp == pytest.approx(4 / 11.2)
    assert (rules["lambda"]["pi"].kp, rules["lambda"]["pi"].ki) == pytest.approx((10 / 22, 1 / 22))
    assert (rules["simc"]["pi"].kp, rules["simc"]["pi"].ki) == pytest.approx((2.5, 2.5 / 8))


def test_the_edge_of_stability_is_that_of_the_poles() -> None:
    """z − a + K b = 0 reaches z = −1 at K = (1 + a)/b."""
    loop = SampledLoop.of(answer(ROBOT, Geometry(), Axis.SPEED), PERIOD)
    edge = loop.edge()
    assert edge is not None
    b = (1 - ROBOT.a) * ROBOT.top_speed
    assert edge[0] == pytest.approx((1 + ROBOT.a) / b, rel=2e-3)
    assert edge[1] == pytest.approx(2 * PERIOD)
    pi = from_edge(*edge)["pi"]
    assert (pi.kp, pi.ki) == pytest.approx((0.45 * edge[0], 0.45 * edge[0] * 1.2 / edge[1]))


def closed_loop_poles(axis: Axis, gains: PIDTerms) -> np.ndarray:
    """Roots of 1 + C(z) G(z) of the first-order robot."""
    K = ROBOT.top_speed if axis is Axis.SPEED else 2 * ROBOT.top_speed / Geometry().B
    num, den = np.array([K * (1 - ROBOT.a)]), np.array([1.0, -ROBOT.a])
    if axis is Axis.YAW:
        num = np.polymul(num, [0.5 * PERIOD, 0.5 * PERIOD])
        den = np.polymul(den, [1.0, -1.0])
    pole, origin = np.array([1.0, -1.0]), np.array([1.0, 0.0])
    both = np.polymul(pole, origin)
    top = gains.kp * both
    top = np.polyadd(top, gains.ki * PERIOD * np.polymul(origin, origin))
    top = np.polyadd(top, gains.kd / PERIOD * np.polymul(pole, pole))
    if gains.ki == 0:
        top, both = np.polydiv(top, pole)[0], origin
    return np.roots(np.polyadd(np.polymul(den, both), np.polymul(num, top)))


@pytest.mark.parametrize("axis", Axis)
def test_margins_are_true_to_the_poles(axis: Axis) -> None:
    loop = SampledLoop.of(answer(ROBOT, Geometry(), axis), PERIOD)
    rng = np.random.default_rng(11)
    judged = 0
    for kind in range(240):
        kp = float(np.exp(rng.uniform(-2, 3)))
        ki = float(np.exp(rng.uniform(-3, 4))) if kind % 2 else 0.0
        kd = float(np.exp(rng.uniform(-5, 0))) if kind % 3 == 0 else 0.0
        gains = PIDTerms(kp, ki, kd)
        radius = np.max(np.abs(closed_loop_poles(axis, gains)))
        if abs(radius - 1) < 0.02:
            continue  # the plant's answer is known to 0.1 % only
        result = loop.margins(gains)
        assert result.stable == (radius < 1), (gains, radius)
        judged += 1
        if result.stable and math.isfinite(result.gain):
            grown = PIDTerms(*(result.gain * g for g in (kp, ki, kd)))
            edge = np.max(np.abs(closed_loop_poles(axis, grown)))
            assert edge == pytest.approx(1.0, abs=0.02), gains
    assert judged > 150
