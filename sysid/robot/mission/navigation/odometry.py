"""Odometry: dead reckoning from the wheel speeds."""

from typing import Any, NamedTuple

from sysid.robot.mission.contracts import Body, NavigationInputs, Pose, Scene
from sysid.robot.mission.motion.kinematic import moved
from sysid.robot.mission.settings import Positive, Settings
from sysid.vehicle.kinematics import Geometry, Real, body_velocity, step_pose


class Reckoned(NamedTuple):
    """The last estimate, and for how long no encoder has been read [s]."""

    estimate: Body
    waited: Real


class Odometry(Settings):
    """Dead reckoning by the kinematics (thesis 6.2.2): V_x and ψ̇ of (2.13), integrated.

    Speeds that are known exactly are those of the instant, and vary linearly in between; its state
    is the last estimate. Encoders give the mean since their last measurement, and the pose moves on
    by it when it comes.

    Attributes:
        r, B: lengths that odometry assumes [m]; the vehicle's unless given.
    """

    r: Positive | None = None
    B: Positive | None = None

    def start(self, scene: Scene, xp: Any) -> Body | Reckoned:
        """At rest in the start pose, which is known."""
        at_rest = Body(scene.start, 0.0, 0.0)
        counted = any("omega_l" in sensor.names for sensor in scene.sensors.values())
        return Reckoned(at_rest, 0.0) if counted else at_rest

    def step(
        self, state: Body | Reckoned, inputs: NavigationInputs, dt: Real, xp: Any
    ) -> tuple[Body | Reckoned, Body]:
        """The estimate ``dt`` seconds later."""
        geometry = inputs.scene.geometry
        if self.r is not None or self.B is not None:
            geometry = Geometry(self.r or geometry.r, self.B or geometry.B)
        measurements = inputs.measurements
        omega_l, omega_r = measurements["omega_l"], measurements["omega_r"]
        if isinstance(state, Reckoned):
            after = _counted(state, omega_l, omega_r, geometry, dt, xp)
            return after, after.estimate
        estimate = moved(state, omega_l, omega_r, geometry, dt, xp)
        return estimate, estimate


def _counted(
    state: Reckoned, omega_l: Real, omega_r: Real, geometry: Geometry, dt: Real, xp: Any
) -> Reckoned:
    """Moved on by the mean speeds since the last measurement, if there is one."""
    came = xp.logical_not(xp.isnan(omega_l + omega_r))
    last, waited = state.estimate, state.waited + dt
    speed, yaw_rate = body_velocity(omega_l, omega_r, geometry)
    speed, yaw_rate = (
        xp.where(came, new, old) for new, old in ((speed, last.speed), (yaw_rate, last.yaw_rate))
    )
    time = xp.where(came, waited, 0.0)
    pose = Pose(*step_pose(*last.pose, speed, yaw_rate, time, xp=xp))
    return Reckoned(Body(pose, speed, yaw_rate), waited - time)
