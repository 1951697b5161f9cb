"""The robot half of a mission: references or PWM in, estimated pose out.

It is the loop of :mod:`sysid.robot.mission.loop` itself, whose guidance (for PWM its controller,
too) is what the other half asks.
"""

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from sysid.cosim.connection import BROKEN_OFF, Asked, Ended, Level, Port, Seen, SilenceError
from sysid.cosim.guiding import PATIENCE
from sysid.data.record import PWM_FULL_SCALE
from sysid.errors import ModelError, UsageError
from sysid.robot.mission.contracts import (
    Body,
    Command,
    ControlInputs,
    GuidanceInputs,
    Pose,
    References,
    Scene,
    SteppablePlant,
)
from sysid.robot.mission.loop import STUCK, LoopState, Tick, plain_shaper, ticks
from sysid.robot.mission.result import MissionResult, Outcome
from sysid.robot.mission.simulator import (
    closed_loop,
    result_of,
    run,
    scene_of,
    shaper_of,
)
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.traits import ControlAdvice, GuidanceAdvice, GuidanceTraits
from sysid.runners import floats
from sysid.vehicle.kinematics import Real


@dataclass(frozen=True)
class Pace:
    """How the robot's time goes.

    Attributes:
        lock_step: it waits for the answer to everything it says, so that the run is the one within
            one process, whatever the machine does; otherwise time goes on, with the last answer.
        speed: seconds of the mission a second, where it does not wait.
        patience: how long the other half may say nothing [s] of real time.
    """

    lock_step: bool = False
    speed: float = 1.0
    patience: float = PATIENCE

    def __post_init__(self) -> None:
        for name in ("speed", "patience"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise UsageError(f"`{name}` is {value:g}: give a number above 0")


class _OtherHalf:
    """What the other half asks, as a law of guidance; the robot's pose is sent first.

    Attributes:
        asked: the last it asked for.
        outcome: how it says that the mission ended; None while it does not.
    """

    reach = 0.0
    advice = GuidanceAdvice()
    traits = GuidanceTraits()

    def __init__(self, port: Port, pace: Pace, level: Level, psi: float) -> None:
        self._rest, self._level = Asked(0.0, psi), level
        self.asked = Asked(0.0, 0.0) if level is Level.PWM else self._rest
        self.outcome: str | None = None
        self._port, self._pace, self._streamed_until = port, pace, -math.inf
        self._heard = time.monotonic()

    def start(self, scene: Scene, xp: Any) -> int:
        return 0

    def step(self, state: int, inputs: GuidanceInputs, dt: Real, xp: Any) -> tuple[int, References]:
        self.stream(float(inputs.t), inputs.estimate)
        if self._pace.lock_step and self.outcome is None:
            self._take(self._port.receive(self._pace.patience))
        else:
            while (message := self._port.poll()) is not None:  # the last one counts
                self._take(message)
            if self.outcome is None and time.monotonic() - self._heard > self._pace.patience:
                raise SilenceError(
                    f"the robot received no reference for {self._pace.patience:g} s: check that "
                    "the guiding node runs and publishes on the same topic"
                )
        if self.outcome == BROKEN_OFF:
            raise ModelError("the other half of the mission was interrupted; start both again")
        speed, psi = self._rest if self._level is Level.PWM else self.asked
        references = References(
            speed,
            psi,
            arrived=self.outcome == Outcome.ARRIVED,
            gives_up=self.outcome == Outcome.STUCK,
        )
        return state + 1, references

    def to_go(self, state: int, pose: Pose, scene: Scene, xp: Any) -> Real:
        """Ever less: whether the robot comes closer is judged where it is guided."""
        return -2.0 * STUCK.progress * state

    def stream(self, t: float, body: Body) -> None:
        """Say where the robot is, once an instant."""
        if t > self._streamed_until:
            self._port.send(Seen(t, body))
            self._streamed_until = t

    def _take(self, message: object) -> None:
        self._heard = time.monotonic()
        if isinstance(message, Asked):
            if not (math.isfinite(message.along) and math.isfinite(message.around)):
                raise ModelError(
                    f"the robot was asked for {message.along:g}, {message.around:g}, which are "
                    "not numbers; correct the guiding node"
                )
            self.asked = message
        elif isinstance(message, Ended):
            self.outcome = message.outcome

    def ticks(self, dt: float, period: float, wait: Callable[[float], None]) -> Iterator[Tick]:
        """The samples of the plant, each when its time has come, until the mission is over."""
        begun = time.monotonic()
        for tick in ticks(dt, period):
            if not self._pace.lock_step:
                wait(max(begun + tick.t / self._pace.speed - time.monotonic(), 0.0))
            yield tick
            if self.outcome is not None:
                return


@dataclass(frozen=True)
class _AskedPwm:
    """PWM that the other half asks for, as a controller.

    Attributes:
        period: the mission's.
    """

    half: _OtherHalf
    period: float
    uses_plant: bool = False
    compensate: tuple[str, ...] = ()

    @property
    def advice(self) -> ControlAdvice:
        return ControlAdvice()

    def start(self, scene: Scene, xp: Any) -> float:
        return 0.0

    def step(self, state: float, inputs: ControlInputs, dt: Real, xp: Any) -> tuple[float, Command]:
        """PWM as commands, of which the command module makes the same PWM again (thesis 6.3)."""
        asked = self.half.asked
        return state, Command(asked.along / PWM_FULL_SCALE, asked.around / PWM_FULL_SCALE)


def play_robot(
    mission: Mission,
    plant: SteppablePlant,
    port: Port,
    pace: Pace = Pace(),
    level: Level = Level.REFERENCES,
    *,
    seed: int = 0,
    wait: Callable[[float], None] = time.sleep,
) -> MissionResult:
    """Play the robot of a mission for whoever guides it at the other end of a connection.

    Plant, ground, motion, sensors and navigation are here, and the mission's controller where
    references are asked. In lock-step the run is the one of :func:`sysid.robot.mission.simulate`.

    Args:
        mission: vehicle, start, obstacles, sensors, navigation, controller, timeout.
        plant: a robot plant (:func:`sysid.robot.mission.tracks.mapping.as_robot`).
        pace: whether it waits for answers.
        level: what it is asked for.
        wait: what lets real time pass [s].

    Returns:
        The outcome, its figures and the log, of the true pose.

    Raises:
        SilenceError: nothing is asked any more.
        ModelError: the other half has broken off or asks for no numbers; the plant is no robot.
    """
    loop = closed_loop(mission, plant, scene_of(mission, plant), floats, shaper_of(mission, plant))
    half = _OtherHalf(port, pace, level, float(loop.scene.start.psi))
    loop = replace(loop, guidance=half)
    if level is Level.PWM:
        loop = replace(loop, control=_AskedPwm(half, mission.control.period), shaper=plain_shaper)

    def say(state: LoopState, tick: Tick) -> None:
        if not tick.now:
            half.stream(tick.t, state.estimate)

    ending, clock = BROKEN_OFF, half.ticks(plant.dt, mission.control.period, wait)
    try:
        state, table = run(loop, seed, clock, say)
        result = result_of(mission, loop, state, table, half.outcome)
        ending = result.outcome.value
    finally:
        with contextlib.suppress(Exception):  # what is wrong is the first error, not this
            port.send(Ended(ending))
    return result
