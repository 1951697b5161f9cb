"""How block-oriented models are fitted: the best proposal, searched on all data.

The user's constraints hold there, every gain is put in one place, and the covariance is found.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.special import fdtri

from sysid.data.record import Array, Record
from sysid.errors import ModelError
from sysid.fitting.marquardt import loss
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Allowed, Initial, Parameter
from sysid.fitting.searchable import FreeRunSearch, InitialGuesses, StartReport
from sysid.methods.method import Method
from sysid.methods.outcome import FitOutcome
from sysid.methods.search import STATE_LEVEL, by_search
from sysid.structures.base import Structure
from sysid.structures.blocks import hammerstein_wiener_proposals, wiener_hammerstein_proposals
from sysid.structures.blocks.errors import ChainErrors
from sysid.structures.blocks.gains import normalised
from sysid.structures.blocks.hammerstein_wiener import HammersteinWiener
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.blocks.trials import ChainData, Effort, Trial, outer_abscissae
from sysid.structures.blocks.wiener_hammerstein import WienerHammerstein

EVALUATIONS = 100
"""Limit of the descent on the normal equations before the last search."""

APPROACH, SETTLED = 1e-5, 1e-7
"""Relative gain of a step below which a descent ends: before gains are pinned, and after."""

PATIENCE = 4
"""Steps of less gain than that after which the last search ends: along a point of a static that
hardly matters they would go on for a hundred."""


def fit(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """Choose what is open on held-out samples, then fit it to everything."""
    if isinstance(structure, WienerHammerstein):
        best, tried = wiener_hammerstein_proposals.proposals(structure, records)
    else:
        assert isinstance(structure, HammersteinWiener)
        best, tried = hammerstein_wiener_proposals.proposals(structure, records)
    starts = [(best.label, best.theta)]
    starts += [(name, theta) for name, theta in initial_guesses if len(theta) == best.chain.n]
    reports = tuple(StartReport("all", t.label, None, t.cost, t.evaluations) for t in tried)
    return _final_fit(best.structure, records, options, parameters, starts, reports)


def refit(
    before: FitOutcome,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
) -> FitOutcome:
    """The last search once more, on nearly the same data, from where a fit ended."""
    structure = before.structure
    assert isinstance(structure, BlockStructure)
    starts = [("the fit before", before.theta)]
    outcome = _final_fit(structure, records, options, parameters, starts, before.starts)
    return replace(outcome, warnings=before.warnings)


def _final_fit(
    structure: BlockStructure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    starts: Sequence[tuple[str, Array]],
    reports: tuple[StartReport, ...],
) -> FitOutcome:
    """The search on all data from the best of the given starts, every gain in one place.

    Args:
        parameters: bounds and fixed values the user gave, by name.
        starts: named θ of ``structure``.
        reports: starts tried before.
    """
    given = {p.name: p for p in parameters}
    bare = structure.parameters(records[0].inputs, records[0].outputs)
    table = tuple(given.get(p.name, p) for p in bare)
    constrained = [p for p in table if p.fixed is not None or np.isfinite([p.lower, p.upper]).any()]
    data = replace(ChainData.of(records), states=options.initial is not Initial.ZERO)
    runs = [_approached(structure, theta, table, data, options) for _, theta in starts]
    best = min(runs, key=lambda run: run[1].cost)[1]
    structure, theta = best.structure, best.theta
    if not constrained:
        # the same model with its gains pinned: its cost does not change, its covariance exists
        chain, theta, pins = normalised(structure.chain, theta, data.pairs)
        pins = sorted({*pins, *outer_abscissae(chain)})
        structure = structure.with_chain(chain)
        table = tuple(
            replace(p, fixed=float(theta[k])) if k in pins else p for k, p in enumerate(table)
        )
    settled = replace(options, tolerance=options.precision(SETTLED), patience=PATIENCE)
    if not Allowed.by(table).bounded:
        settled, theta = _settled(Trial(structure, theta), table, data, settled)
    search = FreeRunSearch(partial(ChainErrors, structure.chain))
    try:
        outcome = by_search(structure, records, settled, table, [("", theta)], search)
    except ModelError as error:
        named = ", ".join(p.name for p in constrained)
        more = f" No stable model was found with {named} as fixed or bounded." if named else ""
        raise ModelError(f"{error}{more}") from None
    last = outcome.starts[-1]
    notes = [
        StartReport("all", name, before, last.cost, trial.evaluations + last.evaluations)
        if trial is best
        else StartReport("all", name, before, trial.cost, trial.evaluations)
        for (name, _), (before, trial) in zip(starts, runs, strict=True)
    ]
    return replace(outcome, starts=(*reports, *notes))


def _approached(
    structure: BlockStructure,
    theta: Array,
    table: Sequence[Parameter],
    data: ChainData,
    options: FitOptions,
) -> tuple[float, Trial]:
    """(cost at a start, where a quick descent from it ends; the start itself within bounds)."""
    allowed, problem = Allowed.by(table), data.problem(structure.chain)
    p = problem.with_states(allowed.nearest(theta))
    before = loss(problem.residual(p))
    start = Trial(structure, p, cost=before)
    if allowed.bounded:
        return before, start
    effort = Effort(min(EVALUATIONS, options.limit()), APPROACH)
    return before, start.descended(data, effort, _held(table))


def _held(table: Sequence[Parameter]) -> list[int]:
    held: list[int] = np.flatnonzero(~Allowed.by(table).free).tolist()
    return held


def _settled(
    start: Trial, table: Sequence[Parameter], data: ChainData, options: FitOptions
) -> tuple[FitOptions, Array]:
    """(options, θ) of the last search: where a quick descent ends, and from which states.

    Where the user leaves that open, runs begin at rest unless an F-test of the initial states says
    that they matter (99 %), each model descended by itself: at the same θ a run from rest does
    worse than it could.
    """
    effort = Effort(min(EVALUATIONS, options.limit()), SETTLED)
    moving = start.descended(data, effort, _held(table))
    if options.initial is not Initial.AUTO:
        return options, moving.theta
    n, k = start.chain.n, len(moving.p) - start.chain.n
    free = data.samples * start.structure.ny - n - k
    rest = replace(moving, p=moving.theta).descended(
        replace(data, states=False), effort, _held(table)
    )
    ratio = (rest.cost - moving.cost) / max(k, 1) / (moving.cost / max(free, 1))
    if k and (options.robust or (free > 0 and ratio > fdtri(k, free, STATE_LEVEL))):
        return replace(options, initial=Initial.ESTIMATED), moving.theta
    return replace(options, initial=Initial.ZERO), rest.theta


METHOD = Method(fit, refit, takes_method=False)
