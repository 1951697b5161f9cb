"""Inertial navigation: accelerometer and gyroscope integrated."""

from typing import Any, ClassVar, NamedTuple

from sysid.robot.mission.contracts import Body, NavigationInputs, Pose, Scene
from sysid.robot.mission.settings import Settings
from sysid.vehicle.kinematics import Real, step_pose


class InertialState(NamedTuple):
    """The last estimate, and the forward acceleration read last [m/s²]."""

    estimate: Body
    acceleration: Real


class Inertial(Settings):
    """V = ∫ a_x dt, ψ = ∫ ω_z dt from rest in the start pose, by the trapezoidal rule.

    A bias of the accelerometer grows into the speed as t and into the way as t²/2: alone it serves
    for seconds. Where a sensor reads nothing its last measurement is held. Measurements count at
    the sample where they arrive.
    """

    needs: ClassVar[tuple[str, ...]] = ("gyroscope", "accelerometer")

    def start(self, scene: Scene, xp: Any) -> InertialState:
        return InertialState(Body(scene.start, 0.0, 0.0), 0.0)

    def step(
        self, state: InertialState, inputs: NavigationInputs, dt: Real, xp: Any
    ) -> tuple[InertialState, Body]:
        """The estimate ``dt`` seconds later."""
        last, measurements = state.estimate, inputs.measurements
        acceleration = _read(measurements.get("acc_x", xp.nan), state.acceleration, xp)
        yaw_rate = _read(measurements.get("gyro_z", xp.nan), last.yaw_rate, xp)
        speed = last.speed + 0.5 * (state.acceleration + acceleration) * dt
        forward, turning = 0.5 * (last.speed + speed), 0.5 * (last.yaw_rate + yaw_rate)
        pose = Pose(*step_pose(*last.pose, forward, turning, dt, xp=xp))
        estimate = Body(pose, speed, yaw_rate)
        return InertialState(estimate, acceleration), estimate


def _read(value: Real, last: Real, xp: Any) -> Real:
    return xp.where(xp.isnan(value), last, value)
