"""Waypoints for guidance laws with a single goal."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from sysid.robot.mission.contracts import GuidanceInputs, Point, Pose, References, Scene, State
from sysid.robot.mission.guidance.around_law import AroundLaw
from sysid.robot.mission.guidance.states import chosen, pick
from sysid.vehicle.kinematics import Real


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
