"""Pure pursuit: following a polyline by driving at a point ahead on it."""

import math
from itertools import pairwise
from typing import Any, NamedTuple

from sysid.robot.mission.contracts import GuidanceInputs, Point, Pose, References, Scene
from sysid.robot.mission.settings import GuidanceSettings, Positive
from sysid.robot.mission.traits import GuidanceAdvice, GuidanceTraits
from sysid.vehicle.kinematics import Real, wrap_angle


class OnCourse(NamedTuple):
    """How far along the course it is.

    Attributes:
        done: length of the course behind the robot [m].
        x, y: where the course begins [m].
    """

    done: Real
    x: Real
    y: Real


class PurePursuit(GuidanceSettings):
    """Follows the mission's path, or the straight line to its goal; obstacles do not act.

    The point of the course nearest to the robot, no earlier than the one before, is how far it has
    come; it heads for the point ``lookahead`` farther on (Coulter 1992). A short lookahead follows
    closely and swings, a long one cuts corners.

    Attributes:
        lookahead: distance along the course to the point driven at [m].
        v_max: largest speed reference [m/s].
        slow_within: distance before the goal within which it slows down [m].
    """

    lookahead: Positive = 0.3
    v_max: Positive = 0.3
    slow_within: Positive = 0.4

    @property
    def advice(self) -> GuidanceAdvice:
        return GuidanceAdvice(
            faster="raise v_max",
            slower="lower v_max",
            wider="lead the path around it, or choose guidance that keeps clear of obstacles",
        )

    @property
    def traits(self) -> GuidanceTraits:
        return GuidanceTraits(follows_path=True, feasible=True, top_speed=self.v_max)

    def start(self, scene: Scene, xp: Any) -> OnCourse:
        return OnCourse(0.0, scene.start.x, scene.start.y)

    def step(
        self, state: OnCourse, inputs: GuidanceInputs, dt: Real, xp: Any
    ) -> tuple[OnCourse, References]:
        scene, pose = inputs.scene, inputs.estimate.pose
        course = _course(state, scene)
        done, _ = _nearest(course, pose, state.done, state.done + 2.0 * self.lookahead, xp)
        x, y = _point(course, done + self.lookahead, xp)
        to_go = _length(course, xp) - done
        psi = xp.arctan2(y - pose.y, x - pose.x)
        to_goal = scene.to_goal(pose, xp)
        # A course that comes by its goal before its end is not over there.
        ending = to_go <= self.lookahead + scene.tolerance
        return state._replace(done=done), References(
            speed=paced(self.v_max, self.slow_within, pose.psi, psi, to_go, xp),
            psi=psi,
            arrived=ending & (to_goal <= scene.tolerance),
        )

    def to_go(self, state: OnCourse, pose: Pose, scene: Scene, xp: Any) -> Real:
        """What is left of the course, and the way back to it [m]."""
        course = _course(state, scene)
        ahead = state.done + 2.0 * self.lookahead
        done, aside = _nearest(course, pose, state.done, ahead, xp)
        return _length(course, xp) - done + aside


def _course(state: OnCourse, scene: Scene) -> tuple[Point, ...]:
    return ((state.x, state.y), *scene.path, scene.goal)


def _length(course: tuple[Point, ...], xp: Any) -> Real:
    return sum(xp.hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(course))


def _nearest(
    course: tuple[Point, ...], pose: Pose, low: Real, high: Real, xp: Any
) -> tuple[Real, Real]:
    """Length up to the nearest point between two lengths, and the distance to it [m]."""
    begin: Real = 0.0
    done, aside = low, xp.inf
    for a, b in pairwise(course):
        dx, dy = b[0] - a[0], b[1] - a[1]
        length = xp.hypot(dx, dy)
        safe = xp.maximum(length, 1e-9)
        along = ((pose.x - a[0]) * dx + (pose.y - a[1]) * dy) / safe
        first = xp.clip(low - begin, 0.0, length)
        along = xp.clip(along, first, xp.maximum(first, xp.clip(high - begin, 0.0, length)))
        gap = xp.hypot(a[0] + along * dx / safe - pose.x, a[1] + along * dy / safe - pose.y)
        nearer = (gap < aside) & (begin + length >= low) & (begin <= high)
        done, aside = xp.where(nearer, begin + along, done), xp.where(nearer, gap, aside)
        begin = begin + length
    return done, aside


def _point(course: tuple[Point, ...], at: Real, xp: Any) -> Point:
    """The point of the course at a length; its end beyond it."""
    begin: Real = 0.0
    x, y = course[0]
    for a, b in pairwise(course):
        dx, dy = b[0] - a[0], b[1] - a[1]
        length = xp.hypot(dx, dy)
        share = xp.clip((at - begin) / xp.maximum(length, 1e-9), 0.0, 1.0)
        on = at >= begin
        x, y = xp.where(on, a[0] + share * dx, x), xp.where(on, a[1] + share * dy, y)
        begin = begin + length
    return x, y


LEAST = 0.25
"""Share of its speed that a robot keeps up to its goal: at less it would hardly get there."""


def paced(v_max: float, slow_within: float, psi: Real, psi_ref: Real, to_go: Real, xp: Any) -> Real:
    """V_ref = V_max · max(0, cos(ψ_ref − ψ)) · clip(way to go/slow_within, ¼, 1) [m/s].

    A robot that looks the other way turns on the spot.

    Args:
        v_max: largest speed [m/s].
        slow_within: distance before the goal within which it slows down [m].
        psi, psi_ref: heading and the one wanted [rad].
        to_go: way still to go [m].
    """
    ahead = xp.maximum(0.0, xp.sin(wrap_angle(psi_ref - psi) + 0.5 * math.pi))
    return v_max * ahead * xp.clip(to_go / slow_within, LEAST, 1.0)
