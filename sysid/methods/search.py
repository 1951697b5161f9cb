"""Parameter search of one fit: every initial guess, problem after problem, with initial states."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from scipy.special import fdtri

from sysid.data.record import Array, Index, Record, shortened
from sysid.errors import DataError, ModelError, Termination
from sysid.fitting.marquardt import Method as SolverMethod
from sysid.fitting.marquardt import loss
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import (
    Allowed,
    Focus,
    Initial,
    Parameter,
    Problem,
)
from sysid.fitting.refined_instruments import refined_instruments
from sysid.fitting.robust import UNBOUNDED, huber_widths, weighted
from sysid.fitting.searchable import InitialGuesses, Searchable, StartReport
from sysid.fitting.solvers import Descent, Solution, levenberg_marquardt
from sysid.fitting.state_prior import (
    PriorStates,
    RunawayStatesError,
    WatchedStates,
    descend_with_prior,
)
from sysid.fitting.uncertainty import PART, with_infinite
from sysid.methods.method import Method
from sysid.methods.outcome import FitOutcome, Part, outcome_of, with_covariance
from sysid.structures.base import Structure

STATE_LEVEL = 0.99
"""Confidence beyond which initial states are estimated rather than taken as zero."""

RIVAL = 1.2
"""Another start is searched too when its cost is below this multiple of the best start's."""

MAX_RUNS = 3
"""Searches a problem at most, unless all of them failed."""

USABLE = 1e50
"""Errors beyond this are those of a start that cannot be run."""


PIECES = 20_000
"""Samples, in evenly spread pieces, from which a search over long records finds its way."""

LONG = 4 * PIECES
"""Samples from which that pays: on all of them only the last steps are then taken."""

LINEAR = 0.5
"""Relative deviation from linearity up to which a start lies in the basin of a found minimum."""


class Search:
    """The search over starts, problem after problem."""

    def __init__(
        self,
        structure: Structure,
        asked: Searchable,
        records: Sequence[Record],
        options: FitOptions,
        parameters: Sequence[Parameter],
    ) -> None:
        self.structure, self.asked = structure, asked
        self.records, self.options = records, options
        self.allowed = Allowed.by(parameters)

    def run(
        self, initial_guesses: Sequence[tuple[str, Array]]
    ) -> tuple[Array, list[Part], tuple[StartReport, ...]]:
        """θ, the solved problems and what every start came to."""
        if sum(len(r) for r in self.records) > LONG:
            few = copy(self)
            few.records = shortened(self.records, PIECES)
            theta, _, reports_of_pieces = few._from([*few._own_starts(), *initial_guesses])
            theta, parts, reports = self._from([("pieces of the records", theta)])
            return theta, parts, (*reports_of_pieces, *reports)
        return self._from([*self._own_starts(), *initial_guesses])

    def _from(
        self, guesses: Sequence[tuple[str, Array]]
    ) -> tuple[Array, list[Part], tuple[StartReport, ...]]:
        thetas = [(n, self._admissible(t)) for n, t in guesses]
        if not thetas:
            raise ModelError(f"{self.structure.name} has no starting values; give it some")
        modes = {Initial.AUTO: Initial.ZERO}.get(self.options.initial, self.options.initial)
        first = self._problems(modes)
        other = self._problems(Initial.ESTIMATED) if modes is not self.options.initial else first
        theta = thetas[0][1].copy()
        parts: list[Part] = []
        reports: list[StartReport] = []
        for zero, estimated in zip(first, other, strict=True):
            candidates = [self._given(t, theta, parts) for _, t in thetas]
            names = [n for n, _ in thetas]
            part, report = self._solve(zero, estimated, names, candidates, theta)
            theta[part.problem.index] = part.solution.p[: len(part.problem.index)]
            parts.append(part)
            reports += report
        return theta, parts, tuple(reports)

    def _own_starts(self) -> Sequence[tuple[str, Array]]:
        return self.asked.starts(self.records, self.options.focus)

    def _problems(self, mode: Initial) -> tuple[Problem, ...]:
        mode = Initial.ESTIMATED if mode is Initial.BACKCAST else mode
        o = self.options
        problems = self.asked.problems(self.records, o.focus, mode, o.stable)
        return tuple(weighted(p, self.records) for p in problems)

    def _admissible(self, theta: Array) -> Array:
        run_freely = self.options.stable or self.options.focus is Focus.SIMULATION
        if run_freely:
            held = np.where(self.allowed.free, theta, self.allowed.fixed)
            theta = self.asked.stabilised(held)
        return self.allowed.nearest(theta)

    @staticmethod
    def _given(start: Array, theta: Array, parts: Sequence[Part]) -> Array:
        """A start with the entries that earlier problems have already settled."""
        out = start.copy()
        for part in parts:
            out[part.problem.index] = theta[part.problem.index]
        return out

    def _solve(
        self,
        zero: Problem,
        estimated: Problem,
        names: Sequence[str],
        candidates: Sequence[Array],
        theta: Array,
    ) -> tuple[Part, list[StartReport]]:
        base = self._given(theta, theta, ())
        zero, estimated = zero.given(base), estimated.given(base)
        costs = [loss(zero.residual(zero.initial_guess(t))) for t in candidates]
        order = sorted(range(len(costs)), key=lambda k: costs[k])
        self._check_equations(zero)
        huber = self._huber_width(zero, candidates[order[0]])
        problem = zero
        if estimated is not zero and self._states_matter(estimated, candidates[order[0]]):
            problem = estimated
        points = [self._with_states(problem, t) for t in candidates]
        if problem.n_initial or len(self._levels(problem)):
            # what states and levels explain says nothing about a start
            costs = [loss(problem.residual(p)) for p in points]
            order = sorted(range(len(costs)), key=lambda k: costs[k])
        runs = {order[0]: self._descend(problem, points[order[0]], huber)}
        # further searches where the best start is not clearly ahead or its search failed
        for k in order[1:]:
            failed = not any(run.termination.good for run in runs.values())
            close = costs[k] < RIVAL * costs[order[0]] and len(runs) < MAX_RUNS
            index = problem.index
            if any(np.array_equal(candidates[k][index], candidates[j][index]) for j in runs):
                continue
            if failed or (close and not self._known_basin(problem, runs, points[k])):
                runs[k] = self._descend(problem, points[k], huber)
        best = min(runs, key=lambda k: runs[k].cost)
        solution = runs[best]
        n = len(problem.index)
        if problem is zero and estimated is not zero:
            reached = theta.copy()
            reached[problem.index] = solution.p[:n]
            if self._states_matter(estimated, reached):
                problem = estimated
                solution = self._descend(problem, self._with_states(problem, reached), huber)
        if self.options.initial is Initial.BACKCAST:
            solution = self._backcast(problem, solution, huber)
        if solution.termination is Termination.DIVERGED:
            raise ModelError(f"{self.structure.name}: {Termination.DIVERGED.value}")
        channel = ",".join(sorted({self.records[0].output_names[i] for i in problem.channels}))
        reports = [
            StartReport(
                channel,
                names[k],
                costs[k] if np.isfinite(costs[k]) and costs[k] < 1e99 else None,
                runs[k].cost if k in runs else None,
                runs[k].evaluations if k in runs else 0,
            )
            for k in order
        ]
        return self._valued(problem, solution), reports

    def _check_equations(self, problem: Problem) -> None:
        """Refuse a problem with no more equations than unknowns."""
        equations, unknowns = sum(problem.lengths), int(np.sum(self._free(problem)))
        if equations <= unknowns:
            raise DataError(
                f"{self.records[0].name}: {equations} equations for {unknowns} unknowns "
                "(parameters and initial states); record longer, lower the orders or take the "
                "initial states as zero"
            )

    def _free(self, problem: Problem, states: bool = True) -> Array:
        return np.append(self.allowed.free[problem.index], np.full(problem.n_initial, states))

    def _limits(self, problem: Problem) -> tuple[Array, Array]:
        free = np.full(problem.n_initial, np.inf)
        return (
            np.append(self.allowed.lower[problem.index], -free),
            np.append(self.allowed.upper[problem.index], free),
        )

    def _descend(
        self,
        problem: Problem,
        p0: Array,
        huber: Array | None,
        states: bool = True,
    ) -> Solution:
        def descend(chosen: Problem, start: Array) -> Solution:
            lower, upper = self._limits(problem)
            width = huber
            if width is not None and isinstance(chosen, PriorStates):
                width = np.append(width, np.full(problem.n_initial, UNBOUNDED))
            how = Descent(
                free=self._free(problem, states),
                lower=lower,
                upper=upper,
                huber=width,
                max_evaluations=self.options.limit(),
                tolerance=self.options.precision(),
                patience=self.options.patience,
                method=self.options.method,
            )
            if instruments:
                return refined_instruments(chosen, start, how)
            return levenberg_marquardt(chosen, start, how)

        instruments = self.options.method is SolverMethod.SRIV
        if instruments or not (states and problem.n_initial):
            return descend(problem, p0)
        size = self._output_size(problem)
        try:
            return descend(WatchedStates(problem, size), p0)
        except RunawayStatesError:
            return descend_with_prior(problem, p0, size, descend, huber)

    def _output_size(self, problem: Problem) -> float:
        """‖y‖ of the outputs of a problem, over all records, in units of its errors."""
        which = sorted(set(problem.channels))
        parts = (np.sum((r.y[:, which] / problem.scales) ** 2) for r in self.records)
        return float(np.sqrt(sum(parts)))

    def _with_states(self, problem: Problem, theta: Array) -> Array:
        """A start with the initial states and levels that suit it best.

        The errors are linear in both, unless the problem says otherwise.
        """
        known = problem.with_states(theta)
        if known is not None:
            return known
        p = problem.initial_guess(theta)
        r = problem.residual(p)
        levels = self._levels(problem)
        if (problem.n_initial or len(levels)) and np.all(np.abs(r) < USABLE):
            basis, places = self._state_columns(problem, p, levels)
            size = np.linalg.norm(basis, axis=0)
            size[size == 0.0] = 1.0
            p[places] -= np.linalg.lstsq(basis / size, r, rcond=1e-12)[0] / size
        return p

    def _levels(self, problem: Problem) -> Index:
        """Entries of p that are levels: coefficients of a constant input."""
        return np.flatnonzero(np.isin(problem.index, self.asked.offset_entries()))

    @staticmethod
    def _state_columns(problem: Problem, p: Array, levels: Index) -> tuple[Array, Index]:
        """∂ε/∂(levels, initial states), and where these stand in p."""
        n = len(problem.index)
        places = np.concatenate([levels, n + np.arange(problem.n_initial)]).astype(np.intp)
        if len(levels):
            return problem.jacobian(p)[:, places], places
        return problem.initial_columns(p), places

    @staticmethod
    def _known_basin(problem: Problem, runs: Mapping[int, Solution], p: Array) -> bool:
        """Whether a start would lead where an earlier search ended.

        It does when between the two the errors change as the Jacobian there says: Gauss-Newton
        then goes from the one to the other.
        """
        r = problem.residual(p)
        for run in runs.values():
            change = r - run.residual
            linear = run.jacobian @ (p - run.p)
            if np.linalg.norm(change - linear) <= LINEAR * np.linalg.norm(change):
                return True
        return False

    def _huber_width(self, problem: Problem, theta: Array) -> Array | None:
        """Huber's threshold from the errors of a quick fit from the best start."""
        if not self.options.robust:
            return None
        quick = self._descend(problem, problem.initial_guess(theta), None)
        return huber_widths(problem, quick.residual)

    def _states_matter(self, problem: Problem, theta: Array) -> bool:
        """F-test of the initial states at fixed θ (they enter the errors linearly).

        What a level explains as well is no evidence for them.
        """
        k = problem.n_initial
        if k == 0:
            return False
        p = problem.initial_guess(theta)
        r = problem.residual(p)
        if not np.all(np.abs(r) < USABLE) or len(r) <= k + len(theta):
            return False
        levels = self._levels(problem)
        basis, _ = self._state_columns(problem, p, levels)
        size = np.linalg.norm(basis, axis=0)
        basis = basis / np.where(size > 0.0, size, 1.0)
        if len(levels):
            flat = np.linalg.qr(basis[:, : len(levels)])[0]
            r = r - flat @ (flat.T @ r)
            basis = basis[:, len(levels) :]
            basis = basis - flat @ (flat.T @ basis)
        share = basis.T @ r
        # from the k x k Gram matrix: k is small and the record long
        gained = float(share @ np.linalg.lstsq(basis.T @ basis, share, rcond=1e-12)[0])
        unexplained = max(float(r @ r) - gained, 1e-300)
        ratio = (gained / k) / (unexplained / (len(r) - k - len(problem.index)))
        return bool(ratio > fdtri(k, len(r) - k - len(problem.index), STATE_LEVEL))

    def _backcast(self, problem: Problem, solution: Solution, huber: Array | None) -> Solution:
        """Alternate: states by least squares with θ fixed, θ with the states fixed."""
        n = len(problem.index)
        p = solution.p
        for _ in range(3):
            r0 = problem.residual(np.concatenate([p[:n], np.zeros(problem.n_initial)]))
            basis = problem.initial_columns(p)
            p = np.concatenate([p[:n], np.linalg.lstsq(basis, -r0, rcond=1e-12)[0]])
            solution = self._descend(problem, p, huber, states=False)
            p = solution.p
        return solution

    def _valued(self, problem: Problem, solution: Solution) -> Part:
        free = self._free(problem, self.options.initial is not Initial.BACKCAST)
        return with_covariance(problem, solution, np.flatnonzero(free))


def by_search(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
    asked: Searchable | None = None,
) -> FitOutcome:
    """A search from every known start, problem after problem.

    Args:
        asked: what the search asks of the structure; the structure itself where it says it.

    Raises:
        ModelError: no start gives a finite cost, or the structure is not searchable.
    """
    if asked is None:
        if not isinstance(structure, Searchable):
            raise ModelError(
                f"{structure.name} has no method: derive it from Searchable too, or name a Method "
                "in the entry-point group sysid.methods"
            )
        asked = structure
    search = Search(structure, asked, records, options, parameters)
    theta, parts, starts = search.run(initial_guesses)
    outcome = outcome_of(structure, parameters, theta, parts, starts)
    more = asked.open_directions(records)
    if not more.size:
        return outcome
    covariance, null = _with_open(more, outcome.covariance, outcome.null)
    return replace(outcome, covariance=covariance, null=null, determined=None)


def _with_open(more: Array, covariance: Array, null: Array) -> tuple[Array, Array]:
    """Covariance and open directions with further ones, nothing said twice."""
    covered = np.max(np.abs(more), axis=1) > PART
    fresh = [d for d in null.T if np.any(np.abs(d[~covered]) > PART)]
    return with_infinite(covariance, more), np.column_stack([*fresh, *more.T])


METHOD = Method(by_search)
