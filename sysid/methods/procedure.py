"""The procedure of fits that choose: propose, estimate on all data, judge, and say what came of it.

A family proposes: it tries what its structure may hold (terms, units, mechanisms) on a part of the
estimation data, judges on the rest, refines the best, and so settles a structure. What its proposal
can be estimated as from all data is then judged by the free run over them; least squares one step
ahead stays a candidate to the end.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Allowed, Focus, Parameter, Problem
from sysid.fitting.searchable import InitialGuesses, StartReport
from sysid.fitting.solvers import Solution
from sysid.methods.method import Fitter
from sysid.methods.outcome import FitOutcome, outcome_of, with_covariance, worst
from sysid.structures.base import Structure


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

    def report(self, error: float) -> StartReport:
        """What became of it, judged by its error in free run."""
        known = error if np.isfinite(error) else None
        evaluations = sum(s.solution.evaluations for s in self.solved)
        return StartReport("all", f"all data, {self.how}", None, known, evaluations)


@dataclass(frozen=True, eq=False)
class Judgement:
    """An estimate in free run over the estimation data: its relative error, and what to know."""

    error: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Proposal:
    """What a family settled, and what can be made of it.

    Attributes:
        structure: with what was chosen.
        tried: what was tried on the way.
        estimates: of all data, the plainest first.
        table: θ → the parameters with their bounds, and with fixed values where θ is not estimated.
        judged: an estimate → its judgement.
        warnings: what the user should know whatever is chosen.
    """

    structure: Structure
    tried: Sequence[StartReport]
    estimates: Callable[[], Sequence[Estimate]]
    table: Callable[[Array], tuple[Parameter, ...]]
    judged: Callable[[Estimate], Judgement]
    warnings: tuple[str, ...] = ()


Propose = Callable[
    [Structure, Sequence[Record], FitOptions, tuple[Parameter, ...], InitialGuesses], Proposal
]
"""(structure, records, options, parameters, further starts) → what a family makes of them."""


def by_choice(propose: Propose) -> Fitter:
    """The fit of a family that proposes so."""

    def fit(
        structure: Structure,
        records: Sequence[Record],
        options: FitOptions,
        parameters: tuple[Parameter, ...],
        initial_guesses: InitialGuesses,
    ) -> FitOutcome:
        proposal = propose(structure, records, options, parameters, initial_guesses)
        estimates = proposal.estimates()
        judgements = [proposal.judged(e) for e in estimates]
        # with the focus on simulation one-step least squares is a start, no candidate
        first = 1 if options.focus is Focus.SIMULATION and len(estimates) > 1 else 0
        best = min(range(first, len(estimates)), key=lambda k: judgements[k].error)
        reports = [e.report(j.error) for e, j in zip(estimates, judgements, strict=True)]
        warnings = (*proposal.warnings, *judgements[best].warnings)
        return _outcome(proposal, estimates[best], (*proposal.tried, *reports), warnings)

    return fit


def _outcome(
    proposal: Proposal, best: Estimate, starts: Sequence[StartReport], warnings: Sequence[str]
) -> FitOutcome:
    table = proposal.table(best.theta)
    free = Allowed.by(table).free
    parts = []
    for s in best.solved:
        states = np.ones(s.problem.n_initial, dtype=bool)
        which = np.concatenate([free[s.problem.index], states])
        if s.determines is not None:
            which &= s.determines
        if which.any():
            parts.append(with_covariance(s.problem, s.solution, np.flatnonzero(which), s.samples))
    outcome = outcome_of(proposal.structure, table, best.theta, parts, starts, warnings)
    endings = [s.solution.termination for s in best.solved]
    return replace(outcome, termination=worst(endings))
