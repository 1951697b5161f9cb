"""An accelerometer of two axes in the plane."""

from typing import Any, ClassVar

from sysid.mission.contracts import Scene, SensorInputs
from sysid.mission.sensors.imperfect import AT_ONCE, AboveZero, ImperfectSensor, NotNegative, Reals
from sysid.mission.settings import Positive
from sysid.vehicle.kinematics import Real

_G = 9.80665
"""Standard gravity [m/s²]."""


class Accelerometer(ImperfectSensor):
    """Reads the acceleration of the body, ``acc_x`` forward and ``acc_y`` to the left [m/s²].

    a_x is the mean of V̇ since the last instant, so that readings times intervals add up to V;
    a_y = V·ψ̇ is that of the instant (thesis 2.9 for a point that does not slide sideways). Gravity
    is not in it: a tilt is a bias.

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
        """The speed at this sample and at the last instant [m/s]: at rest."""
        return 0.0, 0.0

    def measure(
        self, own: Reals, inputs: SensorInputs, since: Real, dt: Real, xp: Any
    ) -> tuple[Reals, Reals]:
        """V̇ and V·ψ̇; none at t = 0."""
        speed, before = inputs.body.speed, own[1]
        forward = xp.where(since > 0, (speed - before) / xp.maximum(since, AT_ONCE), 0.0)
        return (speed, before), (forward, speed * inputs.body.yaw_rate)

    def read(
        self, own: Reals, measured: Reals, since: Real, now: Real, arrives: Real, xp: Any
    ) -> tuple[Reals, Reals]:
        """The readings; the speed is kept at an instant."""
        speed, before = own
        return (speed, xp.where(now, speed, before)), measured
