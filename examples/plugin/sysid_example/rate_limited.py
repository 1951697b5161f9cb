"""A controller whose commands change slowly, for drives that trip on sudden ones."""

from typing import Any

from sysid.robot.mission.contracts import Command, ControlInputs, Scene
from sysid.robot.mission.settings import ControlSettings, Gain, Positive
from sysid.robot.mission.traits import ControlAdvice
from sysid.vehicle.kinematics import Real, wrap_angle


class RateLimited(ControlSettings):
    """Feed-forward and P on the speed, P on the yaw, both limited in their rate of change.

    Its state is the last command.

    Attributes:
        full_speed: forward speed at full drive [m/s], for the feed-forward.
        kp_speed: P on the forward speed [drive per m/s].
        kp_yaw: P on the yaw [drive per rad].
        rate: largest change of a command [drive per s].
    """

    full_speed: Positive = 0.43
    kp_speed: Gain = 1.0
    kp_yaw: Gain = 0.4
    rate: Positive = 1.0

    @property
    def advice(self) -> ControlAdvice:
        """The keys to change."""
        return ControlAdvice(stronger="raise kp_speed or kp_yaw", steer="raise kp_yaw or rate")

    def start(self, scene: Scene, xp: Any) -> Command:
        """No command yet."""
        return Command(0.0, 0.0)

    def step(
        self, state: Command, inputs: ControlInputs, dt: Real, xp: Any
    ) -> tuple[Command, Command]:
        """The commands wanted, as far as the rate allows."""
        wanted, seen = inputs.references, inputs.estimate
        v = wanted.speed / self.full_speed + self.kp_speed * (wanted.speed - seen.speed)
        psi = self.kp_yaw * wrap_angle(wanted.psi - seen.pose.psi)
        most = self.rate * dt
        command = Command(
            v_cmd=xp.clip(xp.clip(v, 0.0, 1.0), state.v_cmd - most, state.v_cmd + most),
            psi_cmd=xp.clip(xp.clip(psi, -0.3, 0.3), state.psi_cmd - most, state.psi_cmd + most),
        )
        return command, command
