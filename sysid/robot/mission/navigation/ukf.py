"""The unscented Kalman filter."""

from typing import Annotated, Any

from pydantic import Field

from sysid.robot.mission.navigation.delays import BufferedSample
from sysid.robot.mission.navigation.design import Design
from sysid.robot.mission.navigation.fusion import Filter, Sight
from sysid.robot.mission.navigation.gaussian import (
    Gaussian,
    Innovation,
    Sigma,
    innovation,
    sigma,
    symmetric,
    transformed,
    wrapped,
)
from sysid.robot.mission.navigation.process import PSI, is_angle
from sysid.vehicle.kinematics import Geometry


class UnscentedKalman(Filter):
    """The states of the extended filter, carried by 2n + 1 points instead of slopes.

    The default spread has equal weights and none at the centre (the cubature rule), so that
    covariances stay positive; ``alpha: 0.001, beta: 2`` is the customary narrow one.

    Attributes:
        alpha, beta, kappa: of van der Merwe's points; they lie α√(n + κ) standard deviations off.
    """

    alpha: Annotated[float, Field(ge=1e-3, le=10)] = 1.0
    beta: Annotated[float, Field(ge=0, le=10)] = 0.0
    kappa: Annotated[float, Field(ge=0, le=100)] = 0.0

    def predicted(
        self, of: Gaussian, plan: Design, geometry: Geometry, sample: BufferedSample, xp: Any
    ) -> Gaussian:
        """What is believed ``sample.dt`` later: mean and spread of the points moved, plus Q."""
        process = plan.process

        def moved(at: Any) -> Any:
            s = {name: at[:, i] for i, name in enumerate(process.names)}
            after = process.advanced(s, sample.dt, sample.drive, geometry, xp)
            return xp.array([after[name] for name in process.names]).T

        angles = xp.array([is_angle(name) for name in process.names])
        points = self._sigma(of, xp)
        x, _, off = transformed(of, moved, angles, points, xp)
        before = {name: of.x[i] for i, name in enumerate(process.names)}
        Q = process.slopes(before, sample.dt, sample.drive, geometry, xp)[1]
        P = (off.T * points.covariance) @ off + Q
        return Gaussian(wrapped(x, PSI, xp), symmetric(P))

    def corrected(
        self, of: Gaussian, plan: Design, sight: Sight, xp: Any
    ) -> tuple[Gaussian, Innovation]:
        """What is believed after one group of measurements, with points drawn anew."""
        names, group = plan.process.names, sight.group

        def seen(at: Any) -> Any:
            s = {name: at[:, i] for i, name in enumerate(names)}
            return xp.array([one.value for one in group.expected(s, sight.setting, xp)]).T

        angles = xp.array([is_angle(name) for name in group.names])
        points = self._sigma(of, xp)
        mean, before, after = transformed(of, seen, angles, points, xp)
        present = xp.isfinite(sight.z)
        nu = xp.where(present, group.off(sight.z - mean, xp), 0.0)
        after = xp.where(present, after, 0.0)
        share = points.covariance
        S = (after.T * share) @ after + sight.variance * xp.eye(len(nu))
        innovated, inverse = innovation(nu, S, sight.variance, present, sight.quantiles, xp)
        K = (before.T * share) @ after @ inverse * (1.0 - innovated.rejected)
        P = of.P - K @ S @ K.T
        return Gaussian(wrapped(of.x + K @ nu, PSI, xp), symmetric(P)), innovated

    def _sigma(self, of: Gaussian, xp: Any) -> Sigma:
        return sigma(len(of.x), self.alpha, self.beta, self.kappa, xp)
