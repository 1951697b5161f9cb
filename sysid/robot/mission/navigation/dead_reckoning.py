"""Navigation without a filter: by the wheels, with a compass, and by inertia."""

from typing import Any, ClassVar, NamedTuple

from sysid.robot.mission.contracts import Body, NavigationInputs, Pose, Scene
from sysid.robot.mission.motion.kinematic import moved
from sysid.robot.mission.settings import Positive, Settings
from sysid.vehicle.kinematics import Geometry, Real, body_velocity, step_pose, wrap_angle


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
        at_rest = Body(scene.start, 0.0, 0.0)
        counted = any("omega_l" in sensor.names for sensor in scene.sensors.values())
        return Reckoned(at_rest, 0.0) if counted else at_rest

    def step(
        self, state: Body | Reckoned, inputs: NavigationInputs, dt: Real, xp: Any
    ) -> tuple[Body | Reckoned, Body]:
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
        return Body(scene.start, 0.0, 0.0)

    def step(self, state: Body, inputs: NavigationInputs, dt: Real, xp: Any) -> tuple[Body, Body]:
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
