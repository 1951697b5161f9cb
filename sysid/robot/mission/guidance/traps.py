"""Where a potential field holds a robot: noticed while it drives, and named (thesis 4.5)."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from sysid.robot.mission.contracts import Pose
from sysid.vehicle.kinematics import Real


@dataclass(frozen=True)
class TrapRule:
    """When a robot counts as held by its field.

    Attributes:
        progress: it came less than this [m] closer to the goal, as in a mission that is stuck, …
        around: … and no farther than this share of the field's range from where it was, …
        time: … in this time [s]: half of that after which a mission is stuck, so that a way out
            has begun by then.
    """

    progress: float = 0.05
    around: float = 0.5
    time: float = 5.0


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
    def trapped(self) -> Any:
        """Whether it has got nowhere for too long."""
        return self.time >= TRAP.time

    def middle(self, xp: Any) -> tuple[Real, Real]:
        """The mean place since it last got on [m]."""
        time = xp.maximum(self.time, 1e-9)
        return self.sum_x / time, self.sum_y / time

    def restarted(self, pose: Pose, xp: Any) -> "Watch":
        """A watch that begins here and keeps what was best."""
        return Watch(self.best, pose.x, pose.y)
