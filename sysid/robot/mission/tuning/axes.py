"""Step responses of speed and yaw rate for tuning."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.errors import ModelError
from sysid.robot.mission.contracts import SteppablePlant
from sysid.robot.mission.tracks.settling import Ending, settle
from sysid.vehicle.kinematics import Geometry, body_velocity


class Axis(StrEnum):
    """What is controlled."""

    SPEED = "speed"
    YAW = "yaw"


@dataclass(frozen=True)
class WorkingPoint:
    """Where and how a plant is asked.

    Attributes:
        drive: speed command around which the robot is looked at [drive]: half of full drive, away
            from dead zones and saturation alike.
        change: size of the step of either command [drive]: small beside the working point, far
            above rounding.
        settled: the answer counts as over when it stays within this share of its final value.
    """

    drive: float = 0.5
    change: float = 0.05
    settled: float = 1e-3


POINT = WorkingPoint()


@dataclass(frozen=True, eq=False)
class AxisAnswer:
    """The answer of one axis to a unit step of its command.

    Attributes:
        axis: which; of the yaw it is the yaw rate that answers, the yaw is its integral.
        dt: time between the values [s].
        step: answer k·dt after the step, (N,) [m/s or rad/s per full drive].
    """

    axis: Axis
    dt: float
    step: Array

    @property
    def gain(self) -> float:
        """Final value [m/s or rad/s per full drive]."""
        return float(self.step[-1])

    def sampled(self, period: float) -> "AxisAnswer":
        """The answer read once a control period; between samples of the plant it is held."""
        count = int(np.floor((len(self.step) - 1) * self.dt / period + 1e-9)) + 1
        index = np.floor(np.arange(count) * period / self.dt + 1e-9).astype(int)
        return AxisAnswer(self.axis, period, self.step[index])


def answer(plant: SteppablePlant, geometry: Geometry, axis: Axis) -> AxisAnswer:
    """The answer of an axis around half drive.

    A plant that is not linear has another answer elsewhere; this one is the slope at the working
    point, half the difference of a step up and a step down.

    Args:
        plant: a robot: PWM [µs] in, wheel speeds [rad/s] out.
    """
    centre = POINT.drive * PWM_FULL_SCALE * np.ones(2)
    direction = np.array([1.0, 1.0]) if axis is Axis.SPEED else np.array([-1.0, 1.0])
    rest = settle(plant, plant.initial_state(), centre)
    if rest.ending is not Ending.RESTS:
        raise ModelError(f"no controller can be tuned to this plant: {rest.ending.value}")
    change = POINT.change * PWM_FULL_SCALE * direction
    up, down = (settle(plant, rest.state, centre + s * change).response for s in (1.0, -1.0))
    count = min(len(up), len(down))
    omega = (up[:count] - down[:count]) / (2.0 * POINT.change)
    speed, yaw_rate = body_velocity(omega[:, 0], omega[:, 1], geometry)
    step = speed if axis is Axis.SPEED else yaw_rate
    if not abs(step[-1]) > 0:
        raise ModelError(f"no controller can be tuned: the plant's {axis.value} does not respond")
    return AxisAnswer(axis, plant.dt, _cut(step))


def _cut(step: Array) -> Array:
    """The answer up to where it has settled."""
    moving = np.abs(step - step[-1]) > POINT.settled * np.max(np.abs(step))
    last = int(np.flatnonzero(moving)[-1]) if moving.any() else 0
    return step[: min(len(step), 2 * last + 8)]
