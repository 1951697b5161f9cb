"""A rate gyroscope."""

import math
from typing import Any, ClassVar

from sysid.robot.mission.contracts import SensorInputs, State
from sysid.robot.mission.sensors.imperfect import (
    AboveZero,
    ImperfectSensor,
    NotNegative,
    Reals,
)
from sysid.robot.mission.settings import Positive
from sysid.vehicle.kinematics import Real

_DEGREE = math.pi / 180.0


class Gyroscope(ImperfectSensor):
    """Reads the yaw rate ψ̇ [rad/s].

    Noise, range and resolution are those of the MPU-9250 (data sheet PS-MPU-9250A-01, §3.1: 0.01
    °/s/√Hz, ±250 °/s in 16 bit); the bias walks as in the EuRoC records (Burri et al. 2016: 1.9e-5
    rad/s/√s). A bias of 0.1 °/s, the sheet's total noise, is left of the sheet's 5 °/s after
    averaging at rest.
    """

    measured: ClassVar[tuple[str, ...]] = ("gyro_z",)

    rate: Positive = 100.0
    noise: NotNegative = (0.01 * _DEGREE,)
    bias_std: NotNegative = (0.1 * _DEGREE,)
    bias_walk: NotNegative = (1.9e-5,)
    saturation: AboveZero | None = (250.0 * _DEGREE,)
    resolution: NotNegative = (250.0 * _DEGREE / 2**15,)

    def measure(
        self, memory: State, inputs: SensorInputs, since: Real, dt: Real, xp: Any
    ) -> tuple[State, Reals]:
        """ψ̇ at this sample."""
        return memory, (inputs.body.yaw_rate,)
