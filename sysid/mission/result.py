"""What a mission came to: its outcome, its figures and its log."""

import csv
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from sysid.data.record import Array
from sysid.errors import DataError
from sysid.mission.guidance import Pose

COLUMNS = (
    "t", "pwm_l", "pwm_r", "omega_l", "omega_r", "x", "y", "psi",
    "v", "yaw_rate", "v_ref", "psi_ref", "v_cmd", "psi_cmd", "rho_goal",
)  # fmt: skip
"""Columns of a mission log: the robot log's first, then what the loop was thinking."""

STUCK_PROGRESS = 0.05
"""Less progress than this [m] …"""
STUCK_TIME = 10.0
"""… in this time [s] ends a mission as stuck."""


class Outcome(StrEnum):
    """How a mission ended."""

    ARRIVED = "arrived"
    TIMEOUT = "timeout"
    COLLISION = "collision"
    STUCK = "stuck"

    @property
    def sentence(self) -> str:
        """The outcome in words, with the next step."""
        return _SENTENCES[self]


_SENTENCES = {
    Outcome.ARRIVED: "The robot reached the goal within the tolerance.",
    Outcome.TIMEOUT: "Time ran out before the goal was reached: raise timeout or v_max.",
    Outcome.COLLISION: "The robot touched an obstacle: raise eta or rho0, or lower v_max.",
    Outcome.STUCK: (
        f"The robot came less than {STUCK_PROGRESS} m closer in {STUCK_TIME:g} s: look at its path."
    ),
}


@dataclass(frozen=True)
class MissionResult:
    """What a mission came to.

    Attributes:
        outcome: how it ended.
        time_s: when [s].
        final: the last X [m], Y [m], ψ [rad].
        path_length_m: length of the path driven [m].
        min_clearance_m: smallest distance from the robot's centre to an obstacle's surface [m];
            None without obstacles.
        max_deviation_m: largest distance from the line through start and goal [m].
        log: columns of equal length by name (:data:`COLUMNS`), one row a plant sample; read-only.
        why: the outcome in words with the next step; the outcome's own sentence unless given.
    """

    outcome: Outcome
    time_s: float
    final: Pose
    path_length_m: float
    min_clearance_m: float | None
    max_deviation_m: float
    log: Mapping[str, Array]
    why: str = ""

    @property
    def sentence(self) -> str:
        """How it ended, with the next step."""
        return self.why or self.outcome.sentence

    def summary(self) -> dict[str, Any]:
        """Return everything but the log as plain values for a JSON document."""
        return {
            "outcome": self.outcome.value,
            "sentence": self.sentence,
            "time_s": self.time_s,
            "final": dict(zip(("x", "y", "psi"), self.final, strict=True)),
            "path_length_m": self.path_length_m,
            "min_clearance_m": self.min_clearance_m,
            "max_deviation_m": self.max_deviation_m,
        }


def write_log(result: MissionResult, path: str | Path) -> Path:
    """Write a mission's log as CSV, a valid input of ``sysid fit``; numbers survive unrounded.

    Args:
        result: the mission.
        path: the file; it appears complete or not at all.

    Returns:
        The path written.

    Raises:
        DataError: the file cannot be written there.
    """
    path = Path(path)
    try:
        handle, temporary = tempfile.mkstemp(prefix=path.name, suffix=".tmp", dir=path.parent)
        try:
            with os.fdopen(handle, "w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(result.log)
                writer.writerows(zip(*(c.tolist() for c in result.log.values()), strict=True))
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as error:
        raise DataError(
            f"the mission log {path} cannot be written ({error.strerror}): choose another place"
        ) from None
    return path
