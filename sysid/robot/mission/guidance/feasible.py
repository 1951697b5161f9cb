"""Feasible references: limits and rates around any law of guidance."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from sysid.robot.mission.contracts import GuidanceInputs, Limits, Pose, References, Scene, State
from sysid.robot.mission.guidance.around_law import AroundLaw
from sysid.vehicle.kinematics import Real, wrap_angle

SAME = 1e-9
"""Angles that differ by less [rad] differ by rounding alone."""


class FeasibleState(NamedTuple):
    """The last references and what the law remembers.

    Attributes:
        law: the law's state.
        speed: last reference of speed [m/s].
        psi: last reference of yaw [rad].
        rate: at which that turned [rad/s].
    """

    law: State
    speed: Real
    psi: Real
    rate: Real


@dataclass(frozen=True)
class Feasible(AroundLaw):
    """A law whose references stay within ``scene.limits``.

    The reference of speed never exceeds the limit and changes no faster than the acceleration
    allows; that of yaw turns the short way, no faster than the yaw rate and its acceleration allow,
    and brakes in time.
    """

    def start(self, scene: Scene, xp: Any) -> FeasibleState:
        return FeasibleState(self.law.start(scene, xp), 0.0, scene.start.psi, 0.0)

    def step(
        self, state: FeasibleState, inputs: GuidanceInputs, dt: Real, xp: Any
    ) -> tuple[FeasibleState, References]:
        law, wanted = self.law.step(state.law, inputs, dt, xp)
        limits = inputs.scene.limits
        speed = xp.minimum(wanted.speed, limits.speed)
        if not math.isinf(limits.acceleration):
            step = limits.acceleration * dt
            speed = xp.clip(speed, state.speed - step, state.speed + step)
        if math.isinf(limits.yaw_rate) and math.isinf(limits.yaw_acceleration):
            return FeasibleState(law, speed, wanted.psi, 0.0), wanted._replace(speed=speed)
        rate = limited_rate(wrap_angle(wanted.psi - state.psi), state.rate, limits, dt, xp)
        psi = wrap_angle(state.psi + rate * dt)
        # What is within reach of this step is taken as it is, not through sums and wraps.
        psi = xp.where(abs(wrap_angle(wanted.psi - psi)) < SAME, wanted.psi, psi)
        return FeasibleState(law, speed, psi, rate), wanted._replace(speed=speed, psi=psi)

    def to_go(self, state: FeasibleState, pose: Pose, scene: Scene, xp: Any) -> Real:
        return self.law.to_go(state.law, pose, scene, xp)


def limited_rate(error: Real, last: Real, limits: Limits, dt: Real, xp: Any) -> Real:
    """The rate at which a reference turns by ``error`` without exceeding the limits [rad/s].

    |rate| ≤ ψ̇_max, |rate − last| ≤ ψ̈_max dt, and no faster than it can brake from on the rest of
    the way: rate²/2 + rate·ψ̈_max dt/2 ≤ ψ̈_max |error|.

    Args:
        error: angle still to turn [rad].
        last: the rate before [rad/s].
        limits: of the plant; what is infinite does not limit.
        dt: time of the step [s].
    """
    size = abs(error)
    fastest = xp.minimum(size / xp.maximum(dt, 1e-9), limits.yaw_rate)
    if not math.isinf(limits.yaw_acceleration):
        step = limits.yaw_acceleration * dt
        braking = -0.5 * step + xp.sqrt(0.25 * step * step + 2.0 * limits.yaw_acceleration * size)
        rate = xp.where(error >= 0, 1.0, -1.0) * xp.minimum(fastest, braking)
        return xp.clip(rate, last - step, last + step)
    return xp.where(error >= 0, 1.0, -1.0) * fastest
