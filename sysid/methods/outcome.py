"""What a fit gives: from solved problems to covariance, null directions and bounds."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array, Index
from sysid.errors import Termination
from sysid.fitting.outliers import Outliers
from sysid.fitting.problem import Parameter, Problem
from sysid.fitting.searchable import StartReport
from sysid.fitting.solvers import Solution
from sysid.fitting.uncertainty import Determined, Uncertainty, uncertainty
from sysid.structures.base import Structure


@dataclass(frozen=True, eq=False)
class FitOutcome:
    """What a fit found.

    Attributes:
        structure: what was fitted; with what was read off the data, where a structure does that.
        parameters: names, bounds and fixed values of θ.
        theta: estimates, (n,).
        covariance: their covariance, (n, n), infinite where the data say nothing.
        null: directions without information, (n, n_null).
        determined: what is known of functions of θ where ``null`` holds any.
        n_states: initial states that were estimated.
        at_bound: names of the parameters that ended on a bound.
        warnings: what the user should know.
        outliers: what was left out of each record, empty where nothing was looked for.
    """

    structure: Structure
    parameters: tuple[Parameter, ...]
    theta: Array
    covariance: Array
    null: Array
    n_states: int = 0
    termination: Termination = Termination.CONVERGED_COST
    at_bound: tuple[str, ...] = ()
    starts: tuple[StartReport, ...] = ()
    warnings: tuple[str, ...] = ()
    outliers: tuple[Outliers, ...] = ()
    determined: Determined | None = None

    def permuted(self, at: Index) -> "FitOutcome":
        """The same with the entries of θ that stand at ``at``, under the names as they are."""
        if np.array_equal(at, np.arange(len(self.theta))):
            return self
        names = [p.name for p in self.parameters]
        moved = {names[k]: names[i] for i, k in enumerate(at.tolist())}
        known = self.determined
        return replace(
            self,
            theta=self.theta[at],
            covariance=self.covariance[np.ix_(at, at)],
            null=self.null[at],
            at_bound=tuple(moved[n] for n in self.at_bound),
            determined=known and Determined(known.covariance[np.ix_(at, at)], known.open[at]),
        )


@dataclass(frozen=True, eq=False)
class Part:
    """One solved problem: which entries of θ, their covariance, the initial states found."""

    problem: Problem
    solution: Solution
    free: Index
    uncertainty: Uncertainty


def with_covariance(
    problem: Problem, solution: Solution, which: Index, samples: int | None = None
) -> Part:
    """A solved problem with the uncertainty of what it determined.

    Args:
        which: entries of the solution's p that were free.
        samples: errors of the data, which come first; all where None.
    """
    value = uncertainty(
        solution.jacobian[:samples, which],
        solution.residual[:samples],
        tuple(zip(problem.channels, problem.lengths, strict=True)),
        solution.weights[:samples],
    )
    return Part(problem, solution, which, value)


def assembled(parts: Sequence[Part], n: int) -> tuple[Array, Array, Determined | None]:
    """Covariance of θ, its directions without information and what is known beside them."""
    covariance, known = np.zeros((n, n)), np.zeros((n, n))
    null: list[Array] = []
    steps: list[Array] = []
    for part in parts:
        inside = part.free < len(part.problem.index)
        entries = part.problem.index[part.free[inside]]
        value, block = part.uncertainty, np.ix_(entries, entries)
        covariance[block] = value.covariance[np.ix_(inside, inside)]
        known[block] = value.determined.covariance[np.ix_(inside, inside)]
        for direction, step in zip(value.null.T, value.determined.open.T, strict=True):
            if np.linalg.norm(direction[inside]) > 1e-3 * np.linalg.norm(direction):
                spread, moved = np.zeros(n), np.zeros(n)
                spread[entries], moved[entries] = direction[inside], step[inside]
                null.append(spread / np.linalg.norm(spread))
                steps.append(moved)
    if not null:
        return covariance, np.zeros((n, 0)), None
    return covariance, np.array(null).T, Determined(known, np.array(steps).T)


def outcome_of(
    structure: Structure,
    parameters: tuple[Parameter, ...],
    theta: Array,
    parts: Sequence[Part],
    starts: Sequence[StartReport],
    warnings: Sequence[str] = (),
) -> FitOutcome:
    """The outcome of solved problems that together determine θ.

    Args:
        theta: estimates, (n,).
        warnings: what the user should know.
    """
    covariance, null, determined = assembled(parts, len(theta))
    return FitOutcome(
        structure,
        parameters,
        theta,
        covariance,
        null,
        n_states=sum(int(np.sum(p.free >= len(p.problem.index))) for p in parts),
        termination=worst([p.solution.termination for p in parts]),
        at_bound=tuple(
            parameters[p.problem.index[k]].name
            for p in parts
            for k in p.solution.at_bound
            if k < len(p.problem.index)
        ),
        starts=tuple(starts),
        warnings=tuple(warnings),
        determined=determined,
    )


def worst(endings: Sequence[Termination]) -> Termination:
    """The ending that says most about what went wrong."""
    order = list(Termination)
    return max(endings, key=order.index, default=Termination.NO_FREE_PARAMETERS)
