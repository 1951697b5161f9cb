"""What a single run costs: counted steps and calls, which no load on the machine changes."""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from laws.cases import case_of
from mission_cases import AROUND, Robot
from plant_models import robot_model

from sysid.data.record import Array
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.structures.plant import Plant
from sysid.structures.special_runs import rest


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


FLOAT_TURNS = {
    "oe": 160,  # measured 65
    "narmax": 160,  # 65
    "dc-motor": 700,  # 305, a run on arrays 4500
    "hammerstein-wiener": 700,  # 310, on arrays 1200
    "wiener-hammerstein": 700,  # 330, on arrays 1000
    "narx-wavelet": 700,  # 270
    "tanks": 900,  # 415, on arrays 2600
    "augmented": 2400,  # 1050
}
"""Most turns of a loop on floats that a step may last; both meet the same load."""


def float_loop(turns: int) -> float:
    x = 0.3
    for _ in range(turns):
        x = 0.5 * x * (1.0 - x) + 0.1 if x > 0.2 else x + 0.05
    return x


def processor_time(run: Callable[[], object]) -> float:
    """[s]"""
    start = time.process_time()
    run()
    return time.process_time() - start


def turns_of(run: Callable[[], object], most: float, rounds: int = 100) -> float:
    """How many turns of the loop last as long as `run`: the quickest of each, side by side.

    A load on the machine only makes both slower, at times for a second: rounds go on until
    the answer is below `most`, or all are used.
    """
    loop, ours = np.inf, np.inf
    for done in range(rounds):
        loop = min(loop, processor_time(lambda: float_loop(20_000)) / 20_000)
        ours = min(ours, processor_time(run))
        if done >= 6 and ours / loop < most:
            break
    return ours / loop


@pytest.mark.parametrize("name", FLOAT_TURNS)
def test_a_step_costs_what_plain_numbers_cost(name: str) -> None:
    case = case_of(name)
    step, x = case.structure.step(case.theta), rest(case.structure, case.theta)
    samples = []
    for u in case.inputs(150, 4):
        samples.append((x, u))
        x, _ = step(x, u)

    def run() -> None:
        for x, u in samples:
            step(x, u)

    most = FLOAT_TURNS[name] * len(samples)
    assert turns_of(run, most) < most


def test_laws_and_loop_make_few_calls() -> None:
    """Calls of functions a sample, counted: 240 between four obstacles, each some 0.1 µs."""
    calls = []
    robot = Readable()
    sys.setprofile(lambda frame, event, what: calls.append(event) if "call" in event else None)
    try:
        result = simulate(AROUND, robot)
    finally:
        sys.setprofile(None)
    assert len(calls) / len(result.log["t"]) < 330
