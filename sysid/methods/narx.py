"""NARX networks: each output's map is chosen on a hold-out, then all is refined."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from sysid.data.record import Array, Record, shortened
from sysid.errors import DataError, ModelError, Termination, UsageError
from sysid.fitting.holdout import HoldOut, hold_out
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus, Parameter
from sysid.fitting.robust import weighted
from sysid.fitting.searchable import InitialGuesses
from sysid.fitting.solvers import Descent, evaluated, levenberg_marquardt
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
from sysid.structures.difference_equations.chunks import ChunkedRuns
from sysid.structures.difference_equations.trials import RUN_SAMPLES, SEARCH_SAMPLES
from sysid.structures.narx.search import RUNGS, SHORT, largest, search_row
from sysid.structures.narx.simulation_error import RowRuns, Trial
from sysid.structures.narx.structure import NarxWavelet, OneStepRow
from sysid.structures.narx.wavelet_frame import least_squares

ROUNDS, FEWER_ROUNDS = 20, 14
"""Evaluations on all data; the second where there are at least SHORT samples."""

TOLERANCE = 1e-6

COMPILED_FROM = 2_000
"""Samples from which the free runs at last are compiled: JAX is loaded anyway."""


def fit(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """Choose products and units, then fit all of it to everything.

    1. For each output, products of several degrees and units over several sets of regressors are
       added to the linear part by orthogonal least squares, in several numbers up to what
       generalised cross-validation allows. Each map runs freely over the estimation data, of which
       a held-out part counts.
    2. The best few of different kinds are refined side by side on free runs over chunks of growing
       length.
    3. The winner on the held-out part, a least-squares map or a refined one, is estimated again on
       all data: by least squares and, where refinement won, on free runs, at last all outputs
       together within bounds.
    """
    assert isinstance(structure, NarxWavelet)
    _check(structure, records, options)
    s = structure.with_ranges(records)
    data = hold_out(shortened(records, SEARCH_SAMPLES))
    rungs = _rungs(s, options)
    rows = [RowRuns(s, i, data, largest(s)) for i in range(s.ny)]
    for row in rows:
        if len(row.y) < 2 * len(row.row) + 10:
            raise DataError(
                f"{records[0].name}: {len(row.y)} equations are too few to choose a network over "
                f"{len(row.row)} regressors; record more or lower na and nb"
            )
    simulate = options.focus is Focus.SIMULATION
    searches = [partial(search_row, row, rungs, simulate) for row in rows]
    winners, tried = searched(records[0].outputs, searches)
    for channel, winner in zip(records[0].outputs, winners, strict=True):
        if not np.isfinite(winner.error):
            raise ModelError(
                f"{channel.name}: no narx-wavelet model has a finite free run on these data; "
                "lower the orders or check the data"
            )
    s = replace(s, designs=tuple(t.design for t in winners))

    estimates = _on_all_data(s, records, options, winners)
    run = s.free_run(compiled_from=COMPILED_FROM)
    advice = "lower the orders or the number of units"
    best, judged, warnings = best_in_free_run(s, run, estimates, records, options, advice)
    table = _with_fixed_boxes(s, records[0], best.theta)
    return outcome_of_estimate(s, table, best, (*tried, *judged), warnings)


def _check(s: NarxWavelet, records: Sequence[Record], options: FitOptions) -> None:
    if options.fixed or options.bounds:
        raise UsageError(
            "narx-wavelet places its units by the data; no parameter of it can be fixed or bounded"
        )
    needed = s.first_sample() + 20
    if max(len(r) for r in records) <= needed:
        raise DataError(
            f"{records[0].name}: {sum(len(r) for r in records)} samples are too few for a "
            "narx-wavelet model with these lags; record more or lower na and nb"
        )


def _rungs(s: NarxWavelet, options: FitOptions) -> tuple[int, ...]:
    """Chunk lengths of the refinement, none where least squares is asked for."""
    length = s.options_given.refine
    if options.patience is not None:
        # orders are ranked by least squares: the order of the candidates is the same
        return ()
    if length == 0:
        if options.focus is Focus.SIMULATION:
            raise UsageError(
                "`structure_options={'refine': 'none'}` fits one step ahead; leave out "
                "`focus='simulation'`"
            )
        return ()
    if length is None:
        return RUNGS
    return (*(r for r in RUNGS if r < length), length)


def _on_all_data(
    s: NarxWavelet, records: Sequence[Record], options: FitOptions, winners: Sequence[Trial]
) -> list[Estimate]:
    """Least squares, and what refinement makes of the winners."""
    whole = all_data(records)
    rows = [RowRuns(s, i, whole, largest(s)) for i in range(s.ny)]
    plain = [_least_squares(row, t) for row, t in zip(rows, winners, strict=True)]
    run = s.free_run()
    solved = []
    for i, theta in enumerate(plain):
        ahead = weighted(OneStepRow(run, i, [(r.u, r.y) for r in records]), records)
        solved.append(Solved(ahead, evaluated(ahead, theta, Termination.CLOSED_FORM)))
    estimates = [Estimate(np.concatenate(plain), tuple(solved), "least squares")]
    if any(t.chunk for t in winners):
        start = [t.theta if t.chunk else linear for t, linear in zip(winners, plain, strict=True)]
        chunk = max(t.chunk for t in winners)
        estimates.append(_all_rows_refined(rows, records, options, np.concatenate(start), chunk))
    return estimates


def all_data(records: Sequence[Record]) -> HoldOut:
    """All data to fit on, all of them to judge on."""
    small = shortened(records, RUN_SAMPLES)
    counted = tuple(np.ones(len(r), dtype=bool) for r in small)
    return HoldOut(small, (), small, counted, "the estimation data")


def _least_squares(row: RowRuns, t: Trial) -> Array:
    """The trial's map with amplitudes from all data, its units where they are."""
    w = t.design.weights(t.theta)
    units = (w.shape, w.place, np.array(t.design.flags, dtype=np.float64))
    return least_squares(t.design, row.estimator, row.x, row.y, units)


def _all_rows_refined(
    rows: Sequence[RowRuns],
    records: Sequence[Record],
    options: FitOptions,
    theta: Array,
    chunk: int,
) -> Estimate:
    """All rows refined at once within bounds: outputs see each other's simulated past."""
    s = rows[0].structure
    small = shortened(records, RUN_SAMPLES)
    data = [(r.u, r.y) for r in small]
    samples = sum(len(y) for _, y in data)
    run = s.free_run()
    designed = list(zip(rows, s.designs, strict=True))
    each = zip(*(row.prior(d) for row, d in designed), strict=True)
    lower, upper, free, share, to_zero = (np.concatenate(parts) for parts in each)
    cost = float(np.sum(ChunkedRuns(run, data, chunk).residual(theta) ** 2))
    pull = np.sqrt(share * cost) / np.concatenate([row.sizes(d) for row, d in designed])
    bare = ChunkedRuns(run, data, chunk, pull=pull, centre=np.where(to_zero, 0.0, theta))
    problem = weighted(bare, small, more=int(np.count_nonzero(pull)))
    solution = levenberg_marquardt(
        problem,
        np.clip(theta, lower, upper),
        Descent(
            free=free,
            lower=lower,
            upper=upper,
            max_evaluations=options.limit(ROUNDS if samples < SHORT else FEWER_ROUNDS),
            tolerance=options.precision(TOLERANCE),
            regular=True,
        ),
    )
    solved = Solved(problem, solution, bare.samples)
    return Estimate(solution.p, (solved,), f"refined over {chunk} samples")


def _with_fixed_boxes(s: NarxWavelet, record: Record, theta: Array) -> tuple[Parameter, ...]:
    """Parameters with the values of what cannot be estimated: places of boxes."""
    named = s.parameters(record.inputs, record.outputs)
    if s.kind.smooth:
        return named
    words = (f".{s.kind.shape}", f".{s.kind.place}")
    return tuple(
        replace(p, fixed=float(v)) if any(w in p.name for w in words) else p
        for p, v in zip(named, theta, strict=True)
    )


# linear algebra over thousands of units knows no other loss
METHOD = Method(fit, has_losses=False, takes_method=False)
