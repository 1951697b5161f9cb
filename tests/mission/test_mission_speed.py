"""What a single run costs: counted steps and calls, which no load on the machine changes."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from mission_cases import AROUND, Robot
from plant_models import robot_model

from sysid.data.record import Array
from sysid.mission.mapping import as_robot
from sysid.mission.simulator import simulate
from sysid.structures.plant import Plant


@dataclass(frozen=True)
class Counted(Robot):
    """A robot that counts its steps."""

    steps: list[int] = field(default_factory=list)

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        self.steps.append(1)
        return super().step(state, u)


@dataclass(frozen=True)
class Readable(Counted):
    """One that tells y(k) without a step."""

    def readout(self, state: Array, u: Array) -> Array:
        return state + self.direct * u


@pytest.mark.parametrize(("kind", "steps"), [(Counted, 2), (Readable, 1)])
@pytest.mark.parametrize("direct", [0.0, 1e-5])
def test_a_plant_that_can_be_read_is_stepped_once_a_sample(
    kind: type[Counted], steps: int, direct: float
) -> None:
    robot = kind(direct=direct)
    result = simulate(AROUND, robot)
    assert len(robot.steps) == steps * len(result.log["t"])
    plain = simulate(AROUND, Robot(direct=direct))
    for name, column in plain.log.items():
        np.testing.assert_array_equal(result.log[name], column)


@pytest.mark.parametrize("structure", ["arx", "oe"])
def test_what_is_read_is_what_a_step_gives(structure: str) -> None:
    model = robot_model(structure)
    plant: Plant = model.plant()
    robot, _ = as_robot(plant, AROUND)
    rng = np.random.default_rng(1)
    for plain in (plant, robot):
        state, u = rng.normal(size=plain.initial_state().shape), 1e4 * rng.normal(size=2)
        np.testing.assert_array_equal(plain.readout(state, u), plain.step(state, u)[1])
