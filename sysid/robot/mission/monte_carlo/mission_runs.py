"""The result of many runs of a mission: outcomes, quantiles, variance shares."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.documents import plain
from sysid.data.record import Array
from sysid.outside_text import html_lines, html_table
from sysid.robot.mission.batch.figures import FAILED, Figures
from sysid.robot.mission.loop import Verdict
from sysid.robot.mission.monte_carlo.variance_shares import Shares
from sysid.robot.mission.result import write_columns

OUTCOMES = ("arrived", "missed", "collision", "stuck", "timeout", "failed")
"""In the order of the report."""

WORST = 5
"""Runs that are named as the worst."""

SURELY = 0.99
"""Share of the runs to which the clearance in the sentence applies."""


@dataclass(frozen=True)
class OutcomeShare:
    """How many runs ended in one way.

    Attributes:
        interval: 95 % interval of the probability, Wilson's.
    """

    count: int
    share: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class WorstRun:
    """A run to look at: its seed replays it alone."""

    seed: int
    outcome: str
    time_s: float | None


@dataclass(frozen=True, eq=False)
class MissionRuns:
    """What many runs of a mission came to.

    Attributes:
        goal: of the mission [m].
        figures: of the runs, in the order of ``seeds``.
        redrawn: draws that were not feasible and were made again.
        time_drivers, error_drivers: what the variance of the time of runs that arrived, and of the
            final error, comes from; None for too few runs.
    """

    seed: int
    seconds: float
    goal: tuple[float, float]
    obstacles: bool
    vary: tuple[str, ...]
    seeds: tuple[int, ...]
    figures: Figures
    redrawn: int
    time_drivers: Shares | None
    error_drivers: Shares | None
    notes: tuple[str, ...]

    @property
    def n(self) -> int:
        return len(self.seeds)

    @property
    def outcomes(self) -> dict[str, OutcomeShare]:
        """Arrived, missed, collision, stuck, timeout, and failed where a run has failed."""
        shares = {}
        for name in OUTCOMES:
            code = FAILED if name == "failed" else Verdict[name.upper()]
            count = int(np.sum(self.figures.verdict == code))
            if count or name != "failed":
                shares[name] = OutcomeShare(count, count / self.n, wilson(count, self.n))
        return shares

    @property
    def time_s(self) -> Array:
        """Times of the runs that arrived [s]."""
        return np.asarray(self.figures.time_s[self.figures.verdict == Verdict.ARRIVED])

    @property
    def final_error_m(self) -> Array:
        """Distances to the goal at the end, of the runs that did not fail [m]."""
        return np.asarray(self.figures.final_error_m(self.goal)[self._ended])

    @property
    def min_clearance_m(self) -> Array:
        """Smallest clearances of the runs that did not fail [m]; empty without obstacles."""
        clearances: Array = self.figures.min_clearance_m[self._ended]
        return clearances if self.obstacles else clearances[:0]

    @property
    def _ended(self) -> Array:
        return np.asarray(self.figures.verdict != FAILED)

    @property
    def worst(self) -> tuple[WorstRun, ...]:
        """Those that did not arrive, the farthest from the goal first; then the slowest."""
        error = np.nan_to_num(self.figures.final_error_m(self.goal), nan=np.inf)
        arrived = self.figures.verdict == Verdict.ARRIVED
        late = np.where(arrived, self.figures.time_s, np.inf)
        order = np.lexsort((np.arange(self.n), np.where(arrived, 0.0, -error), -late))
        return tuple(
            WorstRun(self.seeds[k], self.figures.outcome(k), _finite(self.figures.time_s[k]))
            for k in order[:WORST].tolist()
        )

    @property
    def sentence(self) -> str:
        arrived, time = self.outcomes["arrived"], self.time_s
        runs = f"{self.n:,}".replace(",", " ") + " runs" if self.n != 1 else "1 run"
        if self.redrawn:
            lost = self.redrawn / (self.redrawn + self.n)
            runs += f" ({_percent(lost)} of the draws could not be driven and were replaced)"
        if not arrived.count:
            most = max(self.outcomes, key=lambda name: self.outcomes[name].count)
            return (
                f"Arrives in none of {runs}: {most} in {_percent(self.outcomes[most].share)}."
                f"{self._belief}"
            )
        low, middle, high = np.quantile(time, (0.025, 0.5, 0.975))
        when = f"rrives in {middle:.1f} s (95 %: {low:.1f}–{high:.1f})"
        if arrived.count < self.n:
            lower, upper = arrived.interval
            when = (
                f"n {_percent(arrived.share)} of the runs ({_percent(lower)} to {_percent(upper)}) "
                f"a{when}"
            )
        head = "I" if arrived.count < self.n else "A"
        if not self.obstacles:
            return f"{head}{when}, of {runs}.{self._belief}"
        clearance = float(np.quantile(self.min_clearance_m, 1.0 - SURELY))
        if clearance <= 0.0:
            return f"{head}{when}, of {runs}; some touch an obstacle.{self._belief}"
        return (
            f"{head}{when}, clears every obstacle by {clearance:.2f} m in {100 * SURELY:.0f} % of "
            f"{runs}.{self._belief}"
        )

    @property
    def _belief(self) -> str:
        """What the robot takes for arrived, where it is wrong."""
        missed = self.figures.verdict == Verdict.MISSED
        if not missed.any():
            return ""
        believes = missed | (self.figures.verdict == Verdict.ARRIVED)
        off = float(np.median(self.figures.final_error_m(self.goal)[missed]))
        return (
            f" The robot believes that it has arrived in {_percent(float(believes.mean()))}; in "
            f"{_percent(float(missed.mean()))} it is not there, {off:.2g} m off in the median."
        )

    def __repr__(self) -> str:
        counts = ", ".join(f"{o.count} {name}" for name, o in self.outcomes.items() if o.count)
        return f"<{type(self).__name__} of {self.n}: {counts}>"

    def _repr_html_(self) -> str:
        rows = [
            (name, str(o.count), f"{100 * o.share:.3g} %", " to ".join(map(_percent, o.interval)))
            for name, o in self.outcomes.items()
        ]
        heads = ("outcome", "runs", "share", "95 % interval")
        return html_lines(self.sentence) + html_table(rows, heads)

    def summary(self) -> dict[str, Any]:
        """Everything but the single runs, as plain values for a JSON document."""
        time, error = self.time_drivers, self.error_drivers
        return {
            "n": self.n,
            "seed": self.seed,
            "seconds": self.seconds,
            "vary": list(self.vary),
            "sentence": self.sentence,
            "outcomes": plain(self.outcomes),
            "time_s": quantiles(self.time_s),
            "min_clearance_m": quantiles(self.min_clearance_m),
            "final_error_m": quantiles(self.final_error_m),
            "redrawn": self.redrawn,
            "drivers": plain(time.ranked) if time else [],
            "unexplained_share": time.remainder if time else None,
            "drivers_of_final_error": plain(error.ranked) if error else [],
            "unexplained_share_of_final_error": error.remainder if error else None,
            "worst": plain(self.worst),
        }


COLUMNS = (
    "seed", "outcome", "time_s", "x", "y", "psi", "path_length_m", "min_clearance_m",
    "max_deviation_m",
)  # fmt: skip


def write_runs(batch: MissionRuns, path: Path) -> Path:
    """Write a CSV with the figures of every run, numbers unrounded; empty where there is none.

    Args:
        path: the file; it appears complete or not at all.
    """
    outcomes = [batch.figures.outcome(k) for k in range(batch.n)]
    figures = (getattr(batch.figures, name) for name in COLUMNS[2:])
    numbers = (np.where(np.isfinite(column), column, np.nan) for column in figures)
    columns = (np.array(batch.seeds), np.array(outcomes), *numbers)
    return write_columns(dict(zip(COLUMNS, columns, strict=True)), path)


def wilson(count: int, n: int) -> tuple[float, float]:
    """95 % interval of a probability from ``count`` of ``n`` (Wilson 1927).

    (p + z²/2n ± z √(p(1 − p)/n + z²/4n²)) / (1 + z²/n): inside 0 … 1, and of some width even where
    all runs or none ended so.
    """
    from scipy.stats import binomtest

    low, high = binomtest(count, n).proportion_ci(method="wilson")
    return float(low), float(high)


def quantiles(values: Array) -> dict[str, float] | None:
    """{p05, p50, p95}; None where there are no values."""
    if not len(values):
        return None
    values_at = np.quantile(values, (0.05, 0.5, 0.95)).tolist()
    return dict(zip(("p05", "p50", "p95"), values_at, strict=True))


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"
