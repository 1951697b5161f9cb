"""Dead reckoning with the heading of a magnetometer."""

from typing import Any, ClassVar

from sysid.robot.mission.contracts import Body, NavigationInputs, Pose, Scene
from sysid.robot.mission.motion.kinematic import moved
from sysid.robot.mission.settings import Settings
from sysid.vehicle.kinematics import Real, step_pose, wrap_angle


def compass_heading(mag_x: Real, mag_y: Real, xp: Any) -> Real:
    """ψ − north = atan2(−m_y, m_x) [rad] (thesis 4.3, with atan2).

    Args:
        mag_x, mag_y: the field forward and to the left, in any one unit.
    """
    return xp.arctan2(-mag_y, mag_x)


class Compass(Settings):
    """The way from the wheels, the heading from the magnetometer; its state is the last estimate.

    Where the magnetometer reads nothing, the heading turns on as the wheels say.
    """

    needs: ClassVar[tuple[str, ...]] = ("magnetometer",)
    default_sensors: ClassVar[tuple[str, ...]] = ("encoders", "magnetometer")

    def start(self, scene: Scene, xp: Any) -> Body:
        """At rest in the start pose, which is known."""
        return Body(scene.start, 0.0, 0.0)

    def step(self, state: Body, inputs: NavigationInputs, dt: Real, xp: Any) -> tuple[Body, Body]:
        """The estimate ``dt`` seconds later."""
        measurements = inputs.measurements
        left, right = measurements["omega_l"], measurements["omega_r"]
        rolled = moved(state, left, right, inputs.scene.geometry, dt, xp)
        north = getattr(inputs.scene.sensors.get("magnetometer"), "north", 0.0)
        seen = north + compass_heading(
            measurements.get("mag_x", xp.nan), measurements.get("mag_y", xp.nan), xp
        )
        psi = xp.where(xp.isnan(seen), rolled.pose.psi, wrap_angle(seen))
        # An arc whose chord points half-way between both headings.
        turned = wrap_angle(psi - state.pose.psi)
        forward = 0.5 * (state.speed + rolled.speed)
        x, y, _ = step_pose(*state.pose[:2], state.pose.psi, forward * dt, turned, 1.0, xp=xp)
        estimate = Body(Pose(x, y, psi), rolled.speed, rolled.yaw_rate)
        return estimate, estimate
