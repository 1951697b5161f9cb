"""Making a robot of any plant: wiring, scales, and the sentences that say what was assumed."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from sysid.data.record import Array, Channel
from sysid.effects.ground import Ground
from sysid.errors import ModelError
from sysid.robot.mission.result import Outcome
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.robot.mission.tracks.robot_plant import RobotPlant
from sysid.robot.mission.tracks.settling import settle

MISSION = Mission(goal=(1.0, 0.0))
FULL = 0.43 / 0.0215
"""Wheel speed at full drive [rad/s]."""


@dataclass(frozen=True)
class Lag:
    """y = y₀ + G(u − u₀) behind a first-order lag; ``pole`` outside (−1, 1) is unstable."""

    gain: tuple[tuple[float, ...], ...]
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    pole: float = 0.6
    dt: float = 0.1
    u_zero: tuple[float, ...] | None = None
    y_offset: float = 0.0
    input_range: tuple[tuple[float, float], ...] = ()
    ground: Ground = field(default_factory=Ground)

    @property
    def u_offset(self) -> Array:
        return np.array(self.u_zero or np.zeros(len(self.inputs)))

    def initial_state(self) -> Array:
        return np.zeros(len(self.outputs))

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        drive = (1 - self.pole) * np.array(self.gain) @ (u - self.u_offset)
        return self.pole * state + drive, state + self.y_offset


def names(*words: str, unit: str = "") -> tuple[Channel, ...]:
    return tuple(Channel(w, unit) for w in words)


def at_full(robot: RobotPlant, left: float = 1.0, right: float = 1.0) -> Array:
    return settle(robot, robot.initial_state(), 20000.0 * np.array((left, right))).y


def test_a_robot_passes_through_unchanged() -> None:
    plant = Lag(
        ((9e-4, 1e-5), (0.0, 1.1e-3)), names("pwm_l", "pwm_r", unit="µs"),
        names("omega_l", "omega_r", unit="rad/s"),
    )  # fmt: skip
    robot, warnings = as_robot(plant, MISSION)
    assert warnings == ()
    u, state = np.array((5000.0, -3000.0)), np.array((1.0, 2.0))
    for ours, theirs in zip(robot.step(state, u), plant.step(state, u), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)
    assert simulate(MISSION, robot).outcome is Outcome.ARRIVED


@pytest.mark.parametrize(
    ("inputs", "outputs"),
    [
        (("pwm_r", "pwm_l"), ("omega_r", "omega_l")),
        (("right_pwm", "left_pwm"), ("speedRight", "speedLeft")),
        (("uR", "uL"), ("y_R", "y_L")),
        (("pwm_rechts", "pwm_links"), ("omega_re", "omega_li")),  # as logs are read by
    ],
)
def test_tracks_are_found_by_name_in_any_order(
    inputs: tuple[str, str], outputs: tuple[str, str]
) -> None:
    plant = Lag(((2.0, 0.0), (0.0, 1.0)), names(*inputs, unit="µs"), names(*outputs, unit="rad/s"))
    robot, warnings = as_robot(plant, MISSION)
    assert (robot.driven, robot.read, warnings) == ((1, 0), (1, 0), ())
    np.testing.assert_allclose(at_full(robot, 1.0, 0.5), (20000.0, 20000.0), rtol=1e-3)
    assert [c.name for c in (*robot.inputs, *robot.outputs)] == [
        "pwm_l", "pwm_r", "omega_l", "omega_r",
    ]  # fmt: skip


def test_robot_names_without_pwm_units_are_scaled_not_reordered() -> None:
    plant = Lag(
        ((3.0, 0.0), (0.0, 4.0)), names("left_V", "right_V", unit="V"),
        names("left_rpm", "right_rpm"), input_range=((-6.0, 5.0), (-6.0, 6.0)),
    )  # fmt: skip
    robot, warnings = as_robot(plant, MISSION)
    np.testing.assert_allclose(at_full(robot), FULL, rtol=1e-3)
    assert "left_V [V] from 0 to 6 is taken as zero to full drive." in warnings
    assert "right_rpm changes by 24 at full drive, which is taken as 0.43 m/s." in warnings


def test_one_input_one_output_drives_both_tracks_with_copies() -> None:
    plant = Lag(((11.0,),), names("u"), names("y"), input_range=((-0.9, 0.8),))
    robot, warnings = as_robot(plant, MISSION)
    np.testing.assert_allclose(at_full(robot, 1.0, -0.5), (FULL, -0.5 * FULL), rtol=1e-3)
    assert robot.span[0] == 0.9
    assert warnings[0] == "Each track is driven by its own copy of the plant from u to y."
    assert len(warnings) == 3  # said once, not once a track
    assert simulate(MISSION, robot).outcome is Outcome.ARRIVED


def test_without_a_range_full_drive_is_one() -> None:
    robot, _ = as_robot(Lag(((2.0,),), names("u"), names("y")), MISSION)
    np.testing.assert_array_equal(robot.span, 1.0)


@pytest.mark.parametrize(
    ("low", "high", "u_zero", "centre", "span"),
    [
        (-2.0, 1.0, (0.3,), 0.0, 2.0),  # zero was seen: it is the zero of the drive
        (3.4, 6.4, (5.0,), 5.0, 1.6),  # never seen: the operating point is
        (3.4, 6.4, None, 4.9, 1.5),  # unknown: the middle is
    ],
)
def test_zero_drive_rests_and_full_drive_stays_near_the_data(
    low: float, high: float, u_zero: tuple[float] | None, centre: float, span: float
) -> None:
    plant = Lag(
        ((0.7,),), names("u"), names("y"),
        u_zero=u_zero, y_offset=4.8, input_range=((low, high),),
    )  # fmt: skip
    robot, _ = as_robot(plant, MISSION)
    assert (robot.centre[0], robot.span[0]) == (pytest.approx(centre), pytest.approx(span))
    state = robot.initial_state()
    for _ in range(5):
        state, y = robot.step(state, np.zeros(2))
        np.testing.assert_allclose(y, 0.0, atol=1e-3 * FULL)  # settled to 1e-4 of the change
    np.testing.assert_allclose(at_full(robot), FULL, rtol=1e-3)


def test_more_inputs_and_outputs_use_the_first_two() -> None:
    plant = Lag(
        ((1.0, 0.1, 5.0), (0.2, 2.0, 5.0), (1.0, 1.0, 1.0)),
        names("a", "b", "c"), names("p", "q", "s"), u_zero=(0.0, 0.0, 7.0),
    )  # fmt: skip
    robot, warnings = as_robot(plant, MISSION)
    assert not robot.twins
    assert robot.centre[2] == 7.0
    np.testing.assert_allclose(at_full(robot), FULL, rtol=1e-3)
    assert warnings[:2] == (
        "Input a and output p are taken as the left track, b and q as the right one.",
        "Fixed at the operating point: c.",
    )


def test_crossed_outputs_change_places() -> None:
    plant = Lag(((0.1, 1.0), (1.0, 0.1)), names("a", "b"), names("p", "q"))
    robot, warnings = as_robot(plant, MISSION)
    assert robot.read == (1, 0)
    assert "Input a and output q are taken as the left track" in warnings[0]
    y = at_full(robot, -1.0, 1.0)
    assert y[1] > y[0]


@pytest.mark.parametrize(
    "gain",
    [((1.0, 1.0), (1.0, 1.0)), ((-0.2, 0.24), (0.06, -0.1)), ((0.0, 0.0), (0.0, 1.0))],
    ids=["both alike", "sums cancel", "first input dead"],
)
def test_two_channels_that_do_not_steer_fall_back_to_copies(
    gain: tuple[tuple[float, float], ...],
) -> None:
    plant = Lag(gain, names("a", "b"), names("p", "q"))
    robot, warnings = as_robot(plant, MISSION)
    assert robot.twins
    assert "fixed at the operating point, because" in warnings[0]
    assert simulate(MISSION, robot).outcome is Outcome.ARRIVED


def test_named_tracks_that_do_not_steer_are_kept_with_a_warning() -> None:
    plant = Lag(
        ((5e-4, 5e-4), (5e-4, 5e-4)), names("pwm_l", "pwm_r", unit="µs"),
        names("omega_l", "omega_r", unit="rad/s"),
    )  # fmt: skip
    robot, warnings = as_robot(plant, MISSION)
    assert not robot.twins
    assert "hardly turns" in warnings[-1]


def test_a_falling_output_is_turned_over() -> None:
    robot, warnings = as_robot(Lag(((-3.0,),), names("u"), names("y")), MISSION)
    np.testing.assert_allclose(at_full(robot), FULL, rtol=1e-3)
    assert any("sign was reversed" in w for w in warnings)
    swapped_wires = Lag(
        ((1e-3, 0.0), (0.0, -1e-3)), names("pwm_l", "pwm_r", unit="µs"),
        names("omega_l", "omega_r", unit="rad/s"),
    )  # fmt: skip
    robot, warnings = as_robot(swapped_wires, MISSION)
    np.testing.assert_array_equal(robot.scale, (1.0, -1.0))
    assert warnings == (
        "omega_r [rad/s] falls where the drive rises, so its sign was reversed; check the wiring "
        "or the sign of the data.",
    )


def test_a_robot_never_seen_driving_straight_is_said_to_be_so() -> None:
    turned_on_the_spot = Lag(
        ((5e-4, -5e-4), (-4.9e-4, 4.9e-4)), names("pwm_l", "pwm_r", unit="µs"),
        names("omega_l", "omega_r", unit="rad/s"),
    )  # fmt: skip
    robot, warnings = as_robot(turned_on_the_spot, MISSION)
    np.testing.assert_array_equal(robot.scale, (1.0, 1.0))
    assert len(warnings) == 2
    assert all("log with straight drives" in w for w in warnings)


def test_the_missions_scales_are_taken_as_given() -> None:
    vehicle = {"command_scale": 12.0, "speed_scale": 0.1}
    mission = Mission.model_validate({"goal": (1, 0), "vehicle": vehicle})
    plant = Lag(((15.0,),), names("u"), names("y"), u_zero=(3.0,), y_offset=45.0)
    robot, warnings = as_robot(plant, mission)
    np.testing.assert_allclose(at_full(robot), 18.0, rtol=1e-3)  # 0.1 · 15 · 12
    assert len(warnings) == 1


def test_the_top_speed_can_be_chosen() -> None:
    robot, _ = as_robot(Lag(((2.0,),), names("u"), names("y")), MISSION, top_speed=0.86)
    np.testing.assert_allclose(at_full(robot), 2 * FULL, rtol=1e-3)


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        (Lag(((1.0,),), names("u"), names("y"), pole=1.01), "unstable"),
        (Lag(((1.0,),), names("u"), names("y"), pole=-1.5), "unstable"),
        (Lag(((0.0,),), names("u"), names("y")), "y does not respond to a constant input u"),
        (Lag(((0.0,),), names("u"), names("y"), y_offset=1e5), "does not respond"),
    ],
)
def test_plants_without_a_usable_static_answer_are_refused(plant: Lag, words: str) -> None:
    with pytest.raises(ModelError, match=f"cannot drive a robot: .*{words}"):
        as_robot(plant, MISSION)


@dataclass(frozen=True)
class Integrator(Lag):
    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        return state + 0.1 * u, state


def test_an_integrator_is_refused_because_it_keeps_moving() -> None:
    with pytest.raises(ModelError, match="keeps moving"):
        as_robot(Integrator(((1.0,),), names("u"), names("y")), MISSION)


@dataclass(frozen=True)
class Resonance(Lag):
    """Two states, poles ρ e^{±iα}: rings for thousands of samples about its static value 1."""

    radius: float = 0.999

    def initial_state(self) -> Array:
        return np.zeros(2)

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        a1, a2 = 2 * self.radius * math.cos(0.3), -(self.radius**2)
        y = a1 * state[0] + a2 * state[1] + (1 - a1 - a2) * u[0]
        return np.array((y, state[0])), state[:1]


@pytest.mark.parametrize("radius", [0.9, 0.999, 0.99999])
def test_a_ringing_plant_settles_at_its_static_value(radius: float) -> None:
    plant = Resonance(((1.0,),), names("u"), names("y"), radius=radius)
    rest = settle(plant, plant.initial_state(), np.array((1.0,)))
    assert rest.y[0] == pytest.approx(1.0, rel=0.01)
    # The first overshoot comes half a period, π/0.3 samples, after the step.
    assert rest.swing[0] == pytest.approx(1 + radius ** (math.pi / 0.3), rel=0.02)


def test_settling_waits_for_slow_poles() -> None:
    plant = Lag(((3.0,),), names("u"), names("y"), pole=math.exp(-1 / 2000))
    rest = settle(plant, plant.initial_state(), np.array((1.0,)))
    assert rest.y[0] == pytest.approx(3.0, rel=1e-3)
