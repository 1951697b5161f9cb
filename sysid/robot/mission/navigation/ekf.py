"""The extended Kalman filter, and the linear one."""

from typing import Any, ClassVar

from sysid.robot.mission.navigation.delays import BufferedSample
from sysid.robot.mission.navigation.design import Design
from sysid.robot.mission.navigation.fusion import Filter, Sight
from sysid.robot.mission.navigation.gaussian import (
    Gaussian,
    Innovation,
    corrected,
    symmetric,
    wrapped,
)
from sysid.robot.mission.navigation.process import PSI, Process
from sysid.vehicle.kinematics import Geometry


def predicted(
    belief: Gaussian, process: Process, geometry: Geometry, sample: BufferedSample, xp: Any
) -> Gaussian:
    """x⁻ = f(x), P⁻ = FPFᵀ + Q with F the slopes of f at x (thesis 4.6, 4.7)."""
    s = {name: belief.x[i] for i, name in enumerate(process.names)}
    after = process.advanced(s, sample.dt, sample.drive, geometry, xp)
    F, Q = process.slopes(s, sample.dt, sample.drive, geometry, xp)
    x = xp.array([after[name] for name in process.names])
    return Gaussian(wrapped(x, PSI, xp), symmetric(F @ belief.P @ F.T + Q))


def measured(
    belief: Gaussian, names: tuple[str, ...], sight: Sight, xp: Any
) -> tuple[Gaussian, Innovation]:
    """Correct by z = h(x) + v, with the slopes of h at x."""
    nu, H = sight.group.linearised(sight.z, belief.x, names, sight.setting, xp)
    belief, innovated = corrected(belief, nu, H, sight.variance, sight.quantiles, xp)
    return Gaussian(wrapped(belief.x, PSI, xp), belief.P), innovated


class ExtendedKalman(Filter):
    """Pose, speed, yaw rate, slip and biases of the sensors, linearised at each estimate."""

    def predicted(
        self, of: Gaussian, plan: Design, geometry: Geometry, sample: BufferedSample, xp: Any
    ) -> Gaussian:
        return predicted(of, plan.process, geometry, sample, xp)

    def corrected(
        self, of: Gaussian, plan: Design, sight: Sight, xp: Any
    ) -> tuple[Gaussian, Innovation]:
        return measured(of, plan.process.names, sight, xp)


class Kalman(ExtendedKalman):
    """Speed, heading, yaw rate and biases, and the position along a heading that counts as known.

    ψ and ψ̇ make one linear system: encoders read the difference of the tracks, a gyroscope ψ̇ plus
    its bias, a magnetometer ψ itself once its two components are an angle (4.3). Position and
    speed make another one that is linear once ψ is known: X⁺ = X + v cos ψ dt. So the estimate of
    the first enters the second as a known number, and P has no entries that couple position with
    heading: (4.4)–(4.11) as they stand, without slopes. What that leaves out is the heading's own
    uncertainty in the position, which the filter therefore believes to be smaller than it is.
    Motions from frame to frame are likewise laid along the heading that is believed at the frame.

    Slip, which multiplies, and acceleration to the left, a product of two states, are not used.
    """

    linear: ClassVar[bool] = True
