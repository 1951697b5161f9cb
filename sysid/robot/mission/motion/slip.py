"""Motion of slipping tracks without inertia: with given slip, or from the soil."""

from typing import Annotated, Any

from pydantic import Field, PlainValidator, model_validator

from sysid.data.yaml_files.source import shown
from sysid.robot.mission.contracts import Body, MotionInputs, Scene
from sysid.robot.mission.motion.kinematic import carried
from sysid.robot.mission.vehicle_spec import Physics
from sysid.vehicle.kinematics import Real
from sysid.vehicle.slip import balanced_velocity, slipping_velocity, turning_share

DRAGGED = -10.0
"""Slip of a track that is dragged ten times as far as it turns: more is a number in percent."""


def _shares(value: Any) -> tuple[float, float] | None:
    """i of the left and the right track: 1 spins on the spot, below 0 is dragged."""
    if value is None:
        return None
    pair = value if isinstance(value, list | tuple) else (value, value)
    numbers = all(type(v) in (int, float) and DRAGGED <= v <= 1.0 for v in pair)
    if len(pair) != 2 or not numbers:
        raise ValueError(
            f"motion.slip is {shown(value)}: write a share of at most 1, or [left, right]"
        )
    return float(pair[0]), float(pair[1])


class Slip(Physics):
    """Tracks lose a share of their speed on the ground (thesis 2.24–2.26); x_ICR = 0.

    Without ``slip`` and ``turning`` the shares are those at which thrust, rolling resistance and
    turning resistance of the soil balance, at every sample; otherwise i = slip + turning·|ω_R −
    ω_L|/(|ω_L| + |ω_R|).

    Attributes:
        slip: share that each track loses, or of the left and the right one.
        turning: share that both lose besides where the vehicle turns on the spot.
    """

    slip: Annotated[tuple[float, float] | None, PlainValidator(_shares)] = None
    turning: Annotated[float, Field(ge=0, le=0.9)] | None = None

    @model_validator(mode="after")
    def _one_law(self) -> "Slip":
        if self._by_shares and (self.soil is not None or self.patches is not None):
            raise ValueError(
                "motion of kind slip has both slip shares and a soil; keep slip and turning, or "
                "soil and patches"
            )
        return self

    @property
    def _by_shares(self) -> bool:
        return self.slip is not None or self.turning is not None

    @property
    def wanted(self) -> tuple[str, ...]:
        return () if self._by_shares else ("soil", "mass", "L", "track_width")

    def start(self, scene: Scene, xp: Any) -> Body:
        return Body(scene.start, 0.0, 0.0)

    def step(self, state: Body, inputs: MotionInputs, dt: Real, xp: Any) -> tuple[Body, Body]:
        omega = inputs.omega_l, inputs.omega_r
        if self._by_shares:
            speed, yaw_rate = self._by_law(omega, inputs.scene, xp)
        else:
            car, floor = inputs.scene.car, inputs.scene.floor
            assert car is not None
            assert floor is not None
            speed, yaw_rate = balanced_velocity(omega, state.pose, car, floor, xp)
        body = carried(state, speed, yaw_rate, dt, xp, inputs.lateral)
        return body, body

    def _by_law(self, omega: tuple[Real, Real], scene: Scene, xp: Any) -> tuple[Real, Real]:
        given = self.slip or (0.0, 0.0)
        more = (self.turning or 0.0) * turning_share(omega, xp)
        slips = given[0] + more, given[1] + more
        speed, _, yaw_rate = slipping_velocity(omega, slips, scene.geometry)
        return speed, yaw_rate
