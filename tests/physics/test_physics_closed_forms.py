"""The physics twin against closed forms: steady states, energies, limits, orders."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from sysid_datasets.physics import simulate as simulation
from sysid_datasets.physics.parameters import (
    ONE_QUADRANT,
    Battery,
    Body,
    Bridge,
    Drive,
    Friction,
    Gearbox,
    Load,
    Machine,
    Motor,
    Thermal,
)
from sysid_datasets.physics.robots import on_firm_ground
from sysid_datasets.physics.simulate import Telemetry, simulate, substeps

Array = NDArray[np.float64]
FINE = Telemetry(rate=10000.0)
"""A row a step: energies are integrals over rows."""
KILO = Telemetry(rate=1000.0)

MOTOR = Motor(resistance=2.0, inductance=2e-3, constant=0.01, inertia=1e-6)
VISCOUS = Friction(viscous_forward=1e-3, viscous_backward=1e-3)
DRIVE = Drive(motor=MOTOR, friction=VISCOUS)
TOTAL = 4e-4 + 1e-6 * 30.0**2
"""Inertia at the output [kg m²]."""
VOLTS = 12.0


def held(duty: float, rows: int) -> Array:
    return np.full((rows, 1), duty)


def one(drive: Drive, **parts: object) -> Machine:
    return Machine(drives=(drive,), **parts)  # type: ignore[arg-type]


def test_a_step_is_the_matrix_exponential() -> None:
    run = simulate(one(DRIVE), held(0.5, 300), KILO)
    a = np.array([[-2.0 / 2e-3, -0.01 * 30 / 2e-3], [30 * 0.01 / TOTAL, -1e-3 / TOTAL]])
    b = np.array([0.5 * VOLTS / 2e-3, 0.0])
    exact = np.array([np.linalg.solve(a, (expm(a * t) - np.eye(2)) @ b) for t in run.t])
    # RK4 at 0.1 ms and L/R = 1 ms: the error of a step is (0.1)^5/120
    assert np.abs(run.truth["current"][:, 0] - exact[:, 0]).max() < 1e-5
    assert np.abs(run.truth["speed"][:, 0] - exact[:, 1]).max() < 1e-5


def test_halving_the_step_divides_the_error_by_sixteen(monkeypatch: pytest.MonkeyPatch) -> None:
    a = np.array([[-2.0 / 2e-3, -0.01 * 30 / 2e-3], [30 * 0.01 / TOTAL, -1e-3 / TOTAL]])
    b = np.array([6.0 / 2e-3, 0.0])
    errors = []
    for step in (4e-4, 2e-4, 1e-4):
        monkeypatch.setattr(simulation, "STEP", step)
        monkeypatch.setattr(simulation, "STABLE", 10.0)  # steps as asked, never divided
        run = simulate(one(DRIVE), held(0.5, 11), Telemetry(rate=1.0 / 2e-3))
        exact = np.linalg.solve(a, (expm(a * 0.004) - np.eye(2)) @ b)
        errors.append(abs(run.truth["current"][2, 0] - exact[0]))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert orders == pytest.approx([4.0, 4.0], abs=0.4)


@pytest.mark.parametrize("load", [0.0, -0.2])
def test_current_and_speed_settle_where_volts_and_torques_balance(load: float) -> None:
    drive = replace(DRIVE, load=Load(constant=load))
    run = simulate(one(drive), held(0.7, 3000), KILO)
    speed, current = run.truth["speed"][-1, 0], run.truth["current"][-1, 0]
    assert current == pytest.approx((0.7 * VOLTS - 0.01 * 30 * speed) / 2.0, rel=1e-9)
    assert 0.01 * 30 * current + load == pytest.approx(1e-3 * speed, rel=1e-6)


def test_energy_in_is_energy_kept_and_heat() -> None:
    commands = np.concatenate([held(0.8, 2000), held(-0.3, 2000)])
    drive = replace(
        DRIVE,
        bridge=Bridge(on_resistance=0.2),
        friction=replace(VISCOUS, coulomb_forward=0.03, coulomb_backward=0.03),
    )
    run = simulate(one(drive, battery=Battery(resistance=0.3)), commands, FINE)
    i, w = run.truth["current"][:, 0], run.truth["speed"][:, 0]
    bus, duty = run.truth["bus"][:, 0], run.truth["duty"][:, 0]
    taken = np.trapezoid(bus * duty * i, run.t)
    heat = np.trapezoid(2.2 * i**2 + 1e-3 * w**2 + 0.03 * np.abs(w), run.t)
    kept = 0.5 * 2e-3 * i[-1] ** 2 + 0.5 * TOTAL * w[-1] ** 2
    assert heat > 0.1
    # the trapezes of a jump of the duty are wrong by a step's worth of power
    assert taken == pytest.approx(heat + kept, rel=2e-3)


def test_stiff_teeth_without_play_are_a_rigid_gear() -> None:
    rigid = simulate(one(DRIVE), held(0.5, 300), KILO).truth["speed"]
    off = []
    for stiffness in (50.0, 500.0, 5000.0):
        gear = Gearbox(stiffness=stiffness, damping=0.02)
        soft = simulate(one(replace(DRIVE, gearbox=gear)), held(0.5, 300), KILO)
        off.append(float(np.sqrt(np.mean((soft.truth["speed"] - rigid) ** 2))))
    assert off[0] > 3.0 * off[1] > 9.0 * off[2]
    assert off[2] < 0.02


def test_play_is_crossed_before_the_load_moves() -> None:
    gear = Gearbox(stiffness=2000.0, damping=0.2, gap=0.4, load_inertia=4e-4)
    dry = replace(VISCOUS, coulomb_forward=0.02, coulomb_backward=0.02)
    commands = np.concatenate([held(0.4, 500), held(-0.4, 200)])
    run = simulate(one(replace(DRIVE, gearbox=gear, friction=dry)), commands, KILO)
    twist = np.cumsum(run.truth["motor_speed"][:, 0] / 30.0 - run.truth["speed"][:, 0]) * 1e-3
    assert np.ptp(twist) == pytest.approx(0.4, abs=0.02)


def test_forward_and_backward_mirror_each_other() -> None:
    drive = Drive(
        motor=MOTOR,
        bridge=Bridge(ONE_QUADRANT, 0.0, 0.2, 0.6, dead_time=0.02, current_limit=2.0),
        gearbox=Gearbox(gap=0.05, stiffness=20.0, damping=0.01),
        friction=replace(VISCOUS, coulomb_forward=0.02, coulomb_backward=0.02, breakaway=1.5),
        motor_friction=Friction(1e-4, 1e-4),
        thermal=Thermal(1.0, 5.0),
    )
    rng = np.random.default_rng(1)
    commands = np.repeat(rng.uniform(-1.0, 1.0, (20, 1)), 100, axis=0)
    there, back = (simulate(one(drive), s * commands, KILO).truth["speed"] for s in (1.0, -1.0))
    assert np.abs(there).max() > 10.0
    assert np.array_equal(there, -back)


def test_dry_friction_holds_until_the_torque_exceeds_it() -> None:
    dry = replace(VISCOUS, coulomb_forward=0.1, coulomb_backward=0.1, breakaway=1.5)
    # stall torque per duty: 30 * 0.01 * 12 / 2 = 1.8 N m, so 0.15 N m is a duty of 0.083
    for duty, moves in ((0.08, False), (0.087, True)):
        run = simulate(one(replace(DRIVE, friction=dry)), held(duty, 500), KILO)
        assert (run.truth["speed"][-1, 0] > 0.1) == moves


def test_bristles_give_before_they_slide() -> None:
    dry = Friction(0.1, 0.1, presliding=0.02, bristle_damping=0.02)
    ramp = np.linspace(0.0, 0.03, 2000)[:, None]
    run = simulate(one(replace(DRIVE, friction=dry)), ramp, KILO)
    # slowly loaded to x = 0.054/0.1 of the sliding torque: angle = −δ ln(1 − x)
    assert run.truth["angle"][-1, 0] == pytest.approx(-0.02 * np.log(1.0 - 0.54), rel=0.03)
    assert abs(run.truth["speed"][-1, 0]) < 0.02


def test_diodes_let_the_motor_coast_and_a_short_brakes_it() -> None:
    commands = np.concatenate([held(0.8, 500), held(0.0, 200)])
    brake, coast = (
        simulate(one(replace(DRIVE, bridge=b)), commands, KILO).truth
        for b in (Bridge(), Bridge(coast_at_zero=1.0))
    )
    assert brake["speed"][-1, 0] < 0.02 * brake["speed"][500, 0]
    assert np.all(coast["current"][520:] == 0.0)
    fallen = coast["speed"][-1, 0] / coast["speed"][599, 0]
    assert fallen == pytest.approx(np.exp(-0.1 * 1e-3 / TOTAL), rel=1e-6)


def test_one_quadrant_never_brakes() -> None:
    commands = np.concatenate([held(0.9, 500), held(0.3, 300)])
    bridge = Bridge(quadrants=ONE_QUADRANT, diode_drop=0.6)
    truth = simulate(one(replace(DRIVE, bridge=bridge)), commands, KILO).truth
    assert truth["current"].min() >= 0.0
    assert np.all(truth["current"][520:700] == 0.0)
    assert simulate(one(DRIVE), commands, KILO).truth["current"].min() < -1.0


@pytest.mark.parametrize("duty", [0.0, 0.05, 0.15])
@pytest.mark.parametrize("inductance", [2e-4, 3e-4, 5e-4, 2e-3])
def test_a_winding_of_one_quadrant_stays_dry_whatever_its_inductance(
    duty: float, inductance: float
) -> None:
    """A stage of RK4 that passes zero once drew current back, which held the speed."""
    motor = replace(MOTOR, inductance=inductance)
    bridge = Bridge(quadrants=ONE_QUADRANT, diode_drop=0.25)
    commands = np.concatenate([held(0.5, 500), held(duty, 200)])
    truth = simulate(one(replace(DRIVE, motor=motor, bridge=bridge)), commands, KILO).truth
    assert np.all(truth["current"][540:] == 0.0)
    fallen = truth["speed"][-1, 0] / truth["speed"][599, 0]
    assert fallen == pytest.approx(np.exp(-0.1 * 1e-3 / TOTAL), rel=1e-6)


def test_the_chopper_limits_the_torque() -> None:
    bridge = Bridge(current_limit=1.0)
    truth = simulate(one(replace(DRIVE, bridge=bridge)), held(1.0, 100), KILO).truth
    assert truth["current"].max() == 1.0
    rise = truth["speed"][20, 0] - truth["speed"][10, 0]
    assert rise == pytest.approx(0.01 * 30 * 1.0 * 0.01 / TOTAL, rel=0.02)


def test_what_the_motor_takes_the_battery_gives() -> None:
    battery = Battery(full=12.0, slope=3.0, capacity=5.0, resistance=0.5)
    run = simulate(one(DRIVE, battery=battery), held(0.6, 20000), FINE)
    current = 0.6 * run.truth["current"][:, 0]
    taken = np.concatenate([[0.0], np.cumsum(0.5 * (current[1:] + current[:-1]) * 1e-4)])
    expected = 12.0 - 3.0 * taken / 5.0 - 0.5 * current
    assert taken[-1] > 0.1
    assert np.abs(run.truth["bus"][5:, 0] - expected[5:]).max() < 0.02


def test_the_winding_warms_by_its_losses() -> None:
    warm = Thermal(winding_capacity=2.0, winding_to_housing=1e9, copper=0.0, magnets=0.0)
    run = simulate(one(replace(DRIVE, thermal=warm)), held(0.7, 5000), FINE)
    joules = np.trapezoid(2.0 * run.truth["current"][:, 0] ** 2, run.t)
    assert run.truth["winding"][-1, 0] == pytest.approx(joules / 2.0, rel=1e-3)


def test_an_eccentric_gear_keeps_its_energy() -> None:
    """Nothing drives and nothing rubs: a spinning pair of inertias goes on for ever."""
    gear = Gearbox(load_inertia=4e-4, eccentricity=0.2)
    free = Drive(motor=replace(MOTOR, constant=1e-9), gearbox=gear, load=Load(constant=0.05))
    thrown = np.zeros((2000, 1))
    run = simulate(one(free), thrown, KILO)
    w, angle = run.truth["speed"][:, 0], run.truth["angle"][:, 0]
    inertia = 4e-4 + 1e-6 * (30.0 * (1.0 + 0.2 * np.cos(angle))) ** 2
    assert 0.5 * inertia * w**2 == pytest.approx(0.05 * angle, abs=1e-6)


def test_a_body_balanced_in_yaw_does_not_couple_its_tracks() -> None:
    drives = (DRIVE, DRIVE)
    width, mass = 0.2, 2.0 * TOTAL / 0.0215**2
    bodies = [
        Body(
            mass=mass, yaw_inertia=mass * width**2 / 4.0 * k, width=width, length=0.0,
            side_grip=0.8, slip_speed=0.002,
        )
        for k in (1.0, 0.2)
    ]  # fmt: skip
    commands = np.column_stack([np.full(300, 0.3), np.zeros(300)])
    balanced, light = (simulate(Machine(drives, body=b), commands, KILO) for b in bodies)
    assert np.abs(balanced.truth["speed"][:, 1]).max() < 0.05
    assert np.abs(light.truth["speed"][:, 1]).max() > 0.5


def test_grip_holds_on_a_slope_and_the_pose_follows_the_wheels() -> None:
    body = Body(mass=2.0, yaw_inertia=0.02, side_grip=0.5, length=0.0, slip_speed=0.002)
    flat = simulate(Machine((DRIVE, DRIVE), body=body), np.full((1000, 2), 0.4), KILO)
    way = 0.0215 * flat.truth["angle"][-1].mean()
    assert flat.pose[-1, 0] == pytest.approx(way, rel=5e-3)
    steep = replace(body, slope=0.1)
    up = simulate(Machine((DRIVE, DRIVE), body=steep), np.full((1000, 2), 0.4), KILO)
    # each motor carries half of m g sin(slope) at r, which slows it by torque over damping
    torque = 0.0215 * 2.0 * 9.81 * np.sin(0.1) / 2.0
    slower = torque / (0.3**2 / 2.0 + 1e-3)
    lost = flat.truth["speed"][-1, 0] - up.truth["speed"][-1, 0]
    assert lost == pytest.approx(slower, rel=1e-3)


def test_no_drive_makes_a_track_slide_on_firm_ground() -> None:
    """A light body on grip of 0.8 stays where it is while its tracks spin: another cause."""
    width, mass = 0.2, 2.0 * TOTAL / 0.0215**2
    body = Body(
        mass=mass, yaw_inertia=mass * width**2 / 4.0, width=width, length=0.0,
        side_grip=0.8, slip_speed=0.002,
    )  # fmt: skip
    light = Machine((DRIVE, DRIVE), body=replace(body, gravity=1.0))
    commands = np.full((400, 2), 1.0)
    runs = [simulate(m, commands, KILO) for m in (light, on_firm_ground(light))]
    slid, firm = (r.pose[-1, 0] / (0.0215 * r.truth["angle"][-1].mean()) for r in runs)
    assert slid < 0.8
    assert firm == pytest.approx(1.0, abs=0.03)  # it gives below its grip


def test_scrubbing_tracks_turn_less_than_their_wheels_say() -> None:
    body = Body(mass=2.0, yaw_inertia=0.02, side_grip=0.7, length=0.2, slip_speed=0.005, creep=0.1)
    commands = np.column_stack([np.full(1000, -0.5), np.full(1000, 0.5)])
    run = simulate(Machine((DRIVE, DRIVE), body=body), commands, KILO)
    told = 0.0215 * np.ptp(run.truth["angle"][-1]) / body.width
    assert 0.4 * told < run.pose[-1, 2] < 0.95 * told


def test_stiff_parts_divide_the_step() -> None:
    assert substeps(one(DRIVE)) == 1
    gear = Gearbox(stiffness=500.0, load_inertia=1e-7)
    assert substeps(one(replace(DRIVE, gearbox=gear))) > 5
    with pytest.raises(ValueError, match="too fast"):
        substeps(one(replace(DRIVE, motor=replace(MOTOR, inductance=1e-9))))
