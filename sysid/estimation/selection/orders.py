"""Order and delay search, ranked on held-out estimation data."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.criteria import table
from sysid.criteria.information import loss_of
from sysid.criteria.table import Loss
from sysid.data.record import Array, Record
from sysid.errors import DataError, ModelError
from sysid.estimation.pem import fit_prepared
from sysid.estimation.robust_fit import counted_errors
from sysid.estimation.soundness import bounded_run, excess, leader, motion_doubts
from sysid.fitting.holdout import HoldOut, tie_margin
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus
from sysid.methods.held_out_error import free_run_error
from sysid.structures.base import Structure
from sysid.structures.linear.base import LinearStructure
from sysid.structures.linear.constant_input import with_ones
from sysid.structures.linear.families import ARX
from sysid.structures.linear.least_squares import promising, solved_at_once
from sysid.structures.orders import orders_text
from sysid.structures.registry import structure_class

Progress = Callable[[int, int, str], None]


SEARCH_EVALUATIONS = 40
"""Limit of each descent during a search: enough to rank; the chosen orders are fitted in full."""

SEARCH_TOLERANCE = 1e-4
"""Convergence during a search: errors closer than ``CLOSE`` tie anyway."""

SEARCH_PATIENCE = 6
"""Evaluations without gain after which a descent ends; a step is rarely rejected more often."""


@dataclass(frozen=True)
class Candidate:
    """One set of orders and how it did.

    Attributes:
        orders: as ``Structure.from_orders`` reads them.
        score: the criterion's value, smaller is better.
        error: free-run error on the held-out data relative to the outputs' spread; one step ahead
            where the data come from a closed loop.
        stable: whether the free run is bounded; unstable candidates rank behind all others.
        settled: whether nothing speaks against its motion (see ``motion_doubts``); among those
            that tie, such a one is taken.
    """

    orders: Mapping[str, Any]
    n: int
    score: float
    error: float
    stable: bool = True
    settled: bool = True


@dataclass(frozen=True)
class OrderSearch:
    """The outcome of a search over one structure's orders, best first.

    Attributes:
        candidates: all orders that could be fitted.
        margin: fraction by which a held-out error may exceed the best one and still tie with it.
        equations: samples and outputs of the records that were fitted.
    """

    structure: str
    criterion: str
    candidates: tuple[Candidate, ...]
    margin: float
    equations: tuple[int, int]

    @property
    def best(self) -> Candidate:
        return self.candidates[0]


def search_orders(
    name: str,
    grid: Sequence[Mapping[str, Any]],
    data: HoldOut,
    options: FitOptions,
    criterion: str = "fit",
    progress: Progress | None = None,
    rivals: Sequence[Mapping[str, Any]] = (),
    estimated: Sequence[bool] = (),
) -> OrderSearch:
    """Rank the orders of one structure.

    Args:
        data: what to fit and what to choose on (offsets removed); for ``fit`` and ``rmse`` the
            free run on the held-out samples counts, for ``aic``, ``bic`` … the one-step errors
            on the records to fit on, over the samples that all candidates predict.
        progress: called with (done, all, what) after each candidate.
        rivals: orders searched elsewhere that these will be ranked with: information criteria
            leave out the samples which not all of them predict.
        estimated: by output, whether a linear structure has a level that is estimated with it.
    """
    cls = structure_class(name)
    nu, ny = data.whole[0].nu, data.whole[0].ny
    structures = [cls.from_orders(dict(o), nu, ny, options.structure_options) for o in grid]
    if any(estimated) and issubclass(cls, LinearStructure):
        structures = [
            s.with_constant(estimated) for s in structures if isinstance(s, LinearStructure)
        ]
        data = data.of(with_ones)
    if (
        cls.traits.solved_at_once
        and options.focus is Focus.PREDICTION
        and not (options.robust or options.stable or options.fixed or options.bounds)
    ):
        candidates = _arx_at_once(structures, data, criterion)
        if progress:
            progress(len(grid), len(grid), f"{name}: {len(grid)} orders in one pass")
    else:
        others = [cls.from_orders(dict(o), nu, ny, options.structure_options) for o in rivals]
        common = max(s.first_sample() for s in (*structures, *others))
        candidates = _one_after_another(structures, data, options, criterion, common, progress)
    if not candidates:
        raise DataError(
            f"{data.whole[0].name}: none of the {len(grid)} orders of {name} could be fitted; "
            "record more data or give `orders`"
        )
    margin = tie_margin(data.holdout)
    equations = (sum(len(r) for r in data.train), ny)
    order = ranked(candidates, criterion, margin, equations)
    return OrderSearch(name, criterion, order, margin, equations)


def ranked(
    candidates: Sequence[Candidate], criterion: str, margin: float, equations: tuple[int, int]
) -> tuple[Candidate, ...]:
    """Best first; a settled model goes before others whose errors are within ``margin`` of its own.

    On held-out error the smallest of those leads; an information criterion weighs size itself.
    """
    ordered = sorted(candidates, key=lambda c: (not c.stable, c.score, c.n, orders_text(c.orders)))
    by_size = table.criterion(criterion).of_free_run
    lead = leader(
        ordered,
        lambda c: c.stable,
        lambda c, best: excess(criterion, c.score, best.score, equations) <= margin,
        lambda c: c.settled,
        lambda c: (c.n if by_size else 0, c.score, orders_text(c.orders)),
    )
    return (lead, *(c for c in ordered if c is not lead))


def searching(options: FitOptions) -> FitOptions:
    """The options of a fit that only has to rank: coarse, and given up where nothing is gained."""
    return replace(
        options,
        max_evaluations=min(options.limit(), SEARCH_EVALUATIONS),
        tolerance=max(options.precision(), SEARCH_TOLERANCE),
        patience=SEARCH_PATIENCE,
    )


def _one_after_another(
    structures: Sequence[Structure],
    data: HoldOut,
    options: FitOptions,
    criterion: str,
    common: int,
    progress: Progress | None,
) -> list[Candidate]:
    """Fit each candidate, warm-started from the best smaller neighbours already fitted."""
    candidates: list[Candidate] = []
    train = data.train
    options, ranks = searching(options), table.criterion(criterion)
    fitted: dict[int, tuple[float, dict[str, float]]] = {}
    for k, s in enumerate(structures):
        names = [p.name for p in s.parameters(train[0].inputs, train[0].outputs)]
        initial_guesses = [
            ("smaller neighbour", np.array([values.get(n, 0.0) for n in names]))
            for _, values in sorted(fitted.values(), key=lambda item: item[0])[:1]
            if set(values) <= set(names)
        ]
        try:
            outcome = fit_prepared(s, train, options, initial_guesses)
        except (DataError, ModelError):
            outcome = None
        if outcome is not None:
            # a structure that reads terms or scalings off the data comes back adapted
            s, theta = outcome.structure, outcome.theta
            names = [q.name for q in outcome.parameters]
            error = free_run_error(
                s, theta, data.whole, data.counted, options.robust, one_step=data.one_step
            )
            score = error
            if not ranks.of_free_run:
                free = sum(q.fixed is None for q in outcome.parameters) + outcome.n_states
                errors = counted_errors(s, theta, train, options.robust)
                score = ranks.cost_of(loss_of([e[common:] for e in errors], free))
            if np.isfinite(score):
                candidates.append(_candidate(s, theta, score, error, data.whole))
                fitted[k] = (score, dict(zip(names, theta.tolist(), strict=True)))
        if progress:
            progress(k + 1, len(structures), f"{s.name} {orders_text(_orders(s))}")
    return candidates


def _candidate(
    s: Structure, theta: Array, score: float, error: float, records: Sequence[Record]
) -> Candidate:
    calm = not motion_doubts(s, theta, max(map(len, records)), records[0].dt)
    orders = _orders(s)
    return Candidate(orders, len(theta), score, error, bounded_run(s, theta), calm)


def _arx_at_once(structures: Sequence[Structure], data: HoldOut, criterion: str) -> list[Candidate]:
    """Every ARX candidate from two Gram matrices, free runs of the promising ones only."""
    solved = solved_at_once([s for s in structures if isinstance(s, ARX)], data)
    ranks, candidates = table.criterion(criterion), []
    for a in promising(solved) if ranks.of_free_run else solved:
        s = a.structure
        if ranks.of_free_run:
            score = error = free_run_error(
                s, a.theta, data.whole, data.counted, one_step=data.one_step
            )
        else:
            loss = Loss(a.log_det, a.samples, len(a.theta), s.ny)
            score, error = ranks.cost_of(loss), float("nan")
        if np.isfinite(score):
            candidates.append(_candidate(s, a.theta, score, error, data.whole))
    return candidates


def _orders(s: Structure) -> dict[str, Any]:
    """Orders as the user knows them: without the constant."""
    return (s.without_constant() if isinstance(s, LinearStructure) else s).order_values()
