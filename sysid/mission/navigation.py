"""Navigation: from what the sensors read to where the robot thinks it is."""

import math
from dataclasses import dataclass, field
from typing import Protocol

from sysid.vehicle.kinematics import Geometry, body_velocity, step_pose


@dataclass(frozen=True)
class Estimate:
    """Where the robot thinks it is and how it moves.

    Attributes:
        pose: X [m], Y [m], ψ [rad], ψ in (−π, π].
        speed: forward speed V_x [m/s].
        yaw_rate: ψ̇ [rad/s].
    """

    pose: tuple[float, float, float]
    speed: float = 0.0
    yaw_rate: float = 0.0


class Navigation(Protocol):
    """An estimator of the pose from wheel speeds; a filter keeps what else it needs in its state.

    The simulator only ever calls these two and hands the returned value to the next ``update``,
    so an estimator may return a subclass of :class:`Estimate` that carries its covariance.
    """

    def start(self, pose: tuple[float, float, float], omega_l: float, omega_r: float) -> Estimate:
        """Return the estimate at t = 0, from a known pose and the first wheel speeds [rad/s]."""
        ...

    def update(self, estimate: Estimate, omega_l: float, omega_r: float, dt: float) -> Estimate:
        """Return the estimate ``dt`` seconds later, given the wheel speeds read there [rad/s]."""
        ...


@dataclass(frozen=True)
class Odometry:
    """Dead reckoning by the kinematics (thesis 6.2.2): V_x and ψ̇ of (2.13), integrated.

    Between two readings the speeds are taken as constant at the mean of both (trapezoidal rule),
    and the pose moves along the exact arc of these speeds.

    Attributes:
        geometry: lengths of the vehicle.
    """

    geometry: Geometry = field(default_factory=Geometry)

    def start(self, pose: tuple[float, float, float], omega_l: float, omega_r: float) -> Estimate:
        """Return the estimate at t = 0."""
        return Estimate(pose, *body_velocity(omega_l, omega_r, self.geometry))

    def update(self, estimate: Estimate, omega_l: float, omega_r: float, dt: float) -> Estimate:
        """Return the estimate ``dt`` seconds later."""
        speed, yaw_rate = body_velocity(omega_l, omega_r, self.geometry)
        pose = step_pose(
            *estimate.pose,
            0.5 * (estimate.speed + speed),
            0.5 * (estimate.yaw_rate + yaw_rate),
            dt,
            xp=math,
        )
        return Estimate(pose, speed, yaw_rate)
