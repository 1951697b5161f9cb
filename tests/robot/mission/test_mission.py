"""The closed loop: published missions, laws of guidance and control, endings, clocks, the log."""

import math
import time

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mission_cases import AROUND, Robot, goal

from sysid.robot.mission.contracts import (
    Body,
    Command,
    ControlInputs,
    GuidanceInputs,
    Pose,
    References,
)
from sysid.robot.mission.control.pi_p import SpeedPIYawP
from sysid.robot.mission.guidance.field import (
    InitialTurn,
    PotentialField,
)
from sysid.robot.mission.loop import COLUMNS, command_module
from sysid.robot.mission.result import Outcome
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, Obstacle
from sysid.runners import floats
from sysid.vehicle.kinematics import Geometry, wrap_angle

law = settings(max_examples=100, deadline=None, derandomize=True)

GAINS = PotentialField()

LIMITS = SpeedPIYawP()


def straight(theta: float) -> Mission:
    return goal(5, 0, guidance={"Kg": 0.3, "h": 1, "theta": theta})


# Published missions -------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("mission", "seconds", "end"),
    [
        (goal(1, 0), 5.3, (0.91, 0.034)),
        (AROUND, 33.4, (5.91, 2.96)),
        (straight(1), 20.8, None),
        (straight(2), 19.3, None),
    ],
    ids=["1 m", "obstacles", "5 m, theta 1", "5 m, theta 2"],
)
def test_reference_missions(
    mission: Mission, seconds: float, end: tuple[float, float] | None
) -> None:
    """Figures of an independent simulation of the same loop; the thesis gives 4.9, 34.1, 21.5 and
    19.6 s for its own plant. One control period is 2 % of the shortest mission."""
    result = simulate(mission, Robot())
    assert result.outcome is Outcome.ARRIVED
    assert result.time_s == pytest.approx(seconds, rel=0.03)
    if end is not None:
        assert result.final[:2] == pytest.approx(end, abs=0.02)


def test_unequal_tracks_drift_left_by_centimetres() -> None:
    result = simulate(goal(1, 0), Robot())
    assert result.max_deviation_m == pytest.approx(0.046, abs=0.003)
    assert result.log["y"].min() > -1e-3
    equal = simulate(goal(1, 0), Robot(difference=0.0))
    assert equal.max_deviation_m < 1e-12


def test_obstacles_are_passed_at_a_distance() -> None:
    result = simulate(AROUND, Robot())
    assert result.min_clearance_m == pytest.approx(0.18, abs=0.02)


def test_theta_trades_time_for_arrival_speed() -> None:
    slow, fast = simulate(straight(1), Robot()), simulate(straight(2), Robot())
    assert fast.time_s < slow.time_s
    assert fast.log["v"][-1] > slow.log["v"][-1]
    # The thesis's plant overshoots at θ = 3; one with a lag of 0.2 s does not.
    assert simulate(straight(3), Robot()).log["x"].max() < 5.0


@pytest.mark.parametrize("x", [1, -1])
@pytest.mark.parametrize("y", [1, -1])
def test_goals_in_the_four_sectors_are_reached(x: int, y: int) -> None:
    result = simulate(goal(x, y), Robot())
    psi = np.unwrap(result.log["psi"])
    assert result.outcome is Outcome.ARRIVED
    # The goal's side is the way to turn, through less than half a turn; 0.03 rad for the start.
    turned = psi * y
    assert turned.min() > -0.03
    assert turned.max() < math.pi
    if x < 0:  # on the spot until the heading lies in the goal's sector
        turning = turned < 0.5 * math.pi
        assert np.all(result.log["v_ref"][turning] == 0)
        assert np.hypot(result.log["x"], result.log["y"])[turning].max() < 0.05


def test_a_goal_exactly_behind_is_reached_by_turning_left() -> None:
    result = simulate(goal(-1, 0), Robot(difference=0.0))
    assert result.outcome is Outcome.ARRIVED
    assert np.unwrap(result.log["psi"]).min() >= 0


@pytest.mark.parametrize("psi", [-3.0, -1.0, 0.7, math.pi])
@pytest.mark.parametrize("bearing", [0.3, 2.0, -2.5])
def test_a_mission_does_not_depend_on_where_and_which_way_it_starts(
    psi: float, bearing: float
) -> None:
    plain = simulate(goal(2 * math.cos(bearing), 2 * math.sin(bearing)), Robot())
    x, y = 3 + 2 * math.cos(psi + bearing), -1 + 2 * math.sin(psi + bearing)
    moved = simulate(goal(x, y, start=[3, -1, psi]), Robot())
    assert moved.time_s == plain.time_s
    c, s = math.cos(psi), math.sin(psi)
    px, py, ppsi = plain.final
    # Rounding only: some hundred steps of a stable loop.
    assert moved.final[:2] == pytest.approx((3 + c * px - s * py, -1 + s * px + c * py), abs=1e-9)
    assert abs(wrap_angle(moved.final[2] - ppsi - psi)) < 1e-9


def test_equal_runs_are_equal_to_the_last_bit() -> None:
    one, two = simulate(AROUND, Robot()), simulate(AROUND, Robot())
    assert one.summary() == two.summary()
    assert all(one.log[c].tobytes() == two.log[c].tobytes() for c in COLUMNS)


def test_a_mission_is_simulated_hundreds_of_times_faster_than_driven() -> None:
    def seconds() -> float:
        start = time.perf_counter()
        simulate(AROUND, Robot())
        return time.perf_counter() - start

    assert min(seconds() for _ in range(3)) < 0.15  # measured 0.01 s for a mission of 33 s


# Guidance -----------------------------------------------------------------------------------------
@law
@given(st.floats(-10, 10), st.floats(-10, 10))
def test_forces_are_minus_the_gradient_of_their_potentials(x: float, y: float) -> None:
    obstacle, h = Obstacle(x=0.5, y=0.2), 1e-6

    def potential(x: float, y: float) -> float:
        """U_att of (4.19) about the origin, continuous at d, and U_rep of (4.21)."""
        rho_goal, rho = math.hypot(x, y), math.hypot(x - obstacle.x, y - obstacle.y)
        inside = rho_goal <= GAINS.d
        attraction = 0.5 * rho_goal**2 if inside else GAINS.d * (rho_goal - 0.5 * GAINS.d)
        near = max(1 / rho - 1 / GAINS.rho0, 0.0)
        return GAINS.K * attraction + 0.5 * GAINS.eta * near**2

    assume(math.hypot(x - obstacle.x, y - obstacle.y) > 0.1)  # finite differences need room
    force = GAINS.force(x, y, (0.0, 0.0), (obstacle,))
    slope_x = (potential(x + h, y) - potential(x - h, y)) / (2 * h)
    slope_y = (potential(x, y + h) - potential(x, y - h)) / (2 * h)
    # Third derivative η/ρ⁵ ≈ 5e3 times h² and rounding 1e-16/h, with a margin for kinks at d, ρ₀.
    assert force == pytest.approx((-slope_x, -slope_y), abs=1e-5)


@law
@given(st.floats(0.5, 5), st.floats(0.1, 2), st.floats(-math.pi, math.pi))
def test_the_field_is_continuous_at_d_and_at_rho0(d: float, rho0: float, angle: float) -> None:
    spec = PotentialField(d=d, rho0=rho0)
    c, s = math.cos(angle), math.sin(angle)
    inside, outside = (
        spec.attraction(d * k * c, d * k * s, (0.0, 0.0)) for k in (1 - 1e-9, 1 + 1e-9)
    )
    assert inside == pytest.approx(outside, abs=1e-8)
    assert math.hypot(*outside) == pytest.approx(spec.K * d)
    near = rho0 * (1 - 1e-9)
    at_edge = spec.repulsion(near * c, near * s, Obstacle(x=0, y=0))
    # The slope there is η/ρ₀⁴ ≤ 500 per metre, over 1e-9·ρ₀.
    assert math.hypot(*at_edge) < 1e-6
    assert spec.repulsion(rho0 * 1.001 * c, rho0 * 1.001 * s, Obstacle(x=0, y=0)) == (0, 0)


def test_repulsion_points_away_and_survives_the_obstacles_very_point() -> None:
    fx, fy = GAINS.repulsion(0.3, 0.0, Obstacle(x=0.0, y=0.0))
    assert fx == pytest.approx(0.05 * (1 / 0.3 - 1 / 0.7) / 0.09)
    assert fy == 0.0
    assert all(map(math.isfinite, GAINS.repulsion(0.0, 0.0, Obstacle(x=0.0, y=0.0))))


def test_speed_reference_has_the_published_values() -> None:
    """At 20 cm from the goal the speed is half of its maximum (thesis 6.2.5)."""
    assert GAINS.speed(0.8, 0.0, (1.0, 0.0), ()) == pytest.approx(0.15)
    near, far = Obstacle(x=0.8, y=0.5), Obstacle(x=0.8, y=-0.71)
    with_both = GAINS.speed(0.8, 0.0, (1.0, 0.0), (near, far))
    assert with_both == pytest.approx(0.3 * 2 / (2 + 0.4 / 0.2 + 1 / 0.5))  # only one in range
    assert GAINS.speed(1.0, 0.0, (1.0, 0.0), ()) < 1e-5
    assert GAINS.speed(-1e6, 0.0, (1.0, 0.0), ()) == pytest.approx(0.3)


@law
@given(st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi))
def test_the_initial_turn_goes_to_the_goals_side_and_ends_facing_it(
    psi: float, bearing: float
) -> None:
    assume(abs(abs(bearing) - 0.5 * math.pi) > 1e-9)
    assume(abs(bearing) < math.pi - 1e-9)
    start = Pose(0.4, -0.3, wrap_angle(psi))
    target = (0.4 + math.cos(psi + bearing), -0.3 + math.sin(psi + bearing))
    turn = InitialTurn.plan(start, target)
    if abs(bearing) < 0.5 * math.pi:
        assert turn.sense == 0
        return
    assert turn.sense == math.copysign(1, bearing)
    assert turn.remaining(psi) == pytest.approx(0.5 * math.pi)
    for part in (0.0, 0.3, 0.999):
        heading = wrap_angle(psi + turn.sense * part * 0.5 * math.pi)
        assert turn.after(heading) == turn
        # The shortest way to the reference is the way of the turn.
        assert turn.sense * wrap_angle(turn.reference - heading) > 0
    assert turn.after(wrap_angle(psi + turn.sense * 0.501 * math.pi)).sense == 0


def test_guidance_reports_arrival_within_the_tolerance_only() -> None:
    scene, turn = goal(1, 0).scene(), InitialTurn()

    def references(x: float) -> References:
        inputs = GuidanceInputs(0.0, Body(Pose(x, 0.0, 0.0), 0.0, 0.0), scene)
        return GAINS.step(turn, inputs, 0.1, floats)[1]

    assert references(0.9).arrived
    assert not references(0.899).arrived
    assert references(0.0).psi == 0.0
    assert scene.to_goal(Pose(0.0, 0.0, 0.0), floats) == 1.0


# Control ------------------------------------------------------------------------------------------
def test_the_pi_is_proportional_plus_sum_inside_its_limits() -> None:
    integral, error = 0.0, 0.1
    for n in range(1, 6):
        command, integral = LIMITS.speed_command(error, integral, 0.1)
        assert command == pytest.approx(2.0 * error + 1.85 * error * 0.1 * n)


@pytest.mark.parametrize(("error", "limit"), [(1.0, 1.0), (-1.0, 0.0)])
def test_the_integral_does_not_wind_up(error: float, limit: float) -> None:
    integral = 0.5
    for _ in range(100):
        command, integral = LIMITS.speed_command(error, integral, 0.1)
        assert command == limit
    assert integral == 0.5
    # It unwinds at once when the error changes sign, even while the command is on the limit.
    _, unwound = LIMITS.speed_command(-0.01 * error, 3.0 * error, 0.1)
    assert abs(unwound) < 3.0


def test_the_speed_loop_has_no_steady_error() -> None:
    """Speed step 0.25 m/s of thesis figures 6.12–6.14, straight ahead."""
    robot, state, v = Robot(difference=0.0), np.zeros(2), 0.0
    scene, wanted = goal(9, 0).scene(), References(0.25, 0.0, False)
    integral = LIMITS.start(scene, floats)
    for _ in range(300):
        inputs = ControlInputs(0.0, wanted, Body(scene.start, v, 0.0), scene)
        integral, command = LIMITS.step(integral, inputs, 0.1, floats)
        state, y = robot.step(state, np.array(command_module(command, floats)))
        v = Geometry().r * float(y.mean())
    assert v == pytest.approx(0.25, abs=1e-4)  # 30 s; the slow pole's time constant is 2.3 s


@pytest.mark.parametrize(
    ("psi_ref", "psi", "command"),
    [
        (0.5, 0.0, 0.2),
        (0.0, 0.5, -0.2),
        (3.0, -3.0, 0.4 * (6.0 - 2 * math.pi)),  # the short way, over π
        (-3.0, 3.0, 0.4 * (2 * math.pi - 6.0)),
        (2.0, 0.0, 0.3),
        (-2.0, 0.0, -0.3),
    ],
)
def test_the_yaw_command_takes_the_short_way_and_saturates(
    psi_ref: float, psi: float, command: float
) -> None:
    assert LIMITS.yaw_command(psi_ref, psi) == pytest.approx(command)


@pytest.mark.parametrize(
    ("v_cmd", "psi_cmd", "left", "right"),
    [(0.5, 0.0, 10000, 10000), (0.5, 0.2, 6000, 14000), (0.0, -0.3, 6000, -6000),
     (1.0, 0.3, 14000, 20000), (-1.0, 0.3, -20000, -14000)],
)  # fmt: skip
def test_the_command_module(v_cmd: float, psi_cmd: float, left: float, right: float) -> None:
    assert command_module(Command(v_cmd, psi_cmd), floats) == pytest.approx((left, right))
