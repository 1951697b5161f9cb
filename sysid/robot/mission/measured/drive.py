"""A measured drive: clock, start and noise for the comparison with simulated runs."""

from dataclasses import dataclass

import numpy as np

from sysid.data.level_crossing import first_crossing
from sysid.data.noise import white_noise
from sysid.data.record import Array, Record
from sysid.errors import DataError
from sysid.vehicle.kinematics import wrap_angle

FINEST = np.array([1e-3, 1e-3, 2e-3])
"""No x, y [m] and ψ [rad] of a robot is measured better than this, whatever a log seems to say."""

MOVED = (0.02, 0.03)
"""A robot has set off when it is so far [m], or so much turned [rad], from where it stood: more
than a robot that is put down right trembles, and passed within the first instants of any drive."""

BEYOND_NOISE = 6.0
"""… and by this many standard deviations of the measurements: one in 10⁹ is that far off."""

STANDS = 0.5
"""Commands that stay as they are for so long [s] while the robot stands are those of rest."""

MIN_POSE_ROWS = 10
"""Rows with a pose that a compared log needs."""

SAME_PLACE = (0.05, 0.05)
"""A start within so many metres and radians of the mission's needs no word."""


@dataclass(frozen=True, eq=False)
class Clock:
    """How the clocks of a log and of a mission were brought together.

    Attributes:
        at: instant of the log at which ``by`` happens first [s].
        by: ``command`` or ``motion``.
        distance, angle: what counts as motion [m], [rad].
    """

    at: float
    by: str
    distance: float
    angle: float


@dataclass(frozen=True, eq=False)
class MeasuredDrive:
    """A measured mission.

    Attributes:
        t: instants since its first row [s], (N,); rows without a pose are left out.
        pose: x, y [m], ψ [rad] at these, (N, 3).
        noise: standard deviation of a measurement, (3,).
        start: the pose in which it stood before, (3,).
        start_error: standard error of that, (3,).
    """

    name: str
    t: Array
    pose: Array
    noise: Array
    clock: Clock
    start: Array
    start_error: Array

    @staticmethod
    def of(record: Record) -> "MeasuredDrive":
        """The drive that a log holds."""
        known = (
            np.zeros(len(record), dtype=bool)
            if record.pose is None
            else np.isfinite(record.pose).all(axis=1)
        )
        if record.pose is None or known.sum() < MIN_POSE_ROWS:
            raise DataError(
                f"{record.name} has fewer than {MIN_POSE_ROWS} rows of a path (columns x, y, psi); "
                "record the pose, or join the file that has it"
            )
        t, pose = (record.t - record.t0)[known], record.pose[known].copy()
        pose[:, 2] = np.unwrap(pose[:, 2])
        noise = np.maximum(white_noise([pose]), FINEST)
        distance = max(MOVED[0], BEYOND_NOISE * float(noise[:2].max()))
        angle = max(MOVED[1], BEYOND_NOISE * float(noise[2]))
        moves = sets_off(t, pose[None], distance, angle)[0]
        if not np.isfinite(moves):
            raise DataError(
                f"{record.name}: the robot does not move ({distance:.2g} m at least), so there is "
                "no path to compare; name the log of a drive"
            )
        at, by = _first_command(record, moves)
        standing = max(1, int(np.sum(t < (at if by == "command" else moves - STANDS))))
        return MeasuredDrive(
            name=record.name,
            t=t,
            pose=pose,
            noise=noise,
            clock=Clock(at, by, distance, angle),
            start=pose[:standing].mean(axis=0),
            start_error=noise / np.sqrt(standing),
        )

    def notes(self, start: tuple[float, float, float]) -> tuple[str, ...]:
        """What was done to compare it with a mission that starts there, in sentences."""
        what = "first command" if self.clock.by == "command" else "first motion"
        sentences = [f"Time counts from the {what}, at {self.clock.at:.4g} s of {self.name}."]
        if self.clock.by == "motion":
            sentences.append(f"{self.name} has no commands, so the clocks agree to about a sample.")
        away = float(np.hypot(*(self.start[:2] - start[:2])))
        turned = float(abs(wrap_angle(self.start[2] - start[2])))
        if away > SAME_PLACE[0] or turned > SAME_PLACE[1]:
            x, y, psi = self.start
            sentences.append(
                f"{self.name} begins at ({x:.3g}, {y:.3g}, {psi:.3g} rad), {away:.2g} m and "
                f"{turned:.2g} rad from the mission's start: the runs start where it does."
            )
        return tuple(sentences)


def sets_off(t: Array, pose: Array, distance: float, angle: float) -> Array:
    """When robots have first moved by a distance or an angle [s], (K,); infinite where never.

    Args:
        t: instants, (N,).
        pose: x, y, ψ of each, (K, N, 3), ψ without jumps.
        distance, angle: [m], [rad].
    """
    away = pose - pose[:, :1]
    share = np.maximum(
        np.hypot(away[..., 0], away[..., 1]) / distance, np.abs(away[..., 2]) / angle
    )
    return first_crossing(t, share.T, 1.0)


def command_begins(t: Array, pwm: Array) -> float:
    """The first instant with a command [s]; the first of all where there is none."""
    return float(t[int(np.argmax(np.any(pwm != 0.0, axis=1)))])


def _first_command(record: Record, moves: float) -> tuple[float, str]:
    if not record.nu or not np.isfinite(record.u).all():
        return moves, "motion"
    t, u = record.t - record.t0, record.u
    if not np.any(u[0]):
        begins = command_begins(t, u)
        return (begins, "command") if np.any(u) and begins <= moves else (moves, "motion")
    changes = np.any(u != u[0], axis=1)
    changed_at = float(t[int(np.argmax(changes))])
    rest = changes.any() and STANDS <= changed_at <= moves
    return (changed_at if rest else float(t[0])), "command"
