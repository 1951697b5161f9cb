"""How equations that feed back are fitted: what was proposed is estimated and judged in free run.

A family tries what its structure may hold (terms, units) on a part of the estimation data, judges
on the rest, refines the best, and so settles a structure. What can be made of it from all data is
then judged by the free run over them; least squares one step ahead stays a candidate to the end.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Channel, Record
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Allowed, Focus, Parameter, Problem
from sysid.fitting.searchable import StartReport
from sysid.fitting.solvers import Solution
from sysid.methods.held_out_error import relative_error
from sysid.methods.outcome import FitOutcome, outcome_of, with_covariance, worst
from sysid.structures.difference_equations.free_run import FreeRun
from sysid.structures.difference_equations.structure import RecursiveStructure
from sysid.structures.difference_equations.trials import Trial


@dataclass(frozen=True, eq=False)
class Solved:
    """A problem with its solution.

    Attributes:
        samples: errors of data, which come first; all where None.
        determines: which entries of p it determines, (len(p),); all that are free where None.
    """

    problem: Problem
    solution: Solution
    samples: int | None = None
    determines: NDArray[np.bool_] | None = None


@dataclass(frozen=True, eq=False)
class Estimate:
    """θ of a whole structure from all data.

    Attributes:
        solved: problems that determined it.
        how: in words.
    """

    theta: Array
    solved: tuple[Solved, ...]
    how: str

    @property
    def evaluations(self) -> int:
        return sum(s.solution.evaluations for s in self.solved)


def searched(
    outputs: Sequence[Channel], searches: Sequence[Callable[[], tuple[Trial, list[Trial]]]]
) -> tuple[list[Trial], list[StartReport]]:
    """The best equation of each output, and what became of every trial, best first.

    Args:
        searches: of each output; gives the best and all.
    """
    winners, reports = [], []
    for channel, search in zip(outputs, searches, strict=True):
        best, tried = search()
        winners.append(best)
        reports += [
            StartReport(channel.name, t.how, _known(t.error), _known(t.error), t.evaluations)
            for t in sorted(tried, key=lambda t: t.error)
        ]
    return winners, reports


def best_in_free_run(
    s: RecursiveStructure,
    run: FreeRun,
    estimates: Sequence[Estimate],
    records: Sequence[Record],
    options: FitOptions,
    advice: str,
) -> tuple[Estimate, list[StartReport], tuple[str, ...]]:
    """The estimate whose free run over the data errs least, and what became of all.

    Args:
        run: the equations of the structure.
        estimates: the plainest first: with the focus on simulation it is a start, no candidate.
        advice: what to do about outputs that free runs hold at a limit.

    Returns:
        (the best, a report of each, sentences about the best).
    """
    first = s.first_sample()
    used = [r for r in records if len(r) > first]
    counted = np.concatenate([r.counted[first:] for r in used])
    measured = np.concatenate([r.y[first:] for r in used])[counted]
    runs = [run.measured(e.theta, records) for e in estimates]
    with np.errstate(over="ignore", invalid="ignore"):
        errors = [
            relative_error(measured - np.concatenate(r)[counted], measured, options.robust)
            for r in runs
        ]
    begin = 1 if options.focus is Focus.SIMULATION and len(estimates) > 1 else 0
    best = min(range(begin, len(estimates)), key=lambda k: errors[k])
    reports = [
        StartReport("all", f"all data, {e.how}", None, _known(error), e.evaluations)
        for e, error in zip(estimates, errors, strict=True)
    ]
    return estimates[best], reports, s.limit_warnings(runs[best], records[0].outputs, advice)


def outcome_of_estimate(
    structure: RecursiveStructure,
    table: tuple[Parameter, ...],
    best: Estimate,
    starts: Sequence[StartReport],
    warnings: Sequence[str],
) -> FitOutcome:
    """The outcome of an estimate, with the covariance of what its problems determined."""
    free = Allowed.by(table).free
    parts = []
    for s in best.solved:
        which = np.append(free[s.problem.index], np.ones(s.problem.n_initial, dtype=bool))
        if s.determines is not None:
            which &= s.determines
        if which.any():
            parts.append(with_covariance(s.problem, s.solution, np.flatnonzero(which), s.samples))
    outcome = outcome_of(structure, table, best.theta, parts, starts, warnings)
    return replace(outcome, termination=worst([s.solution.termination for s in best.solved]))


def _known(error: float) -> float | None:
    return error if np.isfinite(error) else None
