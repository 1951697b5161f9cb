"""The result of a mission: outcome, figures and log."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from sysid.data.files import replacing
from sysid.data.record import Array
from sysid.outside_text import csv_text, html_lines, html_table
from sysid.robot.mission.contracts import Pose


class Outcome(StrEnum):
    """How a mission ended; ``missed``: the robot believes that it has arrived, and is not there."""

    ARRIVED = "arrived"
    MISSED = "missed"
    TIMEOUT = "timeout"
    COLLISION = "collision"
    STUCK = "stuck"


class StuckReason(StrEnum):
    """Why a robot got nowhere."""

    PAST_GOAL = "past-goal"
    LOCAL_MINIMUM = "local-minimum"
    OSCILLATION = "oscillation"
    NO_WAY_THROUGH = "no-way-through"
    STANDS_STILL = "stands-still"
    OFF_COURSE = "off-course"


@dataclass(frozen=True)
class Stuck:
    """Why and where a robot got nowhere.

    Attributes:
        place: where: X, Y [m].
    """

    reason: StuckReason
    place: tuple[float, float]

    def summary(self) -> dict[str, Any]:
        x, y = self.place
        return {"reason": self.reason.value, "place": {"x": x, "y": y}}


@dataclass(frozen=True)
class MissionResult:
    """What a mission came to.

    Attributes:
        time_s: when [s].
        final: the last X [m], Y [m], ψ [rad], as the robot truly is.
        off_goal_m: its distance from the goal [m].
        believed: the pose that navigation takes for the last one.
        believed_off_goal_m: the distance of that from the goal [m].
        path_length_m: length of the path driven [m].
        min_clearance_m: smallest distance from the robot's centre to an obstacle's surface [m];
            None without obstacles.
        max_deviation_m: largest distance from the line through start and goal [m].
        log: columns of equal length by name (:data:`sysid.robot.mission.loop.COLUMNS`), one row a
            plant sample; read-only.
        stuck: why and where it got nowhere; None where it did not.
    """

    outcome: Outcome
    time_s: float
    final: Pose
    off_goal_m: float
    believed: Pose
    believed_off_goal_m: float
    path_length_m: float
    min_clearance_m: float | None
    max_deviation_m: float
    log: Mapping[str, Array]
    sentence: str
    stuck: Stuck | None = None

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.outcome.value} after {self.time_s:.4g} s>"

    def _repr_html_(self) -> str:
        near = self.min_clearance_m
        rows = [
            ("outcome", self.outcome.value),
            ("time", f"{self.time_s:.4g} s"),
            ("off the goal", f"{self.off_goal_m:.3g} m"),
            ("path driven", f"{self.path_length_m:.4g} m"),
            *([] if near is None else [("nearest obstacle", f"{near:.3g} m")]),
        ]
        return html_table(rows) + html_lines(self.sentence)

    def summary(self) -> dict[str, Any]:
        return {
            "outcome": self.outcome.value,
            "sentence": self.sentence,
            "time_s": self.time_s,
            "final": self.final._asdict(),
            "off_goal_m": self.off_goal_m,
            "believed": self.believed._asdict() | {"off_goal_m": self.believed_off_goal_m},
            "path_length_m": self.path_length_m,
            "min_clearance_m": self.min_clearance_m,
            "max_deviation_m": self.max_deviation_m,
            "stuck": None if self.stuck is None else self.stuck.summary(),
        }


def write_log(result: MissionResult, path: str | Path) -> Path:
    """Write a mission's log as CSV, a valid input of ``sysid fit``."""
    return write_columns(result.log, path)


def write_columns(columns: Mapping[str, Array], path: str | Path) -> Path:
    """Write columns of equal length as CSV; numbers survive unrounded, what is none is left empty.

    Args:
        path: the file; it appears complete or not at all.
    """
    with replacing(path) as new, new.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(map(csv_text, columns))
        cells = (["" if v != v else v for v in c.tolist()] for c in columns.values())
        writer.writerows(zip(*cells, strict=True))
    return Path(path)
