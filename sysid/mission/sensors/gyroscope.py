"""A rate gyroscope."""

from typing import Annotated, Any

from pydantic import Field

from sysid.mission.contracts import Scene, SensorInputs
from sysid.mission.settings import Settings
from sysid.vehicle.kinematics import Real


class Gyroscope(Settings):
    """Reads the yaw rate with white noise: σ = noise·√rate.

    Attributes:
        noise: density [rad/s/√Hz].
    """

    noise: Annotated[float, Field(ge=0, le=1e3)] = 1e-3

    @property
    def names(self) -> tuple[str, ...]:
        """``gyro_z`` [rad/s]."""
        return ("gyro_z",)

    @property
    def draws(self) -> int:
        """One number a sample."""
        return 1

    def start(self, scene: Scene, xp: Any) -> tuple[()]:
        """Nothing is remembered."""
        return ()

    def step(
        self, state: tuple[()], inputs: SensorInputs, dt: Real, xp: Any
    ) -> tuple[tuple[()], tuple[Real, ...]]:
        """The reading; nothing at t = 0."""
        noise = self.noise / xp.sqrt(xp.maximum(dt, 1e-9)) * inputs.draws[0]
        return (), (xp.where(dt > 0, inputs.body.yaw_rate + noise, xp.nan),)
