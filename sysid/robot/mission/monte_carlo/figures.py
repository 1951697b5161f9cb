"""The results of runs: a few numbers each, no logs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sysid.data.record import Array, Index
from sysid.robot.mission.batch.runner import FAILED
from sysid.robot.mission.loop import Verdict
from sysid.robot.mission.result import MissionResult

OUTCOMES = ("arrived", "missed", "collision", "stuck", "timeout", "failed")
"""In the order of the report."""


class Figures(NamedTuple):
    """What runs came to, one entry each.

    Attributes:
        verdict: of :class:`sysid.robot.mission.loop.Verdict`, or ``FAILED``.
        time_s: when it ended [s].
        x, y, psi: where [m, rad].
        path_length_m, min_clearance_m, max_deviation_m: see
            :class:`sysid.robot.mission.result.MissionResult`; the clearance is infinite without
            obstacles.
    """

    verdict: Index
    time_s: Array
    x: Array
    y: Array
    psi: Array
    path_length_m: Array
    min_clearance_m: Array
    max_deviation_m: Array

    def final_error_m(self, goal: tuple[float, float]) -> Array:
        """Distance from where the runs ended to the goal [m]."""
        return np.hypot(self.x - goal[0], self.y - goal[1])

    def outcome(self, k: int) -> str:
        """The outcome of one run, as a word."""
        verdict = int(self.verdict[k])
        return "failed" if verdict == FAILED else Verdict(verdict).name.lower()


def figures_of(result: MissionResult) -> tuple[float, ...]:
    """One run's figures, in the order of :class:`Figures`."""
    clearance = result.min_clearance_m
    return (
        float(Verdict[result.outcome.name]),
        result.time_s,
        *result.final,
        result.path_length_m,
        np.inf if clearance is None else clearance,
        result.max_deviation_m,
    )


NOTHING = (float(FAILED), *(np.nan,) * (len(Figures._fields) - 1))
"""The figures of a run that failed."""


def stacked(rows: Sequence[Sequence[float]]) -> Figures:
    """Figures of runs from rows, one a run."""
    table = np.array(rows, dtype=np.float64).reshape(-1, len(Figures._fields))
    return Figures(table[:, 0].astype(np.intp), *table[:, 1:].T)


def joined(parts: Sequence[Figures], order: Index) -> Figures:
    """Parts one after the other, then in the order of these places."""
    verdict, *numbers = (np.concatenate(columns)[order] for columns in zip(*parts, strict=True))
    return Figures(verdict.astype(np.intp), *(n.astype(np.float64) for n in numbers))
