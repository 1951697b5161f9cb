"""Visual odometry: a camera that follows its own motion from frame to frame."""

from typing import Any, ClassVar, NamedTuple

from sysid.robot.mission.contracts import Pose, Scene, SensorInputs
from sysid.robot.mission.sensors.imperfect import (
    AT_ONCE,
    ImperfectSensor,
    Latency,
    NotNegative,
    Reals,
    each,
)
from sysid.robot.mission.settings import Positive
from sysid.runners.trees import chosen
from sysid.vehicle.kinematics import Real, wrap_angle


class Followed(NamedTuple):
    """What visual odometry remembers: at this sample, at the last frame, and as it was seen."""

    pose: Pose
    frame: Pose
    seen: Pose


class VisualOdometry(ImperfectSensor):
    """Reads a pose that drifts, ``vo_x``, ``vo_y`` [m] and ``vo_psi`` [rad] in (−π, π].

    From frame to frame it measures the motion (Δx, Δy, Δψ) in the body frame of the earlier frame,
    with errors, and adds it to its pose, which starts in the start pose of the mission. So the
    pose's error grows without bound and is not white; the motion between two measurements,
    :func:`motion_between`, has a white one. A measurement that is lost loses no motion.

    ``noise``, ``bias`` and ``saturation`` are those of the velocities that are measured: forward,
    sideways [m/s] and turning [rad/s]. After a time t the noise alone has let the heading drift by
    noise·√t, and the position by that and by what the heading turned it.

    The defaults make one per cent of the way, as good systems do (Geiger et al. 2012, KITTI): on a
    way of 7 m in 30 s some 0.03 m and one degree. A frame takes 50 ms to be exposed and understood.
    """

    measured: ClassVar[tuple[str, ...]] = ("vo_x", "vo_y", "vo_psi")
    adds_up: ClassVar[bool] = True

    rate: Positive = 30.0
    noise: NotNegative = (0.005, 0.003, 0.003)
    latency: Latency = 0.05

    def variance(self, dt: float) -> tuple[float, ...]:
        """Variance of the motion from one measurement to the next: noise²·T [m², rad²]."""
        n, span = len(self.measured), self.interval(dt)
        figures = zip(each(self.noise, n), each(self.resolution, n), strict=True)
        return tuple(noise**2 * span + step**2 / 6.0 for noise, step in figures)

    def begin(self, scene: Scene, xp: Any) -> Followed:
        return Followed(scene.start, scene.start, scene.start)

    def measure(
        self, memory: Followed, inputs: SensorInputs, since: Real, dt: Real, xp: Any
    ) -> tuple[Followed, Reals]:
        """The mean velocities since the last frame, in that frame."""
        pose, time = inputs.body.pose, xp.maximum(since, AT_ONCE)
        motion = motion_between(memory.frame, pose, xp)
        return memory._replace(pose=pose), tuple(part / time for part in motion)

    def read(
        self, memory: Followed, measured: Reals, since: Real, now: Real, arrives: Real, xp: Any
    ) -> tuple[Followed, Reals]:
        forward, sideways, turned = (velocity * since for velocity in measured)
        x, y, psi = memory.seen
        c, s = xp.cos(psi), xp.sin(psi)
        seen = Pose(
            x + c * forward - s * sideways,
            y + s * forward + c * sideways,
            wrap_angle(psi + turned),
        )
        frame = Followed(memory.pose, memory.pose, seen)
        return chosen(now, frame, memory, xp), tuple(seen)


def motion_between(earlier: Pose, later: Pose, xp: Any) -> tuple[Real, Real, Real]:
    """The motion from one pose to another in the body frame of the first.

    Returns:
        Forward and to the left [m], turned [rad] in (−π, π].
    """
    dx, dy = later.x - earlier.x, later.y - earlier.y
    c, s = xp.cos(earlier.psi), xp.sin(earlier.psi)
    return c * dx + s * dy, c * dy - s * dx, wrap_angle(later.psi - earlier.psi)
