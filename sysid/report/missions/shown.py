"""What pictures and pages of a mission show beside its own drive: its plane, and many runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array
from sysid.report.missions.scene import Obstacle, Scene
from sysid.robot.mission.spec import Mission

if TYPE_CHECKING:  # one drive waits for no pool of many
    from sysid.robot.mission.batch.setup import Setup
    from sysid.robot.mission.monte_carlo.mission_runs import MissionRuns

SHOWN = 100
"""Paths in a picture: enough for a fan."""


@dataclass(frozen=True, eq=False)
class ShownRuns:
    """Many runs of a mission, and the ways of some.

    Attributes:
        paths, worst: X, Y of the first runs and of the worst ones, (n, 2) each [m].
    """

    batch: "MissionRuns"
    paths: Sequence[Array]
    worst: Sequence[Array]


def scene_of(mission: Mission, seconds: float = 0.0) -> Scene:
    """What a mission has in the plane; obstacles that move have done so for some seconds."""

    def line(points: Sequence[tuple[float, float]]) -> Array | None:
        return np.array(points) if points else None

    return Scene(
        goal=mission.goal,
        tolerance=mission.tolerance,
        obstacles=tuple(
            Obstacle(o.x, o.y, o.radius, (o.velocity[0] * seconds, o.velocity[1] * seconds))
            for o in mission.obstacles
        ),
        walls=tuple(map(np.array, mission.walls)),
        polygons=tuple(map(np.array, mission.polygons)),
        waypoints=line(mission.waypoints),
        course=line(mission.path and (mission.start[:2], *mission.path, mission.goal)),
        influence=mission.guidance.reach,
    )


def shown_runs(setup: "Setup", batch: "MissionRuns") -> ShownRuns:
    """The first runs and the worst ones, which are driven again for their paths."""
    from sysid.robot.mission.monte_carlo.paths import paths_of

    usual = batch.seeds[:SHOWN]
    paths = paths_of(setup, [*usual, *(w.seed for w in batch.worst)])
    return ShownRuns(batch, paths[: len(usual)], paths[len(usual) :])
