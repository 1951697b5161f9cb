"""What pictures and pages of a mission show beside its own drive: many runs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sysid.data.record import Array

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


def shown_runs(setup: "Setup", batch: "MissionRuns") -> ShownRuns:
    """The first runs and the worst ones, which are driven again for their paths."""
    from sysid.robot.mission.monte_carlo.runs import paths_of

    usual = batch.seeds[:SHOWN]
    paths = paths_of(setup, [*usual, *(w.seed for w in batch.worst)])
    return ShownRuns(batch, paths[: len(usual)], paths[len(usual) :])
