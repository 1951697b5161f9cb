"""Odometry: dead reckoning from the wheel speeds."""

from typing import Any

from sysid.mission.contracts import Body, NavigationInputs, Scene
from sysid.mission.motion.kinematic import moved
from sysid.mission.settings import Positive, Settings
from sysid.vehicle.kinematics import Geometry, Real


class Odometry(Settings):
    """Dead reckoning by the kinematics (thesis 6.2.2): V_x and ψ̇ of (2.13), integrated.

    Its state is the last estimate.

    Attributes:
        r, B: lengths that odometry believes [m]; the vehicle's unless given.
    """

    r: Positive | None = None
    B: Positive | None = None

    def start(self, scene: Scene, xp: Any) -> Body:
        """At rest in the start pose, which is known."""
        return Body(scene.start, 0.0, 0.0)

    def step(self, state: Body, inputs: NavigationInputs, dt: Real, xp: Any) -> tuple[Body, Body]:
        """The estimate ``dt`` seconds later."""
        geometry = inputs.scene.geometry
        if self.r is not None or self.B is not None:
            geometry = Geometry(self.r or geometry.r, self.B or geometry.B)
        readings = inputs.readings
        estimate = moved(state, readings["omega_l"], readings["omega_r"], geometry, dt, xp)
        return estimate, estimate
