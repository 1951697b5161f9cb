"""Guidance along the straight line from start to goal, whatever stands on it."""

import math
from typing import Any

from sysid.robot.mission.contracts import GuidanceInputs, References, Scene, State
from sysid.robot.mission.settings import GuidanceSettings, Positive
from sysid.robot.mission.traits import GuidanceAdvice
from sysid.vehicle.kinematics import Real, wrap_angle


class LineOfSight(GuidanceSettings):
    """Steer to a point of the line that lies ahead; the speed falls within ``slow`` of the goal.

    ψ_ref = ψ_line − atan(e/ahead), e the distance to the left of the line;
    V_ref = v_max·min(1, ρ/slow)     (Fossen 2011, lookahead-based steering)

    Attributes:
        v_max: largest speed reference [m/s].
        ahead: distance of the point on the line [m].
        slow: distance to the goal within which the speed falls [m].
    """

    v_max: Positive = 0.3
    ahead: Positive = 0.4
    slow: Positive = 0.5

    @property
    def advice(self) -> GuidanceAdvice:
        """The keys to change."""
        return GuidanceAdvice(
            faster="raise v_max",
            slower="lower v_max",
            wider="take a law that keeps clear of obstacles, such as field",
        )

    def start(self, scene: Scene, xp: Any) -> State:
        """The direction of the line [rad]; it stays the same."""
        x, y = scene.goal
        return xp.arctan2(y - scene.start.y, x - scene.start.x)

    def step(
        self, state: Real, inputs: GuidanceInputs, dt: Real, xp: Any
    ) -> tuple[State, References]:
        """References at the estimated pose."""
        scene, pose = inputs.scene, inputs.estimate.pose
        dx, dy = pose.x - scene.start.x, pose.y - scene.start.y
        left_of_line = dy * xp.cos(state) - dx * xp.sin(state)
        rho = scene.to_goal(pose, xp)
        psi = wrap_angle(state - xp.arctan2(left_of_line, self.ahead))
        # Beside the line the goal may lie behind: then drive slowly until the heading is right.
        off_course = abs(wrap_angle(psi - pose.psi)) > 0.5 * math.pi
        speed = xp.where(off_course, 0.0, self.v_max * xp.minimum(1.0, rho / self.slow))
        return state, References(speed, psi, arrived=rho <= scene.tolerance)
