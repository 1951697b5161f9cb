"""A controller of two laws, one for the forward speed and one for the yaw."""

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple, Self, cast

from pydantic import Field, ValidationInfo, field_validator

from sysid.robot.mission.axis import AxisInputs, AxisLaw, State
from sysid.robot.mission.contracts import Command, ControlInputs, Scene
from sysid.robot.mission.control.linear import PI, YawP
from sysid.robot.mission.settings import ControlSettings
from sysid.robot.mission.traits import ControlAdvice
from sysid.vehicle.kinematics import Real, wrap_angle

AXES = ("speed", "yaw")


class AxesState(NamedTuple):
    """What both axes remember.

    Attributes:
        moved: forward speed at the last instant [m/s].
        asked: V_ref [m/s] and ψ_ref [rad] of the last instant.
    """

    speed: State
    yaw: State
    moved: Real
    asked: tuple[Real, Real]
    begun: Real


class AxisController(ControlSettings):
    """Speed and yaw each by a law of its own, within common limits.

    Attributes:
        speed: law from the speed error to V_cmd.
        yaw: law from the yaw error to ψ_cmd.
        v_cmd_min, v_cmd_max: limits of the speed command [drive, 1 is full].
        psi_cmd_max: limit of the yaw command either way [drive].
        period: time between two commands [s].
    """

    speed: AxisLaw = PI()
    yaw: AxisLaw = YawP()
    v_cmd_min: Annotated[float, Field(ge=-1, le=0)] = 0.0
    v_cmd_max: Annotated[float, Field(gt=0, le=1)] = 1.0
    psi_cmd_max: Annotated[float, Field(gt=0, le=1)] = 0.3

    @field_validator(*AXES, mode="plain")
    @classmethod
    def _law(cls, value: Any, info: ValidationInfo) -> AxisLaw:
        """A law as it is, or a section of a mission file, read by who reads the file."""
        if not isinstance(value, AxisLaw):
            if info.context is None:
                raise ValueError(f"{info.field_name} is {value!r}: give a law of one axis")
            value = info.context["law"](f"control.{info.field_name}", value)
        return cast(AxisLaw, value)

    @property
    def advice(self) -> ControlAdvice:
        first_gains = {axis: next(iter(getattr(self, axis).gains), "") for axis in AXES}
        keys = [f"{axis}.{key}" for axis, key in first_gains.items() if key]
        steer = f"raise yaw.{first_gains['yaw']}" if first_gains["yaw"] else ""
        return ControlAdvice(stronger=f"raise {' or '.join(keys)}" if keys else "", steer=steer)

    @property
    def uses_plant(self) -> bool:
        return bool(self.speed.uses_plant or self.yaw.uses_plant)

    @property
    def gains(self) -> Mapping[str, tuple[float, float]]:
        """Those of both axes, as ``speed.kp``."""
        return {
            f"{axis}.{key}": bounds
            for axis in AXES
            for key, bounds in getattr(self, axis).gains.items()
        }

    def with_gains(self, values: Mapping[str, Real]) -> Self:
        """The same laws with other gains, named as ``speed.kp``."""
        changed = {}
        for axis in AXES:
            axis_gains = {
                k.partition(".")[2]: v for k, v in values.items() if k.startswith(f"{axis}.")
            }
            changed[axis] = getattr(self, axis).with_gains(axis_gains)
        return self.model_copy(update=changed)

    def start(self, scene: Scene, xp: Any) -> AxesState:
        begun = self.speed.start(scene, xp), self.yaw.start(scene, xp)
        return AxesState(*begun, 0.0, (0.0, scene.start.psi), 0.0)

    def step(
        self, state: AxesState, inputs: ControlInputs, dt: Real, xp: Any
    ) -> tuple[AxesState, Command]:
        wanted, seen, nominal = inputs.references, inputs.estimate, inputs.scene.nominal
        per_time = state.begun / dt
        before, heading = state.asked
        along = AxisInputs(
            t=inputs.t,
            error=wanted.speed - seen.speed,
            rate=(seen.speed - state.moved) * per_time,
            wanted=wanted.speed,
            wanted_rate=(wanted.speed - before) * per_time,
            motion=seen.speed,
            low=self.v_cmd_min,
            high=self.v_cmd_max,
            applied=inputs.applied.v_cmd,
            plant=nominal.speed,
        )
        around = AxisInputs(
            t=inputs.t,
            error=wrap_angle(wanted.psi - seen.pose.psi),
            rate=seen.yaw_rate,
            wanted=wrap_angle(wanted.psi - heading) * per_time,
            wanted_rate=0.0 * wanted.psi,
            motion=seen.yaw_rate,
            low=-self.psi_cmd_max,
            high=self.psi_cmd_max,
            applied=inputs.applied.psi_cmd,
            plant=nominal.yaw,
        )
        speed, v_cmd = self.speed.step(state.speed, along, dt, xp)
        yaw, psi_cmd = self.yaw.step(state.yaw, around, dt, xp)
        after = AxesState(speed, yaw, seen.speed, (wanted.speed, wanted.psi), 1.0)
        return after, Command(v_cmd, psi_cmd)
