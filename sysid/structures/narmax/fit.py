"""Fit of polynomial NARMAX models: terms chosen on a hold-out, coefficients on all data."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array, Record, shortened
from sysid.errors import DataError, Termination, UsageError, argument
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Parameter, Problem
from sysid.fitting.robust import huber_widths, weighted
from sysid.fitting.solvers import Descent, Solution, levenberg_marquardt
from sysid.structures.base import Structure
from sysid.structures.difference_equations.frols import forward, term_gram
from sysid.structures.difference_equations.monomials import Term, is_noise
from sysid.structures.difference_equations.trials import (
    RUN_SAMPLES,
    SEARCH_SAMPLES,
    Estimate,
    start_report,
)
from sysid.structures.held_out_error import free_run_error
from sysid.structures.narmax.noise_terms import with_noise_terms
from sysid.structures.narmax.problems import ChunkedRuns
from sysid.structures.narmax.structure import NARMAX
from sysid.structures.narmax.term_search import search_terms
from sysid.structures.narmax.term_trials import LADDER, Row
from sysid.structures.orders import Orders
from sysid.structures.outcome import FitOutcome, StartReport
from sysid.structures.solved import outcome_of, with_covariance, worst

SEARCH_EVALUATIONS = 20
FINAL_EVALUATIONS = 60


def fit_narmax(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: Sequence[tuple[str, Array]],
) -> FitOutcome:
    """Choose the terms, estimate their coefficients, and say what they are worth.

    1. For each output, candidate terms of every degree and range of lags are ordered by their
       error reduction ratio; sizes up to that of lowest BIC are fitted by least squares and run
       freely over the estimation data, of which a held-out part counts.
    2. From the best, terms are added and left out by the simulation error of batched runs.
    3. The best few are refined in free run over chunks of growing length, then pruned.
    4. The winner's terms are fitted to all data: by least squares, and in free run where that won;
       the least-squares model stays a candidate to the end. Noise terms follow by extended least
       squares.

    With ``selection=err`` and prediction focus only step 1 and least squares are used.

    Raises:
        UsageError: parameters are fixed or bounded while the terms are still to be chosen.
        DataError: too few samples.
    """
    if not isinstance(structure, NARMAX):
        raise UsageError(f"{structure.name} is not a NARMAX structure")
    _check(structure, parameters, options)
    structure = structure.with_ranges(records)
    simulate = options.focus.value == "simulation"
    refine = simulate or structure.selection != "err"
    starts: list[StartReport] = []
    known: list[Mapping[Term, float]] = [{} for _ in range(structure.ny)]
    chunk = LADDER[-1] if refine else 0
    if not structure.terms:
        structure, chunk, starts, known = _searched(structure, records, options, refine)
    structure, notes = with_noise_terms(structure, records)
    structure = _with_err(structure, records)
    parameters = _with_constraints(structure, records[0], parameters)
    estimates = [_one_step(structure, records, options, parameters)]
    if chunk:
        estimates += _in_free_run(
            structure, records, options, estimates[0], known, chunk, parameters
        )
    trial, more = _chosen(structure, records, estimates, options)
    return _outcome(structure, records, parameters, trial, (*starts, *more), notes)


# ------------------------------------------------------------------------------- terms


def _check(s: NARMAX, parameters: Sequence[Parameter], options: FitOptions) -> None:
    if not s.terms and (options.fixed or options.bounds):
        raise UsageError(
            "narmax chooses its terms from the data; to fix or bound a coefficient, give the "
            f"terms, e.g. {argument(structure_options={'terms': 'y(t-1), u(t-1), u(t-1)*y(t-1)'})}"
        )


def _searched(
    s: NARMAX, records: Sequence[Record], options: FitOptions, refine: bool
) -> tuple[NARMAX, int, list[StartReport], list[Mapping[Term, float]]]:
    """The structure with the terms that did best on held-out data, output by output.

    Also the chunk length their coefficients were refined with, every trial, and the coefficients.
    """
    small = shortened(records, SEARCH_SAMPLES)
    if max(len(r) for r in small) < 3 * (s.first_sample() + 20):
        raise DataError(
            f"{records[0].name}: {sum(len(r) for r in records)} samples are too few to choose the "
            f"terms of a narmax model with these lags; record more or lower na and nb"
        )
    rows: list[tuple[Term, ...]] = []
    starts: list[StartReport] = []
    known: list[Mapping[Term, float]] = []
    chunk = 0
    limit = min(options.limit(), SEARCH_EVALUATIONS)
    for i, channel in enumerate(records[0].outputs):
        row = Row(s, i, small)
        trial, tried = search_terms(row, refine, limit)
        rows.append(tuple(row.outward(t) for t in trial.terms))
        theta = np.mean(trial.theta, axis=0).tolist()
        known.append(dict(zip(rows[-1], theta, strict=True)))
        chunk = max(chunk, trial.chunk)
        starts += [
            start_report(channel.name, t.how, t.error) for t in sorted(tried, key=lambda t: t.error)
        ]
    orders = _without_lag_zero(s.orders, rows)
    return replace(s, orders=orders, terms=tuple(rows)), chunk, starts, known


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


def _with_constraints(
    s: NARMAX, record: Record, constrained: Sequence[Parameter]
) -> tuple[Parameter, ...]:
    """The chosen structure's parameters with the user's bounds and fixed values."""
    known = {p.name: p for p in constrained}
    return tuple(known.get(p.name, p) for p in s.parameters(record.inputs, record.outputs))


# ------------------------------------------------------------------------- coefficients


def _constraints(parameters: Sequence[Parameter]) -> tuple[Array, Array, Array, Array]:
    """Fixed values (NaN where free), free mask, lower and upper bounds."""
    fixed = np.array([np.nan if p.fixed is None else p.fixed for p in parameters])
    lower, upper = (np.array([getattr(p, k) for p in parameters]) for k in ("lower", "upper"))
    return fixed, np.isnan(fixed), lower, upper


def _one_step(
    s: NARMAX, records: Sequence[Record], options: FitOptions, parameters: Sequence[Parameter]
) -> Estimate:
    """Least squares, iterated where noise terms or the Huber loss ask for it."""
    data = [(r.u, r.y) for r in records]
    fixed, free, lower, upper = _constraints(parameters)
    theta = np.where(free, 0.0, fixed)
    solved: list[tuple[Problem, Solution, int]] = []
    for i in range(s.ny):
        problem = weighted(s.one_step(i, data), records)
        index = problem.index
        p = theta[index].copy()
        # noise terms begin at zero: without errors known the output itself would stand for them
        process = free[index] & np.array([not is_noise(t) for t in s.rows[i]])
        p[process] = _linear(problem, p, process)
        p = np.clip(p, lower[index], upper[index])
        huber = huber_widths(problem, problem.residual(p)) if options.robust else None
        solution = levenberg_marquardt(
            problem,
            p,
            Descent(
                free[index], lower[index], upper[index], huber, max_evaluations=options.limit()
            ),
        )
        theta[index] = solution.p
        solved.append((problem, solution, sum(problem.lengths)))
    return Estimate(theta, tuple(solved), "least squares")


def _linear(problem: Problem, p: Array, free: Array) -> Array:
    """Least squares by QR of the columns scaled to unit norm, entries that are not free as in p."""
    fixed_part = np.where(free, 0.0, p)
    J, e = problem.jacobian(fixed_part)[:, free], problem.residual(fixed_part)
    norms = np.linalg.norm(J, axis=0)
    norms[norms == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(J / norms, -e, rcond=1e-12)[0] / norms)


def _in_free_run(
    s: NARMAX,
    records: Sequence[Record],
    options: FitOptions,
    start: Estimate,
    known: Sequence[Mapping[Term, float]],
    chunk: int,
    parameters: Sequence[Parameter],
) -> list[Estimate]:
    """Coefficients of the process in free run, noise terms after.

    From least squares over longer and longer chunks, and from the search's own coefficients at
    once: they are already those of free runs.
    """
    small = shortened(records, RUN_SAMPLES)
    longest = max(len(r) for r in small)
    rungs = list(dict.fromkeys(min(c, longest) for c in (*LADDER, chunk) if c <= chunk))
    theta, solutions = start.theta, []
    for rung in rungs:
        theta, estimate = _over_chunks(s, (records, small), options, theta, rung, parameters, "")
        solutions.append(estimate)
    guess = start.theta.copy()
    for i, row in enumerate(s.rows):
        for k, t in zip(s.row_index(i), row, strict=True):
            if parameters[k].fixed is None:
                guess[k] = known[i].get(t, guess[k])
    if any(known):
        words = " from the search's values"
        last = _over_chunks(s, (records, small), options, guess, rungs[-1], parameters, words)
        solutions.append(last[1])
    return solutions


def _over_chunks(
    s: NARMAX,
    all_and_some: tuple[Sequence[Record], Sequence[Record]],
    options: FitOptions,
    start: Array,
    chunk: int,
    parameters: Sequence[Parameter],
    words: str,
) -> tuple[Array, Estimate]:
    """One refinement on some of the records, noise terms on all: θ and what determined it."""
    records, small = all_and_some
    data = [(r.u, r.y) for r in small]
    problem = s.over_chunks(data, chunk)
    _, free, lower, upper = _constraints(parameters)
    index, theta = problem.index, start.copy()
    counted = weighted(problem, small)
    solution = levenberg_marquardt(
        counted,
        theta[index],
        Descent(
            free=free[index],
            lower=lower[index],
            upper=upper[index],
            huber=huber_widths(counted, counted.residual(theta[index])) if options.robust else None,
            max_evaluations=options.limit(FINAL_EVALUATIONS),
            tolerance=options.precision(1e-7),
            method=options.method,
        ),
    )
    theta[index] = solution.p
    solved: list[tuple[Problem, Solution, int]] = [(problem, solution, sum(problem.lengths))]
    for i, row in enumerate(s.rows):
        noise = np.array([is_noise(t) for t in row])
        if noise.any():
            one = weighted(s.one_step(i, [(r.u, r.y) for r in records]), records)
            where = one.index
            after = levenberg_marquardt(
                one,
                theta[where],
                Descent(
                    free[where] & noise,
                    lower[where],
                    upper[where],
                    huber_widths(one, one.residual(theta[where])) if options.robust else None,
                ),
            )
            theta[where] = after.p
            solved.append((one, after, sum(one.lengths)))
    return theta, Estimate(theta, tuple(solved), f"refined over {chunk} samples{words}")


def _chosen(
    s: NARMAX, records: Sequence[Record], estimates: Sequence[Estimate], options: FitOptions
) -> tuple[Estimate, list[StartReport]]:
    """The estimate with the best free run over the estimation data."""
    counted = [r.counted for r in records]
    errors = [free_run_error(s, e.theta, records, counted, options.robust) for e in estimates]
    simulate = options.focus.value == "simulation"
    starts = [e.report(error) for e, error in zip(estimates, errors, strict=True)]
    order = range(1 if simulate and len(estimates) > 1 else 0, len(estimates))
    return estimates[min(order, key=lambda k: errors[k])], starts


def _outcome(
    s: NARMAX,
    records: Sequence[Record],
    parameters: tuple[Parameter, ...],
    estimate: Estimate,
    starts: Sequence[StartReport],
    notes: Sequence[str],
) -> FitOutcome:
    _, free, _, _ = _constraints(parameters)
    noise = np.array([is_noise(t) for row in s.rows for t in row])
    alternate = any(isinstance(problem, ChunkedRuns) for problem, _, _ in estimate.solved)
    parts = []
    for problem, solution, samples in estimate.solved:
        free_entries = free[problem.index]
        if alternate:  # free runs determine the process, one step ahead follow the noise terms
            free_entries = free_entries & (noise[problem.index] != isinstance(problem, ChunkedRuns))
        if free_entries.any():
            parts.append(with_covariance(problem, solution, np.flatnonzero(free_entries), samples))
    runs = s.free_run().measured(estimate.theta, records)
    advice = "there the polynomial diverges; lower the degree or the number of terms"
    notes = (*notes, *s.limit_warnings(runs, records[0].outputs, advice))
    outcome = outcome_of(s, parameters, estimate.theta, parts, starts, notes)
    ending = worst([solution.termination for _, solution, _ in estimate.solved])
    linear = estimate.how == "least squares" and not noise.any() and not outcome.at_bound
    return replace(
        outcome, termination=Termination.CLOSED_FORM if linear and ending.good else ending
    )
