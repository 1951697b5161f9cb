"""Where a potential field holds a robot: noticed while it drives, and named (thesis 4.5)."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sysid.data.record import Array
from sysid.mission.contracts import Hold, Pose, Scene
from sysid.mission.guidance.field import (
    PotentialField,
    acting_points,
    attractive_force,
    total_force,
)
from sysid.vehicle.kinematics import Real


@dataclass(frozen=True)
class TrapRule:
    """When a robot counts as held by its field.

    Attributes:
        progress: it came less than this [m] closer to the goal, as in a mission that is stuck, …
        around: … and no farther than this share of the field's range from where it was, …
        time: … in this time [s]: half of that after which a mission is stuck, so that a way out
            has begun by then.
        cancels: a force below this share of the attraction, in the middle of where the robot goes
            to and fro, means a local minimum: at the minimum itself it is nothing, and half is
            reached only at the edge of the orbits of a robot that cannot stand still.
    """

    progress: float = 0.05
    around: float = 0.5
    time: float = 5.0
    cancels: float = 0.5


TRAP = TrapRule()


class Watch(NamedTuple):
    """What has happened since the robot last got on.

    Attributes:
        best: smallest distance to the goal so far [m].
        x, y: where it got on last [m].
        time: since then [s].
        sum_x, sum_y: integral of its place over that time [m s].
    """

    best: Real
    x: Real
    y: Real
    time: Real = 0.0
    sum_x: Real = 0.0
    sum_y: Real = 0.0

    def after(self, pose: Pose, to_goal: Real, dt: Real, reach: Real, xp: Any) -> "Watch":
        """The watch a control period later; ``reach`` is the range of the field [m]."""
        closer = to_goal < self.best - TRAP.progress
        on = closer | (xp.hypot(pose.x - self.x, pose.y - self.y) > TRAP.around * reach)
        return Watch(
            best=xp.where(closer, to_goal, self.best),
            x=xp.where(on, pose.x, self.x),
            y=xp.where(on, pose.y, self.y),
            time=xp.where(on, 0.0, self.time + dt),
            sum_x=xp.where(on, 0.0, self.sum_x + pose.x * dt),
            sum_y=xp.where(on, 0.0, self.sum_y + pose.y * dt),
        )

    @property
    def held(self) -> Any:
        """Whether it has got nowhere for too long."""
        return self.time >= TRAP.time

    def middle(self, xp: Any) -> tuple[Real, Real]:
        """The mean place since it last got on [m]."""
        time = xp.maximum(self.time, 1e-9)
        return self.sum_x / time, self.sum_y / time

    def again(self, pose: Pose, xp: Any) -> "Watch":
        """A watch that begins here and keeps what was best."""
        return Watch(self.best, pose.x, pose.y)


def is_pushed(pose: Pose, scene: Scene, t: Real, field: PotentialField, xp: Any) -> Any:
    """Whether anything repels at a place."""
    acting = acting_points(scene, pose.x, pose.y, t, xp)
    fx, fy = total_force(pose.x, pose.y, scene.goal, acting, field, xp)
    ax, ay = attractive_force(pose.x, pose.y, scene.goal, field, xp)
    return (fx != ax) | (fy != ay)


def hold_at(field: PotentialField, scene: Scene, t: Real, x: Real, y: Real, xp: Any) -> Real:
    """What holds a robot that goes to and fro about a place, as a number of :class:`Hold`."""
    fx, fy = total_force(x, y, scene.goal, acting_points(scene, x, y, t, xp), field, xp)
    pull = xp.hypot(*attractive_force(x, y, scene.goal, field, xp))
    cancels = xp.hypot(fx, fy) < TRAP.cancels * pull
    return xp.where(cancels, int(Hold.LOCAL_MINIMUM), int(Hold.OSCILLATION))


def hold_of(field: PotentialField, scene: Scene, t: Array, x: Array, y: Array) -> Hold:
    """What held a robot that was at these places and got nowhere.

    Args:
        field: its law.
        scene: what it was about; its goal is the place that it was driving to.
        t, x, y: instants [s] and places [m], (N,) each.
    """
    if not np.any(is_pushed(Pose(x, y, 0.0), scene, t, field, np)):
        return Hold.NOTHING
    return Hold(int(hold_at(field, scene, float(t[-1]), float(x.mean()), float(y.mean()), np)))
