"""Planar dynamics against closed forms, energy, symmetry, and the limits that it must meet."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from sysid.runners import floats
from sysid.runners.compiled import jax_module
from sysid.vehicle.dynamics import Scheme, VehicleState, step, substeps_for
from sysid.vehicle.floor import Circle, Floor, HalfPlane, Patch, Polygon
from sysid.vehicle.kinematics import step_pose
from sysid.vehicle.motors import Bench, Motor, friction_limits, lumped_motor
from sysid.vehicle.slip import balanced_velocity, slip_ratio, slipping_velocity, turning_share
from sysid.vehicle.soil import Soil
from sysid.vehicle.tracked import G, TrackedVehicle

CAR = TrackedVehicle()
MOTOR = Bench().motor(7.5)
STIFF = Soil(cohesion=0.0, friction_angle=math.atan(0.8), shear_modulus=1e-9, lateral=0.9)
SAND = Soil(cohesion=1000.0, friction_angle=0.5, shear_modulus=0.0175, lateral=0.53)
R, B = CAR.geometry.r, CAR.geometry.B


def driven(drives, floor=Floor(STIFF), motor=MOTOR, car=CAR, state=VehicleState(), **finer):  # noqa: B008
    """States after each tenth of a second."""
    scheme, result = Scheme(**finer), []
    for drive in drives:
        state = step(state, drive, 0.1, car, (motor, motor), floor, floats, scheme)
        result.append(state)
    return result


def speeds(state: VehicleState) -> tuple[float, ...]:
    return (state.vx, state.vy, state.yaw_rate, *state.omega)


def rolling(speed: float) -> VehicleState:
    return VehicleState(vx=speed, omega=(speed / R, speed / R))


def test_a_straight_run_comes_to_the_speed_at_which_torque_and_resistance_balance() -> None:
    last = driven([(1.0, 1.0)] * 40)[-1]
    resisted = R * STIFF.rolling * CAR.weight / 2.0
    expected = (MOTOR.torque - MOTOR.friction - resisted) / MOTOR.damping
    assert last.omega[0] == pytest.approx(expected, rel=1e-9)
    assert last.vx == pytest.approx(R * expected, rel=1e-6)  # a stiff ground yields a little
    assert (last.vy, last.yaw_rate, last.y) == (0.0, 0.0, 0.0)


def test_a_turn_on_the_spot_meets_the_turning_moment_of_the_resistance_model() -> None:
    """Wong's μWL/4 asks T = R + μWL/(4B) of each track."""
    last = driven([(-1.0, 1.0)] * 60)[-1]
    thrust = 0.5 * STIFF.rolling * CAR.weight + STIFF.lateral * CAR.weight * 0.14 / 4.0 / B
    expected = (MOTOR.torque - MOTOR.friction - R * thrust) / MOTOR.damping
    assert last.omega[1] == pytest.approx(expected, rel=1e-6)
    assert last.yaw_rate == pytest.approx(2.0 * R * expected / B, rel=1e-6)
    assert last.forces.turning == pytest.approx(STIFF.lateral * CAR.weight * 0.14 / 4.0, rel=1e-9)
    assert (last.x, last.y, last.vx) == (0.0, 0.0, 0.0)


def test_coasting_down_takes_the_time_and_the_way_of_coulombs_law_and_ends_at_rest() -> None:
    """v₀²/2a and v₀/a with a = μg m/(m + 2J/r²): no torque, no damping, rotors turn along."""
    free = Motor(torque=0.1, damping=0.0, inertia=1e-3, friction=0.0)
    along = CAR.mass + 2.0 * free.inertia / R**2
    slows = STIFF.rolling * CAR.weight / along
    way = driven([(0.0, 0.0)] * 60, motor=free, state=rolling(0.4), substeps=40)
    last, stopped = way[-1], 0.4 / slows
    assert last.x == pytest.approx(0.4**2 / 2.0 / slows, rel=1e-2)  # of first order in 2.5 ms
    moving = sum(s.vx != 0.0 for s in way)
    assert abs(moving - stopped / 0.1) <= 1.0
    assert speeds(last) == (0.0,) * 5


@pytest.mark.parametrize("soil", [STIFF, SAND])
@pytest.mark.parametrize("drive", [(1.0, 1.0), (-0.6, 0.6), (0.1, 0.9)])
def test_without_a_command_it_stands_exactly_after_a_finite_time(soil: Soil, drive) -> None:
    way = driven([drive] * 10 + [(0.0, 0.0)] * 30, Floor(soil))
    assert max(map(abs, speeds(way[9]))) > 0.1
    assert speeds(way[-1]) == (0.0,) * 5
    assert way[-1][:3] == way[-5][:3]  # and stays where it is, to the last bit


@pytest.mark.parametrize("slope", [(0.02, 0.0), (0.0, 0.3), (0.02, 0.1), (-0.015, -0.5)])
@pytest.mark.parametrize("soil", [STIFF, SAND])
def test_on_a_slope_below_its_friction_it_does_not_move_at_all(slope, soil: Soil) -> None:
    way = driven([(0.0, 0.0)] * 20, Floor(soil, slope=slope))
    assert all(s[:3] == (0.0, 0.0, 0.0) and speeds(s) == (0.0,) * 5 for s in way)


def test_beyond_its_friction_it_slides_down_as_a_block_does() -> None:
    slope = 1.0
    last = driven([(0.0, 0.0)] * 10, Floor(STIFF, slope=(0.0, slope)))[-1]
    expected = G / math.sqrt(2.0) * (slope - STIFF.lateral)  # sideways: lateral friction alone
    assert last.vy == pytest.approx(-expected, rel=1e-9)
    assert (last.vx, last.yaw_rate, last.psi) == (0.0, 0.0, 0.0)


def test_up_a_slope_its_motors_carry_its_weight() -> None:
    last = driven([(1.0, 1.0)] * 40, Floor(STIFF, slope=(0.1, 0.0)))[-1]
    pull = CAR.weight / math.sqrt(1.01) * (0.1 + STIFF.rolling) / 2.0
    expected = (MOTOR.torque - MOTOR.friction - R * pull) / MOTOR.damping
    assert last.omega[0] == pytest.approx(expected, rel=1e-9)


def test_more_drive_than_a_slippery_floor_bears_spins_the_tracks() -> None:
    ice = Soil(cohesion=0.0, friction_angle=math.atan(0.05), shear_modulus=1e-3, rolling=0.01)
    last = driven([(1.0, 1.0)] * 8, Floor(ice))[-1]
    assert last.vx < 0.8 * R * last.omega[0]
    # slip is large: its thrust is all the ice has, and that is what moves the mass
    assert last.vx == pytest.approx((0.05 - 0.01) * G * 0.8, rel=0.05)


def energies(drives, floor: Floor, h: float) -> tuple[float, float]:
    """Work of the motors, and what is neither motion nor heat of it."""
    state, work, lost = VehicleState(), 0.0, 0.0
    for drive in drives:
        for _ in range(round(0.1 / h)):
            last = state
            state = step(last, drive, h, CAR, (MOTOR, MOTOR), floor, floats, Scheme(1, 30))
            f, half = state.forces, 0.5 * B
            over = state.vx - half * state.yaw_rate, state.vx + half * state.yaw_rate
            for k in range(2):
                w, v = state.omega[k], over[k]
                work += h * MOTOR.torque * drive[k] * w
                lost += h * (MOTOR.damping * w * w + f.motors[k] * w)
                lost += h * (f.thrust[k] * (R * w - v) + f.rolling[k] * v)
            lost += h * (f.side * state.vy + f.turning * state.yaw_rate)
            assert min(f.motors[k] * state.omega[k] for k in (0, 1)) >= 0.0
            assert f.turning * state.yaw_rate + f.side * state.vy >= -1e-12
    motion = 0.5 * CAR.mass * (state.vx**2 + state.vy**2) + 0.5 * CAR.yaw_inertia * (
        state.yaw_rate**2
    )
    motion += 0.5 * MOTOR.inertia * sum(w * w for w in state.omega)
    return work, work - lost - motion


@pytest.mark.parametrize("soil", [STIFF, SAND])
def test_the_work_of_the_motors_is_motion_and_heat_up_to_an_error_that_halves_with_the_step(
    soil: Soil,
) -> None:
    drives = [(1.0, 1.0)] * 3 + [(-0.7, 0.9)] * 4 + [(0.2, 1.0)] * 3
    coarse, fine = (energies(drives, Floor(soil), h) for h in (0.004, 0.002))
    assert coarse[1] > 0.0  # implicit steps lose energy, they never make any
    assert coarse[1] < 0.03 * coarse[0]
    assert fine[1] / coarse[1] == pytest.approx(0.5, abs=0.06)


def test_the_way_converges_with_the_first_order_of_its_parts() -> None:
    drives = [(1.0, 0.7)] * 5 + [(-0.5, 0.9)] * 5
    ends = [np.array(driven(drives, Floor(SAND), substeps=n)[-1][:3]) for n in (10, 20, 40, 320)]
    errors = [float(np.abs(e - ends[-1]).max()) for e in ends[:3]]
    assert errors[1] < 0.01  # 0.2 % of the turns driven here, in parts of 5 ms
    for one, other in pairwise(errors):
        assert 0.4 < other / one < 0.6


@pytest.mark.parametrize("soil", [STIFF, SAND])
def test_a_mirrored_command_drives_the_mirrored_path(soil: Soil) -> None:
    rng = np.random.default_rng(3)
    drives = [tuple(d) for d in rng.uniform(-1.0, 1.0, (6, 2)).tolist() for _ in range(4)]
    one = driven(drives, Floor(soil))
    other = driven([d[::-1] for d in drives], Floor(soil))
    for a, b in zip(one, other, strict=True):
        seen = (a.x, a.y, a.psi, a.vx, a.vy, a.yaw_rate, *a.omega)
        mirrored = (b.x, -b.y, -b.psi, b.vx, -b.vy, -b.yaw_rate, *b.omega[::-1])
        assert seen == pytest.approx(mirrored, abs=1e-13)  # rounding alone


def test_without_slip_it_is_the_kinematic_model() -> None:
    """Grip without end, no lateral friction: tracks roll, and the pose follows their speeds."""
    grips = replace(STIFF, cohesion=1e5, lateral=0.0, rolling=0.0)
    pose, last = (0.0, 0.0, 0.0), VehicleState()
    for drive in [(0.9, 0.9)] * 3 + [(0.3, 0.5)] * 8:
        for _ in range(20):
            now = step(last, drive, 0.005, CAR, (MOTOR, MOTOR), Floor(grips), floats, Scheme(1, 40))
            mean = [0.5 * (a + b) for a, b in zip(last.omega, now.omega, strict=True)]
            v, yaw = 0.5 * R * (mean[0] + mean[1]), R / B * (mean[1] - mean[0])
            pose, last = step_pose(*pose, v, yaw, 0.005, floats), now
    # sideways it is free: only a slow turn keeps it on its tracks
    assert last.psi == pytest.approx(pose[2], abs=1e-4)
    assert last.vx == pytest.approx(0.5 * R * sum(last.omega), abs=1e-5)


@pytest.mark.parametrize("drive", [(1.0, 1.0), (-0.8, 0.8), (0.0, 0.6), (0.5, 0.9), (-0.3, 0.2)])
@pytest.mark.parametrize("soil", [SAND, replace(SAND, cohesion=0.0, friction_angle=0.64)])
def test_a_steady_turn_is_that_of_the_slip_model(soil: Soil, drive) -> None:
    """Slow enough for the centre of turning to stay abreast of the middle (x_ICR = 0)."""
    slow = lumped_motor(stall=0.25, gain=6.0, time_constant=0.1, friction=0.0)
    last = driven([drive] * 60, Floor(soil), slow)[-1]
    v, yaw_rate = balanced_velocity(last.omega, last[:3], CAR, Floor(soil), floats)
    assert last.vx == pytest.approx(v, rel=1e-3, abs=1e-6)
    assert last.yaw_rate == pytest.approx(yaw_rate, rel=1e-3, abs=1e-6)


def test_a_vehicle_whose_ground_cannot_turn_it_goes_straight() -> None:
    sticky = replace(STIFF, lateral=3.0, rolling=0.02)
    assert balanced_velocity((5.0, 10.0), (0.0, 0.0, 0.0), CAR, Floor(sticky), floats)[1] == 0.0
    v, yaw_rate = balanced_velocity((0.0, 0.0), (0.0, 0.0, 0.0), CAR, Floor(STIFF), floats)
    assert (v, yaw_rate) == (0.0, 0.0)


def test_batches_find_the_same_balance() -> None:
    jax = jax_module()
    jnp = jax.numpy
    patch = Patch(Circle(0.0, 0.1, 0.1), replace(SAND, lateral=0.3))
    omega = [(5.0, 9.0), (-4.0, 6.0), (8.0, 8.2), (0.0, 0.0), (-3.0, -1.0)]

    def balance(left, right):
        return balanced_velocity((left, right), (0.0, 0.0, 0.3), CAR, Floor(SAND, (patch,)), jnp)

    many = jax.jit(jax.vmap(balance))(*jnp.array(omega).T)
    for k, (left, right) in enumerate(omega):
        one = balanced_velocity((left, right), (0.0, 0.0, 0.3), CAR, Floor(SAND, (patch,)), floats)
        assert [float(m[k]) for m in many] == pytest.approx(one, abs=1e-12)


def test_slip_ratios_say_what_tracks_lose() -> None:
    assert slip_ratio(0.4, 0.3) == pytest.approx(0.25)
    v, vy, yaw = slipping_velocity((10.0, 20.0), (0.1, 0.2), CAR.geometry)
    assert (v, vy) == (pytest.approx(R / 2.0 * (9.0 + 16.0)), 0.0)
    assert yaw == pytest.approx(R / B * (16.0 - 9.0))
    assert slipping_velocity((10.0, 10.0), (0.0, 0.0), CAR.geometry, 0.1, np)[1] == pytest.approx(
        R * 10.0 * math.tan(0.1)
    )
    shares = [turning_share(w, floats) for w in ((1.0, 1.0), (-1.0, 1.0), (0.0, 1.0), (0.0, 0.0))]
    assert shares == [0.0, 1.0, 1.0, 0.0]


def test_a_track_on_ice_turns_the_vehicle_towards_the_other_one() -> None:
    ice = Soil(cohesion=0.0, friction_angle=math.atan(0.02), shear_modulus=1e-3, rolling=0.0)
    patch = Patch(HalfPlane((0.0, 0.0), (1.0, 0.0)), replace(ice, lateral=0.02))
    last = driven([(0.8, 0.8)] * 10, Floor(replace(STIFF, lateral=0.2), (patch,)))[-1]
    assert last.psi > 0.05  # the left track spins, the right one drives
    assert last.omega[0] > last.omega[1]


@pytest.mark.parametrize(
    "area",
    [
        Circle(1.0, 1.0, 0.5),
        Polygon(((0.5, 0.5), (1.5, 0.5), (1.5, 1.5), (0.5, 1.5))),
        HalfPlane((0.5, 1.0), (0.5, 0.0)),
    ],
)
def test_areas_know_what_lies_in_them(area) -> None:
    assert area.contains(1.0, 1.2, floats) is True
    assert area.contains(0.2, 1.0, floats) is False
    inside = area.contains(np.array([1.0, 0.2]), np.array([1.2, 1.0]), np)
    assert inside.tolist() == [True, False]


def test_a_high_centre_of_mass_loads_the_lower_track() -> None:
    """On a slope across, the loads differ by 2 m g s h/B, and rolling resistance with them."""
    car = replace(CAR, height=0.05)
    last = driven([(1.0, 1.0)] * 30, Floor(STIFF, slope=(0.0, 0.2)), car=car)[-1]
    left, right = last.forces.rolling
    share = 0.2 * 0.05 / B
    assert right / left == pytest.approx((0.5 + share) / (0.5 - share), rel=1e-9)


def test_the_centre_of_mass_ahead_moves_the_centre_of_turning_ahead() -> None:
    car = replace(CAR, centre=0.02)
    last = driven([(-0.5, 0.5)] * 20, Floor(SAND), car=car)[-1]
    turned = driven([(-0.5, 0.5)] * 21, Floor(SAND), car=car)[-1]
    # the middle of the tracks runs on a circle about the centre of mass
    assert math.hypot(last.x - 0.02, last.y) == pytest.approx(0.02, abs=2e-4)
    assert math.hypot(turned.x - last.x, turned.y - last.y) > 1e-3


@pytest.mark.slow
def test_jax_gives_the_same_numbers_and_derivatives_in_every_parameter() -> None:
    jax = jax_module()
    jnp = jax.numpy
    patch = Patch(Circle(0.0, 0.1, 0.1), replace(STIFF, shear_modulus=0.01))  # under the left track
    begin = driven([(0.9, 0.2)] * 2, Floor(SAND))[-1]

    def end(values, xp):
        mass, inertia, rolls, lateral, torque = values
        car = replace(CAR, mass=mass, yaw_inertia=inertia)
        soil = replace(SAND, rolling=rolls, lateral=lateral)
        motors, floor = (MOTOR._replace(torque=torque), MOTOR), Floor(soil, (patch,))
        state = step(begin, (-0.5, 0.8), 0.1, car, motors, floor, xp, Scheme(8, 12))
        return xp.array((state.x, state.y, state.psi, *state.omega))

    values = [1.6, 0.06, 0.05, 0.5, 0.25]
    one = end(values, floats)
    both = jax.jit(lambda v, t: jax.jvp(lambda w: end(w, jnp), (v,), (t,)))
    for k, value in enumerate(values):
        other, slope = both(jnp.array(values), jnp.eye(5)[k])
        np.testing.assert_allclose(np.asarray(other), one, atol=1e-11)
        shift = 1e-5 * value
        ends = [end([*values[:k], value + s, *values[k + 1 :]], floats) for s in (shift, -shift)]
        expected = (ends[0] - ends[1]) / (2.0 * shift)
        np.testing.assert_allclose(np.asarray(slope), expected, rtol=1e-4, atol=1e-6)


def test_no_time_changes_nothing_and_parts_are_short_enough() -> None:
    state = driven([(0.5, 0.9)] * 3)[-1]
    assert step(state, (1.0, 0.0), 0.0, CAR, (MOTOR, MOTOR), Floor(STIFF), floats) == state
    assert [substeps_for(t).substeps for t in (0.1, 0.02, 0.001, 0.0126)] == [20, 4, 1, 3]


def test_the_motor_of_the_bench_and_the_lumped_one_are_one_motor() -> None:
    bench = Bench().motor(6.0)
    gain = bench.torque / bench.damping
    same = lumped_motor(
        bench.torque, gain, bench.inertia / bench.damping, bench.friction / bench.torque
    )
    assert tuple(same) == pytest.approx(tuple(bench), rel=1e-12)
    back, forth = friction_limits(bench._replace(breakaway=1.5, friction_back=2.0), 0.0, floats)
    assert (back, forth) == pytest.approx((3.0 * bench.friction, 1.5 * bench.friction))
