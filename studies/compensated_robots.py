"""Robots and references on which laws of one axis are compared, and how one is driven."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sysid.data.record import Array, Channel
from sysid.effects.ground import Ground
from sysid.robot.mission.axis import AxisInputs
from sysid.robot.mission.contracts import (
    ROBOT_INPUTS,
    ROBOT_OUTPUTS,
    Body,
    Command,
    ControlInputs,
    Pose,
    References,
    SteppablePlant,
)
from sysid.robot.mission.control.axes import AxisController
from sysid.robot.mission.simulator import scene_of, shaper_of
from sysid.robot.mission.spec import Mission
from sysid.runners import floats
from sysid.vehicle.kinematics import Geometry, body_velocity, step_pose

PERIOD = 0.1


@dataclass(frozen=True)
class Tracks:
    """First-order tracks, the left one weaker than the right one by ``difference``."""

    top_speed: float = 0.43
    lag: float = 0.2
    difference: float = 0.2
    dt: float = PERIOD
    inputs: tuple[Channel, ...] = ROBOT_INPUTS
    outputs: tuple[Channel, ...] = ROBOT_OUTPUTS
    input_range: tuple[tuple[float, float], ...] = ()
    u_offset: Array = field(default_factory=lambda: np.zeros(2))
    ground: Ground = field(default_factory=Ground)

    def initial_state(self) -> Array:
        """At rest."""
        return np.zeros(2)

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        """ω⁺ = a ω + b u."""
        a, half = math.exp(-self.dt / self.lag), 0.5 * self.difference
        each = np.array((1.0 - half, 1.0 + half)) * self.top_speed / Geometry().r / 20000.0
        return a * state + (1.0 - a) * each * u, state


KNOWN = Tracks(difference=0.0)
"""What was identified; the robots below differ from it as robots do from their models."""

FAMILY = tuple(
    Tracks(0.43 * gain, 0.2 * lag, difference)
    for gain in (0.8, 1.0, 1.25)
    for lag in (0.75, 1.0, 1.75)
    for difference in (0.0, 0.2)
)


def references(axis: str, seed: int, seconds: float = 40.0) -> list[tuple[float, float]]:
    """Steps every 4 s and a slow wave on them: speed [m/s] and yaw [rad] at every instant."""
    rng = np.random.default_rng(seed)
    n = round(seconds / PERIOD)
    t = PERIOD * np.arange(n)
    steps = np.repeat(rng.uniform(-1.0, 1.0, n // 40 + 1), 40)[:n]
    if axis == "speed":
        return [(float(v), 0.0) for v in 0.17 + 0.1 * steps + 0.03 * np.sin(0.8 * t)]
    return [(0.15, float(psi)) for psi in 0.8 * steps + 0.2 * np.sin(0.8 * t)]


@dataclass(frozen=True)
class Run:
    """What one drive was: value, reference, command, and what the law of the axis was given."""

    error: Array
    command: Array
    given: tuple[AxisInputs, ...]

    @property
    def rms(self) -> float:
        """Root mean square of the tracking error."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def effort(self) -> float:
        """Mean change of the command a period [drive]: how hard the drive is worked."""
        return float(np.mean(np.abs(np.diff(self.command))))


class Listening:
    """A law of one axis that keeps what it was given."""

    def __init__(self, law: Any) -> None:
        self.law, self.given = law, list[AxisInputs]()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.law, name)

    def step(self, state: Any, inputs: AxisInputs, dt: float, xp: Any) -> Any:
        """The law's own."""
        self.given.append(inputs)
        return self.law.step(state, inputs, dt, xp)


def driven(
    axis: str,
    law: Any,
    wanted: Sequence[tuple[float, float]],
    plant: SteppablePlant,
    known: SteppablePlant = KNOWN,
    **control: Any,
) -> Run:
    """Follow references with a law on one axis and the default on the other."""
    heard = Listening(law)
    controller = AxisController(**{axis: heard}, **control)
    mission = Mission(goal=(9.0, 0.0), control=controller)
    scene, drive = scene_of(mission, known), shaper_of(mission, known)
    state, x, pose = controller.start(scene, floats), plant.initial_state(), (0.0, 0.0, 0.0)
    pwm, applied, rows = (0.0, 0.0), Command(0.0, 0.0), []
    along, samples = axis == "speed", round(PERIOD / plant.dt)
    for k, (speed, psi) in enumerate(wanted):
        y = plant.step(x, np.array(pwm))[1]
        v, yaw_rate = (float(m) for m in body_velocity(y[0], y[1], Geometry()))
        pose = step_pose(*pose, v, yaw_rate, PERIOD)
        body = Body(Pose(*(float(p) for p in pose)), v, yaw_rate)
        asked = References(speed, psi, False)
        given = ControlInputs(PERIOD * k, asked, body, scene, applied)
        state, command = controller.step(state, given, PERIOD, floats)
        pwm, applied = drive(command, body, PERIOD * k, floats)
        for _ in range(samples):
            x = plant.step(x, np.array(pwm))[0]
        rows.append((heard.given[-1].error, command[0 if along else 1]))
    error, commands = np.array(rows).T
    return Run(error, commands, tuple(heard.given))


def family_runs(axis: str, law: Any, seed: int) -> Iterator[Run]:
    """The law on every robot of the family, each with references of its own."""
    for k, plant in enumerate(FAMILY):
        yield driven(axis, law, references(axis, seed + k), plant)


def family_rms(axis: str, law: Any, seed: int) -> float:
    """Root mean square over all of them."""
    return float(np.sqrt(np.mean([run.rms**2 for run in family_runs(axis, law, seed)])))
