"""Degrees, centre and constraints: the five classical types, the thesis's matrices, invariances."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sysid
from sysid.errors import ModelError
from sysid.vehicle.kinematics import Geometry, body_velocity
from sysid.vehicle.wheels.constraints import Scale
from sysid.vehicle.wheels.mobility import IcrKind, _line, degrees, icr
from sysid.vehicle.wheels.summary import notes, type_words
from sysid.vehicle.wheels.vehicle import Vehicle
from sysid.vehicle.wheels.wheel import Wheel

EXAMPLES = Path(__file__).resolve().parents[3] / "datasets" / "vehicles"
law = settings(max_examples=40, deadline=None, derandomize=True)
EXACT = 1e-9  # sums of a few products of numbers of order one, divided once


def fixed(x: float, y: float, heading: float = 0.0, **more: object) -> Wheel:
    return Wheel(at=(x, y, 0.0), r=0.05, heading=heading, **more)


def steered(x: float, y: float, angle: float = 0.0) -> Wheel:
    return Wheel(kind="steerable", at=(x, y, 0.0), r=0.05, angle=angle)


def caster(x: float, y: float) -> Wheel:
    return Wheel(kind="caster", at=(x, y, 0.0), r=0.05, offset=0.03)


TYPES: dict[str, tuple[int, int]] = {  # Campion, Bastin and D'Andréa-Novel 1996
    "omni": (3, 0),
    "mecanum": (3, 0),
    "differential": (2, 0),
    "devastator": (2, 0),
    "omni_steer": (2, 1),
    "tricycle": (1, 1),
    "ackermann": (1, 1),
    "two_steer": (1, 2),
}


@pytest.mark.parametrize("name", TYPES)
def test_the_classical_types(name: str) -> None:
    vehicle = sysid.load_vehicle(EXAMPLES / f"{name}.yaml")
    mobility, steerability = TYPES[name]
    result = vehicle.mobility, vehicle.steerability, vehicle.manoeuvrability
    assert result == (mobility, steerability, mobility + steerability)


def test_every_example_is_checked() -> None:
    assert {p.stem for p in EXAMPLES.glob("*.yaml")} == TYPES.keys()


def test_a_tracked_robot_has_the_matrices_of_the_thesis() -> None:
    """(2.22), and (2.13) from (2.17) and (2.19)."""
    vehicle = sysid.load_vehicle(EXAMPLES / "devastator.yaml")
    constraints = vehicle.constraints()
    np.testing.assert_allclose(constraints.C1, [[0, 1, 0], [0, 1, 0]], atol=EXACT)
    assert constraints.rank == 1
    geometry = Geometry()
    twist = vehicle.forward({"left": 7.0, "right": 11.0}).twist
    forward, yaw_rate = body_velocity(7.0, 11.0, geometry)
    np.testing.assert_allclose(twist, [forward, 0.0, yaw_rate], atol=EXACT)


def test_tracks_turn_about_their_effective_width(tmp_path: Path) -> None:
    file = tmp_path / "wide.yaml"
    file.write_text("effective_width: 0.372\n")
    twist = sysid.load_vehicle(file).forward({"left": -10.0, "right": 10.0}).twist
    assert twist[2] == pytest.approx(2 * 0.0215 * 10 / 0.372)  # half of what B alone gives


def test_a_tricycle_turns_where_its_axles_meet() -> None:
    vehicle = sysid.load_vehicle(EXAMPLES / "tricycle.yaml")
    centre = vehicle.icr()
    assert centre.kind is IcrKind.POINT
    assert centre.point == pytest.approx((0.0, 0.5 / math.tan(0.4)), abs=EXACT)
    straight = vehicle.icr({"front": 0.0})
    assert straight.kind is IcrKind.INFINITY
    assert straight.direction == pytest.approx((1.0, 0.0), abs=EXACT)


@pytest.mark.parametrize("rest", [1e-17, 0.0, -1e-17])
def test_a_common_axle_has_one_direction_whatever_rounding_leaves(rest: float) -> None:
    point, direction = _line(np.array([[1.0, rest, 0.2]]), Scale(0.0, 0.0, 0.2))
    assert direction == pytest.approx((1.0, 0.0), abs=EXACT)
    assert point == pytest.approx((0.0, -0.2), abs=EXACT)


def test_a_car_turns_where_its_file_says() -> None:
    vehicle = sysid.load_vehicle(EXAMPLES / "ackermann.yaml")
    # angles in the file have six decimals: 1e-6 of a turn about a centre 2 m away, divided by
    # the sine 0.27 of the angle between the axles
    assert vehicle.icr().point == pytest.approx((0.0, 2.0), abs=5e-5)


def test_angles_that_do_not_fit_leave_no_centre_and_are_named() -> None:
    vehicle = sysid.load_vehicle(EXAMPLES / "ackermann.yaml")
    crooked = {"front_left": 0.3, "front_right": 0.3}
    assert vehicle.icr(crooked).kind is IcrKind.NONE
    assert vehicle.constraints(crooked).rank == 3
    off = vehicle.misalignment(crooked)
    assert off["front_left"] > 0 > off["front_right"]  # the inner wheel has to turn farther
    assert (vehicle.mobility, vehicle.steerability) == (1, 1)  # the car is one all the same
    assert "do not meet" in notes(vehicle, crooked)[0]


def test_a_differential_drive_may_turn_about_any_point_of_its_axle() -> None:
    vehicle = Vehicle((fixed(0.2, 0.3), fixed(0.2, -0.1)))
    icr = vehicle.icr()
    assert icr.kind is IcrKind.LINE
    assert icr.point == pytest.approx((0.2, 0.1), abs=EXACT)
    assert icr.direction == pytest.approx((0.0, 1.0), abs=EXACT)
    turning = vehicle.icr(speeds={"wheel_1": 1.0, "wheel_2": 3.0})
    assert turning.point == pytest.approx((0.2, 0.5), abs=EXACT)  # 0.1 + 0.2 (3 + 1)/(3 − 1)
    assert vehicle.icr(speeds={"wheel_1": 2.0, "wheel_2": 2.0}).kind is IcrKind.INFINITY
    assert vehicle.icr(speeds={"wheel_1": 0.0, "wheel_2": 0.0}).kind is IcrKind.STANDSTILL


@pytest.mark.parametrize(
    ("wheels", "expected", "words"),
    [
        ((fixed(0, 0), fixed(1, 0, 1.0), fixed(0, 1, 2.0)), (0, 0), "cannot move"),
        ((fixed(0, 0), fixed(1, 0, 1.0)), (1, 0), "one point only"),
        ((fixed(0.1, 0.1), fixed(-0.1, 0.1)), (1, 0), "straight only"),
        ((fixed(0, 0), fixed(1, 0, 1.0), steered(2, 2)), (1, 0), "one point only"),
        ((steered(0, 0), steered(0, 0, 1.0)), (2, 1), "one steered wheel"),
        ((fixed(0, 0),), (2, 0), "differential"),
        ((caster(0, 0), caster(1, 0)), (3, 0), "any direction"),
        ((steered(0, 1), steered(0, -1), steered(1, 0), caster(2, 0)), (1, 2), "two steered"),
        # three fixed axles through one point: a body on a turntable
        (
            (fixed(1, 0, math.pi / 2), fixed(0, 1, math.pi), fixed(-1, 0, -math.pi / 2)),
            (1, 0),
            "one",
        ),
    ],
)
def test_other_vehicles(wheels: tuple[Wheel, ...], expected: tuple[int, int], words: str) -> None:
    vehicle = Vehicle(wheels)
    assert (vehicle.mobility, vehicle.steerability) == expected
    assert words in type_words(vehicle)


def test_what_a_reader_would_not_expect_is_said() -> None:
    double = Vehicle((fixed(0, 0.1), fixed(0, 0.1)))
    assert "act as one wheel" in notes(double)[0]
    idle = Vehicle((fixed(0, 0.1), fixed(0, -0.1), steered(0, 0)))
    assert "steering it turns nothing" in notes(idle)[0]
    loose = Vehicle((caster(0, 0.1), caster(0, -0.1)))
    assert "neither determine the motion" in notes(loose)[0]


def test_no_wheel_and_one_name_twice_are_refused() -> None:
    with pytest.raises(ModelError, match="has no wheel"):
        Vehicle(())
    with pytest.raises(ModelError, match="'a'"):
        Vehicle((fixed(0, 1, name="a"), fixed(0, 2, name="a")))


place = st.floats(-2.0, 2.0).map(lambda v: round(v, 2))
turn = st.floats(-3.0, 3.0).map(lambda v: round(v, 1))


@st.composite
def some_wheel(draw: st.DrawFn) -> Wheel:
    """A wheel of any kind; places and angles are coarse, as those of vehicles are."""
    kind = draw(st.sampled_from(["fixed", "fixed", "steerable", "caster", "swedish"]))
    more = {"caster": {"offset": 0.05}, "swedish": {"roller": 0.7}}.get(kind, {})
    at = (draw(place), draw(place), 0.0)
    return Wheel(kind=kind, at=at, r=0.1, heading=draw(turn), **more)


def moved(wheel: Wheel, angle: float, x: float, y: float, size: float) -> Wheel:
    """The wheel of a vehicle that is enlarged, turned and shifted as a whole."""
    c, s = math.cos(angle), math.sin(angle)
    px, py = wheel.position
    at = (size * (c * px - s * py) + x, size * (s * px + c * py) + y, 0.0)
    heading = math.remainder(wheel.heading + angle, 2 * math.pi)
    changed = {"at": at, "heading": heading, "r": size * wheel.r, "offset": size * wheel.offset}
    return wheel.model_copy(update=changed)


@law
@given(
    st.lists(some_wheel(), min_size=1, max_size=5),
    st.floats(-3, 3),
    st.floats(-50, 50),
    st.floats(-50, 50),
    st.sampled_from([0.01, 1.0, 30.0]),
    st.randoms(use_true_random=False),
)
def test_degrees_and_centre_do_not_depend_on_where_it_is_drawn(
    wheels: Sequence[Wheel], angle: float, x: float, y: float, size: float, shuffle: object
) -> None:
    other = [moved(w, angle, x, y, size) for w in wheels]
    shuffle.shuffle(other)  # type: ignore[attr-defined]
    assert degrees(other) == degrees(wheels)
    before, after = icr(wheels), icr(other)
    assert after.kind == before.kind
    if before.kind is IcrKind.POINT:
        assert before.point is not None
        assert after.point is not None
        c, s = math.cos(angle), math.sin(angle)
        px, py = before.point
        there = (size * (c * px - s * py) + x, size * (s * px + c * py) + y)
        # axles that differ by as little as the tolerance of ranks enlarge rounding a thousandfold
        assert after.point == pytest.approx(there, abs=1e-6 * (1 + size * math.hypot(px, py)))
