"""Given references over time, to test a controller."""

from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from sysid.robot.mission.contracts import GuidanceInputs, Pose, References, Scene
from sysid.robot.mission.settings import GuidanceSettings
from sysid.robot.mission.traits import GuidanceTraits
from sysid.vehicle.kinematics import Real, wrap_angle

Instants = Annotated[
    tuple[tuple[Annotated[float, Field(ge=0, le=1e6)], float], ...],
    Field(strict=False, min_length=1),
]


class Steps(GuidanceSettings):
    """Holds given references of speed and yaw, each from its instant on; obstacles do not act.

    Attributes:
        speed: (t [s], V_ref [m/s]) in the order of time.
        yaw: (t [s], ψ_ref [rad]) in the order of time.
        until: the end of the run [s], which counts as arrival.
    """

    speed: Instants = ((0.0, 0.0),)
    yaw: Instants = ((0.0, 0.0),)
    until: Annotated[float, Field(gt=0, le=86_400)] = 10.0

    @field_validator("speed", "yaw", mode="before")
    @classmethod
    def _pairs(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple):
            return value
        return tuple(tuple(v) if isinstance(v, list) else v for v in value)

    @model_validator(mode="after")
    def _ordered(self) -> "Steps":
        for name in ("speed", "yaw"):
            instants = [t for t, _ in getattr(self, name)]
            if instants != sorted(set(instants)):
                raise ValueError(f"the instants of {name} must rise: write [[0, a], [5, b]]")
        return self

    @property
    def traits(self) -> GuidanceTraits:
        return GuidanceTraits(ends_at_goal=False)

    def start(self, scene: Scene, xp: Any) -> Real:
        """The time so far [s]."""
        return 0.0

    def step(
        self, state: Real, inputs: GuidanceInputs, dt: Real, xp: Any
    ) -> tuple[Real, References]:
        t = inputs.t
        speed, psi = self.speed[0][1], wrap_angle(self.yaw[0][1])
        for begin, value in self.speed[1:]:
            speed = xp.where(t >= begin, value, speed)
        for begin, value in self.yaw[1:]:
            psi = xp.where(t >= begin, wrap_angle(value), psi)
        return t + 0.0, References(speed + 0.0 * t, psi + 0.0 * t, t >= self.until)

    def to_go(self, state: Real, pose: Pose, scene: Scene, xp: Any) -> Real:
        """What is left of the time [s], which passes whatever the robot does."""
        return self.until - state
