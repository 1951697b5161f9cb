"""Motion by the kinematics alone: tracks that roll, no inertia, no forces."""

from typing import Any

from sysid.robot.mission.contracts import Body, MotionInputs, Pose, Scene
from sysid.robot.mission.settings import Settings
from sysid.vehicle.kinematics import Geometry, Real, body_velocity, step_pose


def carried(
    body: Body, speed: Real, yaw_rate: Real, dt: Real, xp: Any, lateral: Real | None = None
) -> Body:
    """Move a body on to the next sample, where it has another speed and yaw rate.

    Between two samples the speeds are taken as constant at the mean of both (trapezoidal rule), and
    the pose moves along the exact arc of these speeds (thesis 2.14).

    Args:
        body: at the sample before.
        speed: V_x at the new sample [m/s].
        yaw_rate: ψ̇ there [rad/s].
        dt: time between the samples [s].
        lateral: V_y there [m/s]; None for tracks that do not slide sideways.
    """
    forward, turning = 0.5 * (body.speed + speed), 0.5 * (body.yaw_rate + yaw_rate)
    if lateral is None:
        return Body(Pose(*step_pose(*body.pose, forward, turning, dt, xp=xp)), speed, yaw_rate)
    aside = 0.5 * (body.lateral + lateral)
    pose = Pose(*step_pose(*body.pose, forward, turning, dt, xp, aside))
    return Body(pose, speed, yaw_rate, lateral)


def moved(body: Body, omega_l: Real, omega_r: Real, geometry: Geometry, dt: Real, xp: Any) -> Body:
    """Move a body on to the next sample, where the tracks turn at ``omega_l``, ``omega_r``.

    Args:
        body: at the sample before.
        omega_l, omega_r: track speeds at the new sample [rad/s].
        dt: time between the samples [s].
    """
    return carried(body, *body_velocity(omega_l, omega_r, geometry), dt, xp)


class Kinematic(Settings):
    """The vehicle moves as its tracks roll (thesis 2.14); its state is where it was."""

    def start(self, scene: Scene, xp: Any) -> Body:
        return Body(scene.start, 0.0, 0.0)

    def step(self, state: Body, inputs: MotionInputs, dt: Real, xp: Any) -> tuple[Body, Body]:
        rolled = body_velocity(inputs.omega_l, inputs.omega_r, inputs.scene.geometry)
        body = carried(state, *rolled, dt, xp, inputs.lateral)
        return body, body
