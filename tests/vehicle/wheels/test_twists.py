"""Inverse and forward kinematics: closed forms, and each undoes the other."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sysid
from sysid.errors import UsageError
from sysid.vehicle.wheels.twists import speeds_determine_motion
from sysid.vehicle.wheels.vehicle import Vehicle
from sysid.vehicle.wheels.wheel import Wheel, velocity_at

EXAMPLES = Path(__file__).resolve().parents[3] / "datasets" / "vehicles"
law = settings(max_examples=60, deadline=None, derandomize=True)
VEHICLES = {p.stem: sysid.load_vehicle(p) for p in EXAMPLES.glob("*.yaml")}
NAMES = sorted(VEHICLES)
motion = st.tuples(*(st.floats(-2, 2).map(lambda v: round(v, 3)) for _ in range(3)))


@law
@given(st.sampled_from([n for n in NAMES if speeds_determine_motion(VEHICLES[n].wheels)]), motion)
def test_forward_undoes_inverse(name: str, wanted: Sequence[float]) -> None:
    vehicle = VEHICLES[name]
    answer = vehicle.inverse(wanted)
    driven = {n: w for n, w in answer.wheels.items() if vehicle_kind(vehicle, n) != "caster"}
    speeds = {n: w.speed for n, w in driven.items() if w.speed is not None}
    angles = {n: w.angle for n, w in driven.items() if w.angle is not None}
    size = 1 + float(np.abs(answer.wanted).max())
    back = vehicle.forward(speeds, angles)
    # near-parallel axles enlarge rounding by the inverse of the rank's tolerance, 1e3
    np.testing.assert_allclose(back.twist, answer.possible, atol=1e-9 * size)
    assert back.residual <= 1e-9 * size


def vehicle_kind(vehicle: Vehicle, name: str) -> str:
    return next(w.kind for w in vehicle.wheels if w.name == name)


@law
@given(st.sampled_from(NAMES), motion)
def test_no_wheel_slides_at_the_possible_motion(name: str, wanted: Sequence[float]) -> None:
    vehicle = VEHICLES[name]
    answer = vehicle.inverse(wanted)
    for wheel in vehicle.wheels:
        angle = answer.wheels[wheel.name].angle
        if wheel.kind == "swedish" or (wheel.kind == "caster" and angle is None):
            continue
        across = float(np.dot(wheel.sliding_row(angle), answer.possible))
        assert abs(across) < 1e-8  # angles at a limit may stand beyond it by 1e-9
        vx, vy = velocity_at(wheel.contact(angle), answer.possible)
        speed = answer.wheels[wheel.name].speed
        assert speed is not None
        assert abs(speed) * wheel.r == pytest.approx(math.hypot(vx, vy), abs=1e-8)
        if wheel.angle_limits is not None and angle is not None:
            low, high = wheel.angle_limits
            assert low <= angle <= high


def test_mecanum_wheels_have_their_textbook_speeds() -> None:
    """ω = (Vx ∓ Vy ∓ (a + b) ψ̇)/r with half lengths a = 0.2, b = 0.17 m, r = 0.05 m."""
    inverse = VEHICLES["mecanum"].inverse((0.3, 0.2, 0.5))
    turning = 0.37 * 0.5
    expected = {
        "front_left": 0.3 - 0.2 - turning,
        "front_right": 0.3 + 0.2 + turning,
        "rear_left": 0.3 + 0.2 - turning,
        "rear_right": 0.3 - 0.2 + turning,
    }
    # the file gives π/4 with six decimals
    assert {n: w.speed for n, w in inverse.wheels.items()} == pytest.approx(
        {n: v / 0.05 for n, v in expected.items()}, abs=1e-4
    )


def test_what_a_differential_drive_cannot_do_is_told() -> None:
    inverse = VEHICLES["devastator"].inverse((0.2, 0.1, 1.0))
    assert not inverse.exact
    np.testing.assert_allclose(inverse.possible, [0.2, 0.0, 1.0])
    np.testing.assert_allclose(inverse.impossible, [0.0, 0.1, 0.0])
    assert inverse.residual == pytest.approx(0.1)  # all wheels would slide by 0.1 m/s
    assert inverse.wheels["right"].speed == pytest.approx((0.2 + 0.093) / 0.0215)


def test_a_car_turns_no_tighter_than_its_steering() -> None:
    """The inner wheel at its limit δ puts the centre at half the track + length / tan δ."""
    inverse = VEHICLES["ackermann"].inverse((0.0, 0.0, 1.0))
    assert inverse.wheels["front_left"].angle == pytest.approx(0.6)
    radius = inverse.possible[0] / inverse.possible[2]
    assert radius == pytest.approx(0.2 + 0.5 / math.tan(0.6))
    assert not inverse.exact


def test_the_nearest_motion_within_limits_is_the_best_of_many() -> None:
    vehicle = VEHICLES["ackermann"]
    wanted = np.array([0.3, 0.1, 1.5])
    inverse = vehicle.inverse(wanted)
    least = 0.2 + 0.5 / math.tan(0.6)
    centre = np.mean([w.position for w in vehicle.wheels], axis=0)

    def lacking(twist: np.ndarray) -> float:
        rest = [velocity_at(w.position, wanted - twist) for w in vehicle.wheels]
        return math.sqrt(float(np.mean(np.sum(np.square(rest), axis=1))))

    assert centre[0] == 0.25
    assert inverse.residual == pytest.approx(lacking(inverse.possible))
    for radius in (least, 1.1 * least, 3.0, -least, 1e6):
        for speed in np.linspace(-1, 1, 41):
            assert lacking(np.array([speed, 0.0, speed / radius])) >= inverse.residual - 1e-12


def test_a_caster_trails_where_it_does_not_slide() -> None:
    vehicle = VEHICLES["differential"]
    straight = vehicle.inverse((1.0, 0.0, 0.0)).wheels["rear"]
    assert straight.angle == pytest.approx(0.0)
    assert straight.speed == pytest.approx(1.0 / 0.02)
    back = vehicle.inverse((-1.0, 0.0, 0.0)).wheels["rear"]
    assert abs(back.angle or 0.0) == pytest.approx(math.pi)  # it swings round and rolls forward
    assert back.speed == pytest.approx(1.0 / 0.02)
    spot = vehicle.inverse((0.0, 0.0, 1.0)).wheels["rear"]
    # axis at 0.2 m ahead moves to the left; its contact moves on a circle of radius √(0.2² − d²)
    assert spot.speed == pytest.approx(math.sqrt(0.2**2 - 0.03**2) / 0.02)
    near = Vehicle(
        (Wheel(at=(0, 0.1, 0), r=0.1), Wheel(kind="caster", at=(0.01, 0, 0), r=0.1, offset=0.03))
    )
    assert near.inverse((0.0, 0.0, 1.0)).wheels["wheel_2"].speed is None  # it never settles


def test_a_skid_steered_robot_turns_less_than_its_wheels_say() -> None:
    """Four fixed wheels at (±a, ±b): least squares gives ψ̇ = b v/(a² + b²)."""
    a, b = 0.15, 0.2
    places = {"fl": (a, b), "fr": (a, -b), "rl": (-a, b), "rr": (-a, -b)}
    robot = Vehicle(tuple(Wheel(name=n, at=(*p, 0.0), r=0.1) for n, p in places.items()))
    forward = robot.forward({"fl": -5.0, "rl": -5.0, "fr": 5.0, "rr": 5.0})
    assert forward.twist == pytest.approx([0.0, 0.0, b * 0.5 / (a**2 + b**2)], abs=1e-12)
    assert not forward.agree
    assert forward.residual > 0.1


def test_disagreeing_wheels_are_a_sign_of_slip() -> None:
    vehicle = VEHICLES["mecanum"]
    speeds = {n: w.speed or 0.0 for n, w in vehicle.inverse((0.3, 0.0, 0.0)).wheels.items()}
    assert vehicle.forward(speeds).agree
    spinning = vehicle.forward(speeds | {"front_left": 8.0})
    assert not spinning.agree
    assert max(spinning.rolling, key=lambda n: abs(spinning.rolling[n])) in speeds


def test_questions_without_an_answer_are_refused() -> None:
    vehicle = VEHICLES["devastator"]
    with pytest.raises(UsageError, match="no wheel 'front'"):
        vehicle.forward({"front": 1.0})
    with pytest.raises(UsageError, match="leave the motion open"):
        vehicle.forward({"left": 1.0})
    with pytest.raises(UsageError, match="finite"):
        vehicle.forward({"left": math.nan, "right": 1.0})
    with pytest.raises(UsageError, match="three finite numbers"):
        vehicle.inverse((1.0, 2.0))
    with pytest.raises(UsageError, match="is of no use without its angle"):
        VEHICLES["differential"].forward({"left": 1.0, "right": 1.0, "rear": 1.0})


def test_limits_of_motion_are_those_of_the_slowest_wheel() -> None:
    limits = VEHICLES["devastator"].limits()
    assert limits["vx"] == pytest.approx(0.43)
    assert limits["vy"] == 0.0
    assert limits["wz"] == pytest.approx(0.43 / 0.093)
    assert Vehicle((Wheel(at=(0, 0, 0), r=0.1),)).limits()["vx"] is None
