"""Polynomial NARMAX models: terms chosen on a hold-out, coefficients on all data."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record, shortened
from sysid.errors import DataError, Termination, UsageError, argument
from sysid.fitting.marquardt import Method as SolverMethod
from sysid.fitting.normal_equations import scaled_lstsq
from sysid.fitting.options import EVALUATIONS, FitOptions
from sysid.fitting.problem import Allowed, Focus, Parameter, Problem
from sysid.fitting.robust import huber_widths, weighted
from sysid.fitting.searchable import InitialGuesses, StartReport
from sysid.fitting.solvers import TOLERANCE, Descent, Solution, levenberg_marquardt
from sysid.methods.equations import (
    Estimate,
    Solved,
    best_in_free_run,
    outcome_of_estimate,
    searched,
)
from sysid.methods.method import Method
from sysid.methods.outcome import FitOutcome
from sysid.structures.base import Structure
from sysid.structures.difference_equations.frols import forward, term_gram
from sysid.structures.difference_equations.monomials import Term, is_noise
from sysid.structures.difference_equations.trials import RUN_SAMPLES, SEARCH_SAMPLES
from sysid.structures.narmax.noise_terms import with_noise_terms
from sysid.structures.narmax.structure import NARMAX
from sysid.structures.narmax.term_search import search_terms
from sysid.structures.narmax.term_trials import LADDER, Row
from sysid.structures.orders import Orders

SEARCH_EVALUATIONS = 20
FINAL_EVALUATIONS = 60

Coefficients = Mapping[Term, float]


def fit(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """Choose the terms, then fit their coefficients to everything.

    1. For each output, candidate terms of every degree and range of lags are ordered by their
       error reduction ratio; sizes up to that of lowest BIC are fitted by least squares and run
       freely over the estimation data, of which a held-out part counts.
    2. From the best, terms are added and left out by the simulation error of batched runs.
    3. The best few are refined in free run over chunks of growing length, then pruned.
    4. The winner's terms are fitted to all data: by least squares, and in free run where that won.
       Noise terms follow by extended least squares.

    With ``selection=err`` and prediction focus only step 1 and least squares are used.
    """
    assert isinstance(structure, NARMAX)
    _check(structure, options)
    s = structure.with_ranges(records)
    refine = options.focus is Focus.SIMULATION or s.selection != "err"
    tried: list[StartReport] = []
    known: list[Coefficients] = [{} for _ in range(s.ny)]
    chunk = LADDER[-1] if refine else 0
    if not s.terms:
        s, chunk, tried, known = _searched(s, records, options, refine)
    s, notes = with_noise_terms(s, records)
    s = _with_err(s, records)
    given = {p.name: p for p in parameters}
    named = s.parameters(records[0].inputs, records[0].outputs)
    table = tuple(given.get(p.name, p) for p in named)  # with the user's bounds and fixed values
    fits = _Fits(s, records, options, table)
    plain = fits.one_step()
    estimates = [plain, *(fits.in_free_run(plain, known, chunk) if chunk else ())]
    advice = "there the polynomial diverges; lower the degree or the number of terms"
    best, judged, warnings = best_in_free_run(s, s.free_run(), estimates, records, options, advice)
    return outcome_of_estimate(s, table, best, (*tried, *judged), (*notes, *warnings))


# ------------------------------------------------------------------------------- terms


def _check(s: NARMAX, options: FitOptions) -> None:
    if not s.terms and (options.fixed or options.bounds):
        raise UsageError(
            "narmax chooses its terms from the data; to fix or bound a coefficient, give the "
            f"terms, e.g. {argument(structure_options={'terms': 'y(t-1), u(t-1), u(t-1)*y(t-1)'})}"
        )


def _searched(
    s: NARMAX, records: Sequence[Record], options: FitOptions, refine: bool
) -> tuple[NARMAX, int, list[StartReport], list[Coefficients]]:
    """The structure with the terms that did best on held-out data, output by output.

    Also the chunk length their coefficients were refined with, every trial, and the coefficients.
    """
    small = shortened(records, SEARCH_SAMPLES)
    if max(len(r) for r in small) < 3 * (s.first_sample() + 20):
        raise DataError(
            f"{records[0].name}: {sum(len(r) for r in records)} samples are too few to choose the "
            f"terms of a narmax model with these lags; record more or lower na and nb"
        )
    limit = min(options.limit(), SEARCH_EVALUATIONS)
    rows = [Row(s, i, small) for i in range(s.ny)]
    searches = [partial(search_terms, row, refine, limit) for row in rows]
    winners, tried = searched(records[0].outputs, searches)
    terms = [
        tuple(row.outward(t) for t in trial.terms) for row, trial in zip(rows, winners, strict=True)
    ]
    known: list[Coefficients] = [
        dict(zip(of_row, np.mean(trial.theta, axis=0).tolist(), strict=True))
        for of_row, trial in zip(terms, winners, strict=True)
    ]
    chosen = replace(s, orders=_without_lag_zero(s.orders, terms), terms=tuple(terms))
    return chosen, max(trial.chunk for trial in winners), tried, known


def _without_lag_zero(orders: Orders, rows: Sequence[tuple[Term, ...]]) -> Orders:
    """The orders with nk = 1 where it is 0 and no chosen term holds the input of the same sample.

    A model that answers within the sample closes an algebraic loop wherever it is used.
    """
    nb, nk = [list(row) for row in orders.nb], [list(row) for row in orders.nk]
    for i, row in enumerate(rows):
        used = {f.channel for t in row for f in t if f.kind == "u" and f.lag == 0}
        for j, delay in enumerate(nk[i]):
            if delay == 0 and nb[i][j] > 1 and j not in used:
                nb[i][j], nk[i][j] = nb[i][j] - 1, 1
    return replace(orders, nb=tuple(map(tuple, nb)), nk=tuple(map(tuple, nk)))


def _with_err(s: NARMAX, records: Sequence[Record]) -> NARMAX:
    """Process terms in the order of their error reduction ratios, with these in percent."""
    data = [(r.u, r.y) for r in records]
    rows, ratios = [], []
    for i, row in enumerate(s.rows):
        plain = [t for t in row if not is_noise(t)]
        gram = term_gram(plain, data, i, s.first_sample())
        path = forward(gram, range(len(plain)), len(plain))
        rest = [k for k in range(len(plain)) if k not in set(path.order.tolist())]
        noise = [t for t in row if is_noise(t)]
        rows.append((*(plain[k] for k in [*path.order, *rest]), *noise))
        shares = [100.0 * float(v) for v in path.err]
        ratios.append((*shares, *[0.0] * (len(rest) + len(noise))))
    return replace(s, terms=tuple(rows), err=tuple(ratios))


# ------------------------------------------------------------------------- coefficients


class _Fits:
    """Coefficients of chosen terms on all data, within the user's bounds."""

    def __init__(
        self,
        s: NARMAX,
        records: Sequence[Record],
        options: FitOptions,
        table: Sequence[Parameter],
    ) -> None:
        self.s, self.records, self.options = s, records, options
        self.allowed = Allowed.by(table)
        self.free = self.allowed.free
        self.noise: NDArray[np.bool_] = np.array(
            [is_noise(t) for row in s.rows for t in row], dtype=bool
        )

    def one_step(self) -> Estimate:
        """Least squares, iterated where noise terms or the Huber loss ask for it."""
        theta = np.where(self.free, 0.0, self.allowed.fixed)
        solved = []
        for i in range(self.s.ny):
            problem = self._ahead(i)
            index = problem.index
            p = theta[index].copy()
            # noise terms begin at zero: without errors known the output itself would stand for them
            process = self.free[index] & ~self.noise[index]
            p[process] = _linear(problem, p, process)
            theta[index] = p
            theta = self.allowed.nearest(theta)
            solution = self._descended(problem, theta, self.free, limit=self.options.limit())
            if solution.termination.good and not (self.noise[index].any() or solution.at_bound):
                solution = replace(solution, termination=Termination.CLOSED_FORM)
            theta[index] = solution.p
            solved.append(Solved(problem, solution))
        return Estimate(theta, tuple(solved), "least squares")

    def in_free_run(
        self, start: Estimate, known: Sequence[Coefficients], chunk: int
    ) -> list[Estimate]:
        """Coefficients of the process in free run, noise terms after.

        From least squares over longer and longer chunks, and from the search's own coefficients at
        once: they are already those of free runs.
        """
        small = shortened(self.records, RUN_SAMPLES)
        longest = max(len(r) for r in small)
        rungs = list(dict.fromkeys(min(c, longest) for c in (*LADDER, chunk) if c <= chunk))
        estimates, theta = [], start.theta
        for rung in rungs:
            estimates.append(self._over_chunks(small, theta, rung))
            theta = estimates[-1].theta
        if any(known):
            guess = start.theta.copy()
            for i, row in enumerate(self.s.rows):
                for k, t in zip(self.s.row_index(i), row, strict=True):
                    if self.free[k]:
                        guess[k] = known[i].get(t, guess[k])
            last = self._over_chunks(small, guess, rungs[-1])
            estimates.append(replace(last, how=f"{last.how} from the search's values"))
        return estimates

    def _over_chunks(self, small: Sequence[Record], start: Array, chunk: int) -> Estimate:
        """One refinement on some of the records, noise terms on all."""
        problem = weighted(self.s.over_chunks([(r.u, r.y) for r in small], chunk), small)
        theta = start.copy()
        solution = self._descended(
            problem,
            theta,
            self.free,
            limit=self.options.limit(FINAL_EVALUATIONS),
            tolerance=self.options.precision(1e-7),
            method=self.options.method,
        )
        theta[problem.index] = solution.p
        # free runs determine the process, one step ahead follow the noise terms
        solved = [Solved(problem, solution, determines=~self.noise[problem.index])]
        for i in range(self.s.ny):
            ahead = self._ahead(i)
            noise = self.noise[ahead.index]
            if noise.any():
                after = self._descended(ahead, theta, self.free & self.noise)
                theta[ahead.index] = after.p
                solved.append(Solved(ahead, after, determines=noise))
        return Estimate(theta, tuple(solved), f"refined over {chunk} samples")

    def _ahead(self, output: int) -> Problem:
        data = [(r.u, r.y) for r in self.records]
        return weighted(self.s.one_step(output, data), self.records)

    def _descended(
        self,
        problem: Problem,
        theta: Array,
        free: NDArray[np.bool_],
        limit: int = EVALUATIONS,
        tolerance: float = TOLERANCE,
        method: SolverMethod = SolverMethod.LEVENBERG_MARQUARDT,
    ) -> Solution:
        """A problem's descent from θ within the bounds, by Huber's loss where it is asked for."""
        index, p = problem.index, theta[problem.index]
        huber = huber_widths(problem, problem.residual(p)) if self.options.robust else None
        lower, upper = self.allowed.lower[index], self.allowed.upper[index]
        how = Descent(free[index], lower, upper, huber, limit, tolerance, method=method)
        return levenberg_marquardt(problem, p, how)


def _linear(problem: Problem, p: Array, free: NDArray[np.bool_]) -> Array:
    """Least squares of the free entries, the others as in p."""
    fixed_part = np.where(free, 0.0, p)
    J, e = problem.jacobian(fixed_part)[:, free], problem.residual(fixed_part)
    return scaled_lstsq(J, -e)


METHOD = Method(fit)
