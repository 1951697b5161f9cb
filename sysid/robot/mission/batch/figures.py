"""The figures of runs, and what of their samples was kept."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sysid.data.record import Array, Index
from sysid.robot.mission.loop import Verdict
from sysid.robot.mission.result import MissionResult

FAILED = 6
"""The verdict, beside those of the loop, of a run whose plant or law gives no numbers."""


class Figures(NamedTuple):
    """What runs came to, one entry each.

    Attributes:
        verdict: of :class:`sysid.robot.mission.loop.Verdict`, or ``FAILED``.
        time_s: when it ended [s].
        x, y, psi: where [m, rad].
        path_length_m, min_clearance_m, max_deviation_m: see
            :class:`sysid.robot.mission.result.MissionResult`; the clearance is infinite without
            obstacles.
        effort: ∫ (V_cmd² + ψ_cmd²) dt, in seconds of full drive.
    """

    verdict: Index
    time_s: Array
    x: Array
    y: Array
    psi: Array
    path_length_m: Array
    min_clearance_m: Array
    max_deviation_m: Array
    effort: Array

    def final_error_m(self, goal: tuple[float, float]) -> Array:
        """Distance from where the runs ended to the goal [m]."""
        return np.hypot(self.x - goal[0], self.y - goal[1])

    def outcome(self, k: int) -> str:
        """The outcome of one run, as a word."""
        verdict = int(self.verdict[k])
        return "failed" if verdict == FAILED else Verdict(verdict).name.lower()


class Driven(NamedTuple):
    """Runs that have ended, K of them.

    Attributes:
        t: instants of the rows that were kept [s], (T,).
        rows: columns of the log at these, (T, columns, K); what a run shows after its end is not
            its own.
    """

    figures: Figures
    t: Array
    rows: Array


def figures_of(result: MissionResult, dt: float) -> tuple[float, ...]:
    """One run's figures, in the order of :class:`Figures`; ``dt`` is the plant's [s]."""
    clearance, log = result.min_clearance_m, result.log
    return (
        float(Verdict[result.outcome.name]),
        result.time_s,
        *result.final,
        result.path_length_m,
        np.inf if clearance is None else clearance,
        result.max_deviation_m,
        float(np.sum(log["v_cmd"] ** 2 + log["psi_cmd"] ** 2)) * dt,
    )


NOTHING = (float(FAILED), *(np.nan,) * (len(Figures._fields) - 1))
"""The figures of a run that failed."""


def stacked(rows: Sequence[Sequence[float]]) -> Figures:
    """Figures of runs from rows, one a run."""
    table = np.array(rows, dtype=np.float64).reshape(-1, len(Figures._fields))
    return Figures(table[:, 0].astype(np.intp), *table[:, 1:].T)


def joined(parts: Sequence[Driven]) -> Driven:
    """Runs one after the other, with as many rows as the longest: others hold their last."""
    t = max((part.t for part in parts), key=len)
    padded = [np.pad(p.rows, ((0, len(t) - len(p.t)), (0, 0), (0, 0)), "edge") for p in parts]
    figures = zip(*(p.figures for p in parts), strict=True)
    return Driven(Figures(*map(np.concatenate, figures)), t, np.concatenate(padded, axis=2))
