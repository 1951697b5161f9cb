"""The guidance half of a mission: estimates in, references or PWM out.

It is the loop of :mod:`sysid.robot.mission.loop` itself, whose motion and navigation are what the
robot says; its clock ticks when the robot says something.
"""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from sysid.cosim.connection import BROKEN_OFF, Ended, Level, Port, Seen
from sysid.cosim.connection import Asked as AskedOf
from sysid.data.record import Array, Channel
from sysid.effects.ground import Ground
from sysid.errors import ModelError
from sysid.robot.mission.contracts import (
    ROBOT_INPUTS,
    ROBOT_OUTPUTS,
    Body,
    MotionInputs,
    NavigationInputs,
    Scene,
    SteppablePlant,
)
from sysid.robot.mission.loop import Loop, LoopState, Tick, Verdict
from sysid.robot.mission.result import MissionResult, Outcome
from sysid.robot.mission.simulator import result_of, run, scene_of, shaper_of
from sysid.robot.mission.spec import Mission
from sysid.runners import floats
from sysid.vehicle.kinematics import Real

PATIENCE = 10.0
"""A half that says nothing for this long [s] of real time is given up: a busy machine stops a
process for a few seconds, hardly for ten."""


@dataclass(frozen=True)
class _Elsewhere:
    """The plant that stands in the other half: only its sample time is known here."""

    dt: float
    ground: Ground = field(default_factory=Ground)
    inputs: tuple[Channel, ...] = ROBOT_INPUTS
    outputs: tuple[Channel, ...] = ROBOT_OUTPUTS
    input_range: tuple[tuple[float, float], ...] = ()

    @property
    def u_offset(self) -> Array:
        return np.zeros(2)

    def initial_state(self) -> Array:
        return np.zeros(0)

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        raise AssertionError("the plant stands in the other half")


class _Heard:
    """What the robot says, as a motion that turns the tracks itself and as navigation.

    Attributes:
        body: the last it said.
        outcome: how it says that the mission ended; None while it does not.
    """

    def __init__(self, scene: Scene, port: Port, patience: float) -> None:
        self.body = Body(scene.start, 0.0, 0.0)
        self.outcome: str | None = None
        self._geometry, self._port, self._patience = scene.geometry, port, patience

    def start(self, scene: Scene, xp: Any) -> Body:
        return self.body

    def step(
        self, state: Body, inputs: MotionInputs | NavigationInputs, dt: Real, xp: Any
    ) -> tuple[Body, Body]:
        return self.body, self.body

    def wheel_speeds(self, state: Body) -> tuple[Real, Real]:
        """ω of both tracks [rad/s] that move a body so without slip (thesis 2.13, inverted)."""
        turn = 0.5 * self._geometry.B * state.yaw_rate
        return (state.speed - turn) / self._geometry.r, (state.speed + turn) / self._geometry.r

    def ticks(self, period: float) -> Iterator[Tick]:
        """A tick for whatever the robot says, until it says that the mission is over.

        A control instant is due at j·period; it is served by what was seen nearest to it, so that
        the rate is kept on the mean where a robot's clock and the period do not fit.
        """
        first: float | None = None
        last, due = 0.0, 0
        while True:
            said = self._port.receive(self._patience)
            if isinstance(said, Ended):
                self.outcome = said.outcome
                return
            if not isinstance(said, Seen):
                continue
            first = said.t if first is None else first
            t = round(said.t - first, 9)  # a stamp of ROS counts nanoseconds
            if t < last:
                raise ModelError(
                    f"the robot's time went back from {last:g} s to {t:g} s: two robots share one "
                    "topic, or its simulation restarted"
                )
            if t == last and due:
                continue  # said twice
            dt, last, self.body = t - last, t, said.body
            near = t + min(0.5 * dt, 0.5 * period)
            now = (t,) if near >= due * period - _SLACK else ()
            if now:
                due = max(due + 1, int((near + _SLACK) / period) + 1)
            yield Tick(t, dt, (), now)


_SLACK = 1e-6
"""Two times that differ by less [s] are one."""


@dataclass(frozen=True)
class _GuidingLoop(Loop):
    """A loop that says what it decides."""

    port: Port | None = None
    level: Level = Level.REFERENCES

    def sample(
        self, state: LoopState, tick: Tick, draws: Sequence[Sequence[Real]] = ()
    ) -> tuple[LoopState, tuple[Real, ...]]:
        """A sample of the loop; then a command, or the end, is sent to the robot."""
        state, row = super().sample(state, tick, draws)
        if self.port is None:
            return state, row
        if state.verdict != Verdict.GOES_ON:
            self.port.send(Ended(Outcome[Verdict(int(state.verdict)).name].value))
        elif tick.now:
            self.port.send(self._asked(state))
        return state, row

    def _asked(self, state: LoopState) -> AskedOf:
        if self.level is Level.PWM:
            left, right = map(float, state.pwm)
            return AskedOf(0.5 * (left + right), 0.5 * (right - left))
        return AskedOf(float(state.references.speed), float(state.references.psi))


def guide(
    mission: Mission,
    port: Port,
    level: Level = Level.REFERENCES,
    known: SteppablePlant | None = None,
    patience: float = PATIENCE,
) -> MissionResult:
    """Lead a robot at the other end of a connection through a mission.

    Every time the robot says where it is and a command is due, guidance answers with V_d and ψ_d,
    or with PWM, controller and command module included. The result is of the pose that the robot
    says. Its log has what this half computed: where the loops run in the robot, commands and PWM
    are what they give for the same estimate here.

    Args:
        mission: its guidance, control, goal and obstacles.
        known: the robot plant, for laws that need a model; only they do.
        patience: how long the robot may say nothing [s].

    Returns:
        The outcome, its figures and the log, a row for everything the robot said.

    Raises:
        SilenceError: the robot says nothing any more.
        ModelError: it has broken off, or a law needs the plant and there is none.
    """
    if known is None and needs_plant(mission):
        raise ModelError("a law of the mission needs a model of the plant; name a `plant`")
    dt = mission.control.period if known is None else known.dt
    there = _Elsewhere(dt)
    scene = scene_of(mission, there if known is None else known)
    heard = _Heard(scene, port, patience)
    plain = Loop(
        guidance=mission.complete_guidance,
        control=mission.control,
        navigation=heard,
        motion=heard,
        plant=there,
        scene=scene._replace(sensors={}),
        timeout=mission.timeout,
        xp=floats,
        shaper=shaper_of(mission, there if known is None else known),
    )
    parts = {f.name: getattr(plain, f.name) for f in fields(plain)}
    loop = _GuidingLoop(**parts, port=port, level=level)
    try:
        state, table = run(loop, 0, heard.ticks(mission.control.period))
    except BaseException:
        with contextlib.suppress(Exception):  # what is wrong is the first error, not this
            port.send(Ended(BROKEN_OFF))
        raise
    return result_of(mission, loop, state, table, heard.outcome)


def needs_plant(mission: Mission) -> bool:
    """Whether a law of guidance or control must know the identified plant."""
    control = mission.control
    return bool(mission.limits_from_plant or control.uses_plant or control.compensate)
