"""The guidance half of a mission: estimates in, references or PWM out.

It is the loop of :mod:`sysid.robot.mission.loop` itself, whose motion and navigation are what the
robot says; its clock ticks when the robot says something.
"""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sysid.cosim.connection import BROKEN_OFF, Ended, Level, Port, Seen
from sysid.cosim.connection import Asked as AskedOf
from sysid.data.record import Array
from sysid.effects.ground import Ground
from sysid.errors import ModelError
from sysid.robot.mission.contracts import (
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
from sysid.robot.mission.tracks.robot_plant import TrackChannels
from sysid.runners import floats
from sysid.vehicle.kinematics import Real, wheel_speeds

PATIENCE = 10.0
"""A half that says nothing for this long [s] of real time is given up: a busy machine stops a
process for a few seconds, hardly for ten."""


@dataclass(frozen=True)
class _Elsewhere(TrackChannels):
    """The plant that stands in the other half: only its sample time is known here."""

    dt: float
    ground: Ground = field(default_factory=Ground)

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
        return wheel_speeds(state.speed, state.yaw_rate, self._geometry)

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


def _asked(state: LoopState, level: Level) -> AskedOf:
    if level is Level.PWM:
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
    control = mission.control
    if known is None and (mission.limits_from_plant or control.uses_plant or control.compensate):
        raise ModelError("a law of the mission needs a model of the plant; name a `plant`")
    there = _Elsewhere(control.period if known is None else known.dt)
    informed = there if known is None else known
    scene = scene_of(mission, informed)
    heard = _Heard(scene, port, patience)
    loop = Loop(
        guidance=mission.complete_guidance,
        control=control,
        navigation=heard,
        motion=heard,
        plant=there,
        scene=scene._replace(sensors={}),
        timeout=mission.timeout,
        xp=floats,
        shaper=shaper_of(mission, informed),
    )

    def say(state: LoopState, tick: Tick) -> None:
        """A command, or the end, to the robot."""
        if state.verdict != Verdict.GOES_ON:
            port.send(Ended(Outcome[Verdict(int(state.verdict)).name].value))
        elif tick.now:
            port.send(_asked(state, level))

    try:
        state, table = run(loop, 0, heard.ticks(control.period), say)
    except BaseException:
        with contextlib.suppress(Exception):  # what is wrong is the first error, not this
            port.send(Ended(BROKEN_OFF))
        raise
    return result_of(mission, loop, state, table, heard.outcome)
