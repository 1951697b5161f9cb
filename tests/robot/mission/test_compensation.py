"""Making up for identified effects: a dead zone that is known no longer costs tracking."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mission_cases import Robot, goal

from sysid.data.preprocess import Detrend
from sysid.data.record import PWM_FULL_SCALE, Array, Channel
from sysid.effects.catalogue import effect
from sysid.errors import DataError, ModelError
from sysid.robot.mission.contracts import ROBOT_INPUTS, ROBOT_OUTPUTS, Body, Command, Pose
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission, load_mission
from sysid.robot.mission.tracks.compensation import Compensation, compensation_of, nothing_to_undo
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.robot.mission.tracks.robot_plant import RobotPlant
from sysid.runners import floats
from sysid.structures.augmented.structure import Augmented
from sysid.structures.plant import Plant
from sysid.vehicle.kinematics import Geometry

STRAIGHT: dict[str, Any] = {"tolerance": 0.05, "timeout": 40}


def augmented(**effects: dict[str, float]) -> RobotPlant:
    """First-order tracks, 0.43 m/s at full drive, behind effects with these numbers."""
    ids = tuple(id.replace("_", "-") for id in effects)
    structure = Augmented(1, 1, (PWM_FULL_SCALE,) * 2, 0.1, ids)
    theta = [0.43 / Geometry().r, -float(np.exp(-0.5))] * 2
    for id, values in effects.items():
        e = effect(id.replace("_", "-"))
        theta += [values.get(p.name, p.null) for p in e.parameters] * (1 if e.shared else 2)
    none = Detrend(np.zeros(2), np.zeros(2))
    ranges = np.array([[-PWM_FULL_SCALE, PWM_FULL_SCALE]] * 2)
    plant = Plant.of_structure(
        structure, np.array(theta), 0.1, ROBOT_INPUTS, ROBOT_OUTPUTS, none, ranges
    )
    return as_robot(plant, goal(1, 0))[0]


DEAD = augmented(dead_zone={"plus": 0.15, "minus": 0.12, "jump": 0.0})
RUBBING = augmented(coulomb_friction={"level": 4.0})


def error(plant: RobotPlant, compensate: Any) -> float:
    """Root mean square of the speed error of a straight metre and a half [m/s]."""
    mission = goal(1.5, 0, control={"kp_yaw": 0.4, "compensate": compensate}, **STRAIGHT)
    log = simulate(mission, plant).log
    return float(np.sqrt(np.mean((log["v"] - log["v_ref"]) ** 2)))


@pytest.mark.parametrize("plant", [DEAD, RUBBING], ids=["dead zone", "friction"])
def test_what_was_identified_no_longer_costs_tracking(plant: RobotPlant) -> None:
    ideal = error(augmented(), ())
    plain, made_up = error(plant, ()), error(plant, "identified")
    # The plant without the effect is the best that can be; a tenth of what the effect costs may
    # stay, for what happens between two commands.
    assert made_up - ideal < 0.1 * (plain - ideal)


def test_a_named_effect_alone_is_made_up_for() -> None:
    both = augmented(
        dead_zone={"plus": 0.15, "minus": 0.15, "jump": 0.0}, direction_asymmetry={"rho": 0.7}
    )
    drive = compensation_of(both, ("direction-asymmetry",), Geometry())
    assert drive is not None
    body = Body(Pose(0.0, 0.0, 0.0), 0.0, 0.0)
    (left, right), applied = drive(Command(0.0, 0.28), body, 0.0, floats)
    assert (left, right) == pytest.approx((-0.4 * PWM_FULL_SCALE, 0.28 * PWM_FULL_SCALE))
    assert applied == pytest.approx((0.0, 0.28))
    everything = compensation_of(both, "identified", Geometry())
    assert everything is not None
    assert set(everything.ids) == {"direction-asymmetry", "dead-zone"}


def test_a_robot_of_copies_with_other_units_is_made_up_for_on_each_track() -> None:
    """A bench motor from volts to rad/s: 2 V of its 10 V are a dead zone."""
    structure = Augmented(1, 1, (10.0,), 0.1, ("dead-zone",))
    theta = np.array([300.0, -0.6, 0.2, 0.2, 0.0])
    none = Detrend(np.zeros(1), np.zeros(1))
    channels = (Channel("u", "V"),), ROBOT_OUTPUTS[:1]
    motor = Plant.of_structure(structure, theta, 0.1, *channels, none, np.array([[-10.0, 10.0]]))
    robot, _ = as_robot(motor, goal(1, 0))
    assert robot.twins
    drive = compensation_of(robot, "identified", Geometry())
    assert drive is not None
    body = Body(Pose(0.0, 0.0, 0.0), 0.0, 0.0)
    (left, right), _ = drive(Command(0.3, 0.1), body, 0.0, floats)
    assert (left, right) == pytest.approx((0.4 * PWM_FULL_SCALE, 0.6 * PWM_FULL_SCALE))


def test_what_does_not_reach_the_tracks_is_known_to_the_controller() -> None:
    weak = augmented(input_saturation={"plus": 0.5, "minus": 0.5})
    drive = compensation_of(weak, "identified", Geometry())
    assert drive is not None
    body = Body(Pose(0.0, 0.0, 0.0), 0.0, 0.0)
    assert drive(Command(0.8, 0.1), body, 0.0, floats)[1] == pytest.approx((0.5, 0.0))


def test_compensation_is_the_same_compiled_and_many_at_once() -> None:
    jax.config.update("jax_enable_x64", True)
    drive = compensation_of(
        augmented(
            dead_zone={"plus": 0.15, "minus": 0.12, "jump": 0.05}, coulomb_friction={"level": 2.0}
        ),
        "identified",
        Geometry(),
    )
    assert isinstance(drive, Compensation)

    def of(a: Any, xp: Any) -> Any:
        body = Body(Pose(0.0, 0.0, 0.0), a[2], a[3])
        pwm, applied = drive(Command(a[0], a[1]), body, 0.5, xp)
        return xp.array((*pwm, *applied))

    cases: Array = np.random.default_rng(2).uniform(-0.5, 0.5, (50, 4))
    together = jax.jit(jax.vmap(lambda a: of(a, jnp)))(cases)
    alone = np.array([of([float(v) for v in row], floats) for row in cases])
    # Pulse widths of 2e4 µs by a few operations.
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-9)


# Words --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("compensate: everything", "compensate is the text 'everything': write identified, or a"),
        ("compensate: [actuator-lag]", "invertible effects, which are"),
        ("compensate: 3", "compensate is 3"),
    ],
)
def test_what_cannot_be_undone_is_refused_with_its_line(
    tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(f"goal: [1, 0]\ncontrol:\n  {text}\n")
    with pytest.raises(DataError) as caught:
        load_mission(path)
    assert str(caught.value).startswith("m.yaml:3: ")
    assert words in str(caught.value)


def test_an_effect_that_the_plant_does_not_hold_is_said() -> None:
    mission = goal(1, 0, control={"compensate": ["dead-zone"]})
    with pytest.raises(
        ModelError, match="names dead-zone, which the plant does not contain; it contains"
    ):
        simulate(mission, RUBBING)
    everything = Mission(goal=(1.0, 0.0), control={"compensate": "identified"})
    plain = augmented()
    assert "Nothing is compensated" in nothing_to_undo(plain, everything.control.compensate)[0]
    assert nothing_to_undo(RUBBING, everything.control.compensate) == ()
    assert nothing_to_undo(plain, ()) == ()
    simulate(everything, Robot())
