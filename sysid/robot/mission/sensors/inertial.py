"""A rate gyroscope, and an accelerometer of two axes in the plane."""

import math
from typing import Any, ClassVar

from sysid.robot.mission.contracts import Scene, SensorInputs, State
from sysid.robot.mission.sensors.imperfect import (
    AT_ONCE,
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


_G = 9.80665
"""Standard gravity [m/s²]."""


class Accelerometer(ImperfectSensor):
    """Reads the acceleration of the body, ``acc_x`` forward and ``acc_y`` to the left [m/s²].

    a_x is the mean of V̇_x since the last instant less V_yψ̇ of the instant: without V_y,
    measurements times intervals add up to V. a_y is V_xψ̇ of the instant and the mean of V̇_y
    (thesis 2.9 for the middle of the vehicle). Gravity is not in it: a tilt is a bias.

    Noise, range and resolution are those of the MPU-9250 (data sheet PS-MPU-9250A-01, §3.2: 300
    µg/√Hz, ±2 g in 16 bit); the bias walks as in the EuRoC records (Burri et al. 2016: 3e-3
    m/s²/√s). A bias of 8 mg, the sheet's total noise, is left of the sheet's 60 mg after averaging
    at rest.
    """

    measured: ClassVar[tuple[str, ...]] = ("acc_x", "acc_y")

    rate: Positive = 100.0
    noise: NotNegative = (300e-6 * _G,)
    bias_std: NotNegative = (8e-3 * _G,)
    bias_walk: NotNegative = (3e-3,)
    saturation: AboveZero | None = (2.0 * _G,)
    resolution: NotNegative = (2.0 * _G / 2**15,)

    def begin(self, scene: Scene, xp: Any) -> Reals:
        """V_x, V_y at this sample and at the last instant [m/s]: at rest."""
        return 0.0, 0.0, 0.0, 0.0

    def measure(
        self, memory: Reals, inputs: SensorInputs, since: Real, dt: Real, xp: Any
    ) -> tuple[Reals, Reals]:
        """V̇_x − V_yψ̇ and V_xψ̇ + V̇_y; no changes at t = 0."""
        body, (_, _, speed, lateral) = inputs.body, memory
        time, passed = xp.maximum(since, AT_ONCE), since > 0
        forward = xp.where(passed, (body.speed - speed) / time, 0.0)
        aside = xp.where(passed, (body.lateral - lateral) / time, 0.0)
        return (body.speed, body.lateral, speed, lateral), (
            forward - body.lateral * body.yaw_rate,
            aside + body.speed * body.yaw_rate,
        )

    def read(
        self, memory: Reals, measured: Reals, since: Real, now: Real, arrives: Real, xp: Any
    ) -> tuple[Reals, Reals]:
        """The measurements; the speeds are kept at an instant."""
        speed, lateral, before, lateral_before = memory
        kept = xp.where(now, speed, before), xp.where(now, lateral, lateral_before)
        return (speed, lateral, *kept), measured
