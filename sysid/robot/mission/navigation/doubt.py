"""Recovery of a filter that rejects one measurement after another.

A gate keeps outliers away. Once the vehicle has moved as the filter's process does not know, to the
side for instance, every right measurement lies beyond the gate as well, and the filter would never
find back. How to distinguish: outliers come alone or contradict each other; measurements
that are right stay off by the same. After a run of rejected measurements that agree, the pose is
assumed to have moved by them, Var = ν², and the next one corrects it.
"""

from typing import Any, NamedTuple

from sysid.robot.mission.navigation.gaussian import Gaussian, innovation, symmetric
from sysid.robot.mission.navigation.measurements import Group

RUN = 5
"""Rejected measurements in a row that agree: outliers, one in ten, make such a run once in 10⁵."""

AGREE = 0.25
"""Two innovations agree if they differ by less than half of their size, in squares."""

POSE = 3
"""States x, y, psi, the first ones of every filter."""

DOUBTS = frozenset({"position_fixes", "visual_odometry"})
"""Absolute sensors without long disturbances from the surroundings. Iron bends
the field of a magnetometer for as long as the robot is beside it, which looks the same."""


class Doubt(NamedTuple):
    """What a filter remembers of the measurements of a sensor that it rejected.

    Attributes:
        run: how many in a row were rejected and agree.
        nu: innovation of the last measurement, (m,).
    """

    run: Any
    nu: Any


def doubts(group: Group, gate: float) -> bool:
    """Whether rejected measurements of a sensor can make the filter doubt itself."""
    return gate < 1 and group.kind in DOUBTS


def doubted(
    one: Gaussian, names: tuple[str, ...], sight: Any, before: Doubt, xp: Any
) -> tuple[Doubt, Any]:
    """Judge a group of measurements, before they are used.

    Args:
        one: mean and covariance that is believed, the states of ``names`` in front.

    Returns:
        What is remembered from now on, and what is to be added to P, (n, n): 0 while the run is
        shorter than :data:`RUN`.
    """
    nu, H = sight.group.linearised(sight.z, one.x, names, sight.setting, xp)
    present = xp.isfinite(nu)
    came = present.any()
    nu, H = xp.where(present, nu, 0.0), xp.where(present[:, None], H, 0.0)
    S = H @ one.P @ H.T + sight.variance * xp.eye(len(nu))
    innovated, inverse = innovation(nu, S, sight.variance, present, sight.quantiles, xp)
    off = nu - before.nu
    agrees = 1.0 * (off @ inverse @ off <= AGREE * innovated.nis)
    run = xp.where(came, innovated.rejected * (1.0 + agrees * before.run), before.run)
    pose_part = H * xp.array([1.0 * (i < POSE) for i in range(len(one.x))])
    more = 1.0 * (run >= RUN) * came
    added = more * symmetric((pose_part.T * (nu * nu)) @ pose_part)
    return Doubt(run, xp.where(came, nu, before.nu)), added
