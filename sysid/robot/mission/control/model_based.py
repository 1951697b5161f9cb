"""Laws that invert the identified plant: computed torque and sliding mode.

Both work on the *motion* of an axis, τ v̇ = g d − v: the forward speed, or the yaw rate. The yaw is
a cascade: its error asks for a yaw rate, r = ψ̇_ref + K_ψ e, and the law makes the robot turn so.
"""

from abc import abstractmethod
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from sysid.robot.mission.axis import AxisInputs
from sysid.robot.mission.control.linear import conditional
from sysid.robot.mission.settings import AxisSettings, Gain, Search
from sysid.vehicle.kinematics import Real

AngleGain = Annotated[float, Field(gt=0, le=100)]
Rate = Annotated[float, Field(gt=0, le=1e3)]


class Target(NamedTuple):
    """Motion that a law has to reach, and its rate of change.

    Attributes:
        motion: r [m/s, rad/s].
        rate: ṙ [m/s², rad/s²].
    """

    motion: Real
    rate: Real


def target(law: AxisSettings, inputs: AxisInputs, xp: Any) -> Target:
    """r = v_ref + K_ψ e and ṙ = v̇_ref + K_ψ (v_ref − v).

    K_ψ [1/s] is the law's ``angle_gain``: 0 for the speed, which is a motion itself. What a jump of
    the reference asks for is cut at what the plant can do at its limits.
    """
    angle_gain = getattr(law, "angle_gain", 0.0)
    gain = inputs.plant.gain
    wanted = xp.clip(inputs.wanted, gain * inputs.low, gain * inputs.high)
    rate = inputs.wanted_rate + angle_gain * (wanted - inputs.motion)
    return Target(wanted + angle_gain * inputs.error, rate)


def sampled_lag(lag: Real, dt: Real, xp: Any) -> Real:
    """τ_T = T/(1 − e^{−T/τ}) [s]: v̇ T is reached within a period by d = (v + τ_T v̇)/g, held."""
    return dt / (1.0 - xp.exp(-dt / xp.maximum(lag, 1e-3 * dt)))


class ModelBased(AxisSettings):
    """Base: the state is the integral of r − v, which stands while the command is on a limit."""

    @property
    def uses_plant(self) -> bool:
        return True

    def start(self, scene: Any, xp: Any) -> Real:
        return 0.0

    @abstractmethod
    def command(self, asked: Target, integral: Real, inputs: AxisInputs, dt: Real, xp: Any) -> Real:
        """The command before its limits [drive]."""

    def step(self, state: Real, inputs: AxisInputs, dt: Real, xp: Any) -> tuple[Real, Real]:
        asked = target(self, inputs, xp)
        grown = state + (asked.motion - inputs.motion) * dt
        command = self.command(asked, grown, inputs, dt, xp)
        kept = conditional(grown, state, command, (inputs.low, inputs.high), xp)
        return kept, xp.clip(command, inputs.low, inputs.high)


class ComputedTorque(ModelBased):
    """d = (v + τ_T a)/g with a = ṙ + c (r − v) + K_i ∫(r − v).

    The plant's own answer is cancelled: what is left is v̇ = a, an error that decays with c.

    Attributes:
        bandwidth: c [1/s].
        ki: K_i [1/s²], for what the model of the plant lacks.

    Source: Siciliano et al., Robotics (2009), section 8.5.2 (inverse dynamics).
    """

    bandwidth: Annotated[Rate, Search(0.5, 10.0)] = 3.0
    ki: Annotated[Gain, Search(0.0, 10.0)] = 1.0

    def command(self, asked: Target, integral: Real, inputs: AxisInputs, dt: Real, xp: Any) -> Real:
        wanted = asked.rate + self.bandwidth * (asked.motion - inputs.motion) + self.ki * integral
        lag = sampled_lag(inputs.plant.lag, dt, xp)
        return (inputs.motion + lag * wanted) / inputs.plant.gain


class SlidingMode(ModelBased):
    """d = (v + τ_T (ṙ + λ (r − v)))/g + K sat(s/φ) with s = r − v + λ ∫(r − v).

    The first term keeps the plant on the surface s = 0, where the error decays with λ; the second
    brings it there whatever the model lacks, up to K. Within the boundary layer |s| < φ it is
    continuous, so that the command does not chatter.

    Attributes:
        slope: λ [1/s].
        reach: K [drive].
        boundary: φ [m/s, rad/s].

    Source: Slotine and Li, Applied Nonlinear Control (1991), sections 7.1 and 7.2.
    """

    slope: Annotated[Rate, Search(0.2, 5.0)] = 1.0
    reach: Annotated[Gain, Search(0.02, 1.0)] = 0.3
    boundary: Annotated[Rate, Search(0.02, 1.0)] = 0.1

    def command(self, asked: Target, integral: Real, inputs: AxisInputs, dt: Real, xp: Any) -> Real:
        """The command that stays on the surface, and the one that brings there."""
        error = asked.motion - inputs.motion
        surface = error + self.slope * integral
        lag = sampled_lag(inputs.plant.lag, dt, xp)
        stays = inputs.motion + lag * (asked.rate + self.slope * error)
        return stays / inputs.plant.gain + self.reach * xp.clip(surface / self.boundary, -1.0, 1.0)


class YawComputedTorque(ComputedTorque):
    """Computed torque of the yaw.

    Attributes:
        angle_gain: K_ψ, yaw rate asked for per yaw error [1/s].
    """

    angle_gain: Annotated[AngleGain, Search(0.5, 5.0)] = 2.0
    bandwidth: Annotated[Rate, Search(0.5, 10.0)] = 4.0


class YawSlidingMode(SlidingMode):
    """Sliding mode of the yaw.

    Attributes:
        angle_gain: K_ψ, yaw rate asked for per yaw error [1/s].
    """

    angle_gain: Annotated[AngleGain, Search(0.5, 5.0)] = 2.0
    reach: Annotated[Gain, Search(0.02, 0.5)] = 0.15
    boundary: Annotated[Rate, Search(0.1, 5.0)] = 1.0
