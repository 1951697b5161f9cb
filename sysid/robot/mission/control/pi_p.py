"""PI on the forward speed, P on the yaw."""

from typing import Annotated, Any

import numpy as np
from pydantic import Field

from sysid.robot.mission.contracts import Command, ControlInputs, Scene
from sysid.robot.mission.control.linear import conditional
from sysid.robot.mission.settings import ControlSettings, Gain, Search
from sysid.robot.mission.traits import ControlAdvice
from sysid.vehicle.kinematics import Real, wrap_angle


class SpeedPIYawP(ControlSettings):
    """Gains and limits of the thesis's controller (6.1, 6.2); its state is the PI's integral.

    Attributes:
        kp_speed, ki_speed: PI on the forward speed [drive per m/s, drive per m].
        kp_yaw: P on the yaw [drive per rad].
        v_cmd_min, v_cmd_max: limits of the speed command [drive, 1 is full].
        psi_cmd_max: limit of the yaw command either way [drive].
        period: time between two commands [s].
    """

    kp_speed: Annotated[Gain, Search(0.1, 10.0)] = 2.0
    ki_speed: Annotated[Gain, Search(0.0, 10.0)] = 1.85
    kp_yaw: Annotated[Gain, Search(0.05, 2.0)] = 0.4
    v_cmd_min: Annotated[float, Field(ge=-1, le=0)] = 0.0
    v_cmd_max: Annotated[float, Field(gt=0, le=1)] = 1.0
    psi_cmd_max: Annotated[float, Field(gt=0, le=1)] = 0.3

    @property
    def advice(self) -> ControlAdvice:
        return ControlAdvice(stronger="raise kp_speed or kp_yaw", steer="raise kp_yaw")

    def start(self, scene: Scene, xp: Any) -> Real:
        """The integral [drive]: nothing yet."""
        return 0.0

    def step(self, state: Real, inputs: ControlInputs, dt: Real, xp: Any) -> tuple[Real, Command]:
        references, estimate = inputs.references, inputs.estimate
        v_cmd, integral = self.speed_command(references.speed - estimate.speed, state, dt, xp)
        return integral, Command(v_cmd, self.yaw_command(references.psi, estimate.pose.psi, xp))

    def speed_command(
        self, error: Real, integral: Real, period: Real, xp: Any = np
    ) -> tuple[Real, Real]:
        """Return V_cmd [drive] of a PI in parallel form, and its new integral.

        V_cmd = sat(K_p e + I),  I ← I + K_i e T     (thesis 4.32, 6.1)

        Anti-windup by conditional integration. (Back-calculation would add a gain that the thesis
        does not have.)

        Args:
            error: e = V_ref − V_x [m/s].
            integral: I before this sample [drive].
            period: T [s].
        """
        grown = integral + self.ki_speed * error * period
        command = self.kp_speed * error + grown
        kept = conditional(grown, integral, command, (self.v_cmd_min, self.v_cmd_max), xp)
        return xp.clip(command, self.v_cmd_min, self.v_cmd_max), kept

    def yaw_command(self, psi_ref: Real, psi: Real, xp: Any = np) -> Real:
        """Return ψ_cmd = sat(K_pψ e) [drive], e = ψ_ref − ψ wrapped to (−π, π] (thesis 6.2)."""
        command = self.kp_yaw * wrap_angle(psi_ref - psi)
        return xp.clip(command, -self.psi_cmd_max, self.psi_cmd_max)
