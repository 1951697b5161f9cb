"""Laws around a law of guidance: one waypoint after the other, and references within limits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from sysid.robot.mission.contracts import (
    Guidance,
    GuidanceInputs,
    Limits,
    Point,
    Pose,
    References,
    Scene,
    State,
)
from sysid.robot.mission.traits import GuidanceAdvice, GuidanceTraits
from sysid.runners.trees import chosen
from sysid.vehicle.kinematics import Real, wrap_angle


@dataclass(frozen=True)
class AroundLaw:
    """A law of guidance around another, whose reach, advice and traits it has."""

    law: Guidance

    @property
    def reach(self) -> float:
        return self.law.reach

    @property
    def advice(self) -> GuidanceAdvice:
        return self.law.advice

    @property
    def traits(self) -> GuidanceTraits:
        return self.law.traits


def pick(values: Sequence[Real], k: Real, xp: Any) -> Real:
    """``values[k]`` for a number ``k`` that may be traced."""
    chosen = values[0]
    for j, value in enumerate(values[1:], 1):
        chosen = xp.where(k == j, value, chosen)
    return chosen


SAME = 1e-9
"""Angles that differ by less [rad] differ by rounding alone."""


class FeasibleState(NamedTuple):
    """The last references and what the law remembers.

    Attributes:
        speed: last reference of speed [m/s].
        psi: last reference of yaw [rad].
        rate: at which that turned [rad/s].
    """

    law: State
    speed: Real
    psi: Real
    rate: Real


@dataclass(frozen=True)
class Feasible(AroundLaw):
    """A law whose references stay within ``scene.limits``.

    The reference of speed never exceeds the limit and changes no faster than the acceleration
    allows; that of yaw turns the short way, no faster than the yaw rate and its acceleration allow,
    and brakes in time.
    """

    def start(self, scene: Scene, xp: Any) -> FeasibleState:
        return FeasibleState(self.law.start(scene, xp), 0.0, scene.start.psi, 0.0)

    def step(
        self, state: FeasibleState, inputs: GuidanceInputs, dt: Real, xp: Any
    ) -> tuple[FeasibleState, References]:
        law, wanted = self.law.step(state.law, inputs, dt, xp)
        limits = inputs.scene.limits
        speed = xp.minimum(wanted.speed, limits.speed)
        if not math.isinf(limits.acceleration):
            step = limits.acceleration * dt
            speed = xp.clip(speed, state.speed - step, state.speed + step)
        if math.isinf(limits.yaw_rate) and math.isinf(limits.yaw_acceleration):
            return FeasibleState(law, speed, wanted.psi, 0.0), wanted._replace(speed=speed)
        rate = limited_rate(wrap_angle(wanted.psi - state.psi), state.rate, limits, dt, xp)
        psi = wrap_angle(state.psi + rate * dt)
        # What is within reach of this step is taken as it is, not through sums and wraps.
        psi = xp.where(abs(wrap_angle(wanted.psi - psi)) < SAME, wanted.psi, psi)
        return FeasibleState(law, speed, psi, rate), wanted._replace(speed=speed, psi=psi)

    def to_go(self, state: FeasibleState, pose: Pose, scene: Scene, xp: Any) -> Real:
        return self.law.to_go(state.law, pose, scene, xp)


def limited_rate(error: Real, last: Real, limits: Limits, dt: Real, xp: Any) -> Real:
    """The rate at which a reference turns by ``error`` without exceeding the limits [rad/s].

    |rate| ≤ ψ̇_max, |rate − last| ≤ ψ̈_max dt, and no faster than it can brake from on the rest of
    the way: rate²/2 + rate·ψ̈_max dt/2 ≤ ψ̈_max |error|.

    Args:
        error: angle still to turn [rad].
        last: the rate before [rad/s].
        limits: of the plant; what is infinite does not limit.
        dt: time of the step [s].
    """
    size = abs(error)
    fastest = xp.minimum(size / xp.maximum(dt, 1e-9), limits.yaw_rate)
    if not math.isinf(limits.yaw_acceleration):
        step = limits.yaw_acceleration * dt
        braking = -0.5 * step + xp.sqrt(0.25 * step * step + 2.0 * limits.yaw_acceleration * size)
        rate = xp.where(error >= 0, 1.0, -1.0) * xp.minimum(fastest, braking)
        return xp.clip(rate, last - step, last + step)
    return xp.where(error >= 0, 1.0, -1.0) * fastest


class LegState(NamedTuple):
    """Which leg of the way it is, counted from 0, and what the law remembers on it."""

    leg: Real
    law: State


@dataclass(frozen=True)
class PassingWaypoints(AroundLaw):
    """A law that is given one waypoint after the other as its goal, and then the goal.

    A waypoint is passed where the law calls it reached; there the law starts anew towards the next
    one, with any turn on the spot that it begins with.
    """

    def start(self, scene: Scene, xp: Any) -> LegState:
        first = scene._replace(goal=scene.targets[0], way=())
        return LegState(0, self.law.start(first, xp))

    def step(
        self, state: LegState, inputs: GuidanceInputs, dt: Real, xp: Any
    ) -> tuple[LegState, References]:
        """The law's references on this leg; at its end the law starts on the next one."""
        scene = inputs.scene
        here = _on_leg(scene, state.leg, xp)
        law, references = self.law.step(state.law, inputs._replace(scene=here), dt, xp)
        last = state.leg == len(scene.way)
        passed = references.arrived & xp.logical_not(last)
        references = references._replace(arrived=references.arrived & last)
        if isinstance(passed, bool | np.bool_) and not passed:
            return LegState(state.leg, law), references
        after = _on_leg(scene, state.leg + 1, xp)._replace(start=inputs.estimate.pose)
        law = chosen(passed, self.law.start(after, xp), law, xp)
        return LegState(state.leg + xp.where(passed, 1, 0), law), references

    def to_go(self, state: LegState, pose: Pose, scene: Scene, xp: Any) -> Real:
        """The way to the end of this leg and along those after it [m]."""
        places = scene.targets
        remaining: list[Real] = [0.0]
        for a, b in zip(places[-2::-1], places[:0:-1], strict=True):
            remaining.insert(0, remaining[0] + xp.hypot(b[0] - a[0], b[1] - a[1]))
        on_leg = self.law.to_go(state.law, pose, _on_leg(scene, state.leg, xp), xp)
        return on_leg + pick(remaining, state.leg, xp)


def way_length(start: Pose, places: Sequence[Point]) -> float:
    """Length of the straight legs from a start through places [m]."""
    return sum(math.dist(a, b) for a, b in pairwise([(start.x, start.y), *places]))


def _on_leg(scene: Scene, leg: Real, xp: Any) -> Scene:
    places = scene.targets
    goal = (pick([p[0] for p in places], leg, xp), pick([p[1] for p in places], leg, xp))
    return scene._replace(goal=goal, way=())
