"""Select a structure: search the orders of each, fit each, and rank them."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from sysid.criteria import table
from sysid.data.facts import LogFacts
from sysid.data.preprocess import Detrend
from sysid.data.record import Record
from sysid.errors import DataError, ModelError, SysidError, UsageError
from sysid.estimation.offsets.choice import choose_offsets
from sysid.estimation.offsets.offsets import Offsets
from sysid.estimation.pem import check_data
from sysid.estimation.selection.defaults import Grid, default_structures, usual_orders
from sysid.estimation.selection.delays import ChosenDelay, chosen_delay
from sysid.estimation.selection.final_fits import Data, FinalFits, structure_of
from sysid.estimation.selection.orders import (
    OrderSearch,
    ranked,
    search_orders,
)
from sysid.estimation.selection.ranking import (
    DRIFTED,
    IN_LOOP,
    Entry,
    common_criteria,
    ranked_entries,
    reason,
)
from sysid.estimation.two_stage import STAGES
from sysid.fitting.holdout import hold_out, longest_of, tie_margin
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus
from sysid.structures.registry import structure_class

PARALLEL_WORK = 1_000_000
"""Candidates × samples from which a second process pays for its start: the usual orders of one pair
are half of it and take one process two seconds, as long as two take to import what they need."""

OUTLIERS = (
    "{} were outliers; delay, orders and offsets were chosen with values interpolated in their "
    "place."
)

ANY = "any"
"""Stands for every delay."""

EARLIER = 4
"""Samples before the delay of the regression from which on delays are tried in a record of steps:
the first samples of a response of second order are lost in noise."""

SHORT = 2000
"""Samples up to which they are tried: a search of five delays takes five times as long."""

STILL_WORDS = " No input moves in {}: orders chosen there would be those of a level."


Progress = Callable[[float, str], None]

Delays = int | list[list[int]]
"""One delay [samples], or a matrix (outputs × inputs)."""


@dataclass(frozen=True, eq=False)
class StructureSelection:
    """All entries, the winner first, and why it is ahead.

    Attributes:
        entries: fitted structures.
        failed: structure → why it could not be fitted.
    """

    entries: tuple[Entry, ...]
    reason: str
    failed: Mapping[str, str]

    def with_criteria(self, records: Sequence[Record]) -> list[tuple[Entry, dict[str, float]]]:
        """Every entry with its information criteria over the samples that all of them predict."""
        criteria = common_criteria([e.model for e in self.entries], [records] * len(self.entries))
        return list(zip(self.entries, criteria, strict=True))


def select_structure(
    names: Sequence[str],
    data: Sequence[Record] | LogFacts,
    options: FitOptions,
    detrend: Detrend | Offsets | str = "auto",
    *,
    grid: Grid | Mapping[str, Grid] | None = None,
    criterion: str = "fit",
    jobs: int = 1,
    progress: Progress | None = None,
) -> StructureSelection:
    """Search the orders of each structure on estimation data only, fit it, and rank them.

    Args:
        names: what to fit; empty for the default ones, and others where the data suit them
            (``usual_orders``).
        data: estimation data, or what is known of them.
        detrend: treatment of the records' offsets: a policy, or what was chosen before.
        grid: orders to try, for all or by structure; None, and where a structure is left out, for
            its default grid; a single entry is fitted without a search.
        criterion: what ranks orders and structures; one of the free run gives way to BIC where
            no input moves in the samples that would be held out, such as a step's last third.
        progress: called with (share done, what).
    """
    facts = LogFacts.of(data)
    records, small = facts.records, facts.sample
    check_data(records)
    names, given, beside = _named(names, grid, records, options)
    whole = len(given) == len(names)
    searched = not whole or any(len(g) > 1 for g in given.values())
    closed = (searched or len(names) > 1) and facts.closed_loop
    offsets, (nk, notes) = _offsets_and_delay(facts, detrend, search=not whole)
    if searched and facts.outliers.words:
        notes = (*notes, OUTLIERS.format(facts.outliers.words))
    ahead = (searched or len(names) > 1) and _judged_one_step(facts, names, options)
    cut = replace(hold_out(small, longest_of(nk)), one_step=ahead)
    still = searched and not cut.excited and table.criterion(criterion).of_free_run
    criterion, cut = ("bic", replace(cut, train=tuple(small))) if still else (criterion, cut)
    delays = _around(nk, cut.samples) if still else (nk,)
    tasks, seen = [], {}
    for name in names:
        chosen = list(given.get(name, ())) or _grid(
            name, records[0].nu, records[0].ny, cut.samples, delays, options
        )
        try:
            made = [structure_of(name, orders, records, options) for orders in chosen]
        except UsageError as error:
            if name in given and len(names) > 1:
                raise UsageError(f"{error}; or name fewer structures with `structures`") from None
            raise
        treatment = offsets.for_structure(made[0], small)
        seen[name] = (cut.of(treatment.detrend.remove), treatment.estimated)
        tasks.append((name, chosen))
    final = FinalFits(facts, options, offsets, beside)
    searches, failed = _searches(tasks, seen, options, criterion, jobs, progress)
    entries = _entries(tasks, searches, failed, final, progress)
    if not entries:
        raise DataError("; ".join(failed.values()) or "no structure could be fitted")
    if progress:
        progress(1.0, "done")
    if closed or options.method in STAGES:
        entries = [final.without_feedback(e, dict(tasks), seen, criterion) for e in entries]
    entries = [replace(e, notes=(*notes, *e.notes)) for e in entries]
    order = ranked_entries(
        entries, records, options, criterion, tie_margin(cut.holdout), cut.one_step
    )
    said = all(structure_class(n).orders_said(options.structure_options or {}) for n in names)
    why = reason(order, criterion, cut.words, IN_LOOP if closed else DRIFTED, given=whole or said)
    return StructureSelection(order.entries, why + STILL_WORDS.format(cut.words) * still, failed)


def _entries(
    tasks: Sequence[tuple[str, Grid]],
    searches: Mapping[str, tuple[OrderSearch, float]],
    failed: dict[str, str],
    final: FinalFits,
    progress: Progress | None,
) -> list[Entry]:
    """Every structure with its best orders fitted to all data; failures go into ``failed``."""
    entries = []
    for k, (name, chosen) in enumerate(tasks):
        if name in failed:
            continue
        if progress:
            costs = [_cost(task) for task, _ in tasks]
            share = sum(costs[:k]) / sum(costs)
            progress(_SEARCHED + (1.0 - _SEARCHED) * share, f"fitting {name} to all data")
        search, seconds = searches.get(name, (None, 0.0))
        # one candidate is fitted as asked for, alone and in company: what a structure that
        # searches within itself found on the part that was fitted only says how good it is
        orders = chosen[0] if len(chosen) == 1 or search is None else search.best.orders
        try:
            entry = final.entry(name, orders, search)
        except (DataError, ModelError) as error:
            if len(tasks) == 1:
                raise
            failed[name] = str(error)
        else:
            entries.append(replace(entry, seconds=entry.seconds + seconds))
    return entries


def _named(
    names: Sequence[str],
    grid: Grid | Mapping[str, Grid] | None,
    records: Sequence[Record],
    options: FitOptions,
) -> tuple[tuple[str, ...], Mapping[str, Grid], tuple[str, ...]]:
    """What to fit, with which orders, and what of it nobody named."""
    chosen = tuple(names) or default_structures(bool(records[0].nu))
    given = grid or {} if grid is None or isinstance(grid, Mapping) else dict.fromkeys(chosen, grid)
    beside = {} if names or given else usual_orders(records, options)
    return (*chosen, *beside), {**given, **beside}, tuple(beside)


def _judged_one_step(facts: LogFacts, names: Sequence[str], options: FitOptions) -> bool:
    """Whether held-out samples are judged one step ahead: in a loop and beside a drift.

    Only among linear structures: of nonlinear ones those without noise model would never lead, and
    what they are asked for is a simulator. So they are where simulation is the focus asked for. A
    drift that is still in the log is looked for where structures compete: orders of one alone are
    searched without, in half of the time.
    """
    linear = all(structure_class(name).traits.linear for name in names)
    if not linear or options.focus is not Focus.PREDICTION:
        return False
    taken_out = any("remove_drift" in d.fields for r in facts.records for d in r.read_as)
    drifts = taken_out or (len(names) > 1 and bool(np.any(facts.drifts)))
    return drifts or facts.closed_loop


def _offsets_and_delay(
    facts: LogFacts, detrend: Detrend | Offsets | str, *, search: bool
) -> tuple[Offsets, tuple[Delays, tuple[str, ...]]]:
    """The offsets, and the delay to search with, which that choice needs."""
    known = Offsets.of_detrend(detrend) if isinstance(detrend, Detrend) else detrend
    delay = ChosenDelay(1)
    if search and facts.records[0].nu:
        delay = chosen_delay(facts)
    offsets = choose_offsets(facts, known, delay.nk) if isinstance(known, str) else known
    return offsets, (delay.nk, delay.notes)


def _around(nk: Delays, samples: int) -> Sequence[Delays]:
    """Delays to try where one step shows the delay: what regression says of it is rough."""
    if samples > SHORT or not isinstance(nk, int):
        return (nk,)
    return range(max(nk - EARLIER, 1), nk + 2)


def _grid(
    name: str, nu: int, ny: int, samples: int, delays: Sequence[Delays], options: FitOptions
) -> list[dict[str, Any]]:
    cls = structure_class(name)
    said = cls.orders_said(options.structure_options or {})
    tried = [o for nk in delays for o in cls.candidate_orders(nu, ny, samples, nk)]
    grid = [dict(o) for k, o in enumerate((said,) if said else tried) if said or o not in tried[:k]]
    if not grid:
        raise DataError(f"{samples} samples are too few for {name}; record more or give orders")
    return grid


def _searches(
    tasks: Sequence[tuple[str, list[Any]]],
    data: Mapping[str, Data],
    options: FitOptions,
    criterion: str,
    jobs: int,
    progress: Progress | None,
) -> tuple[dict[str, tuple[OrderSearch, float]], dict[str, str]]:
    # one candidate, such as of a structure that searches within itself, is judged as others are
    others = len(tasks) > 1 and any(len(grid) > 1 for _, grid in tasks)
    searched = [
        (name, grid)
        for name, grid in tasks
        if len(grid) > 1 or others or (len(tasks) > 1 and not structure_class(name).traits.linear)
    ]
    searches: dict[str, tuple[OrderSearch, float]] = {}
    failed: dict[str, str] = {}
    total = sum(len(grid) for _, grid in searched)
    work = total * max(d.samples for d, _ in data.values())
    costs = {name: _cost(name) for name, _ in searched}
    whole = sum(len(grid) * costs[name] for name, grid in searched)
    # chains of one structure and one delay: neighbours stay together for warm starts, whether
    # one process searches or several; what is solved at once has no starts
    chains = [
        (name, [o for o in grid if nk in (ANY, o.get("nk"))], grid)
        for name, grid in searched
        for nk in _delays(name, grid)
    ]
    done, spent = 0, 0.0
    if jobs > 1 and work > PARALLEL_WORK:
        from joblib import Parallel, delayed

        from sysid.processes import tied

        chains.sort(key=lambda c: -len(c[1]) * costs[c[0]])
        outcomes = Parallel(n_jobs=jobs, return_as="generator_unordered")(
            delayed(tied)(os.getpid(), _timed, name, chain, grid, data[name], options, criterion)
            for name, chain, grid in chains
        )
    else:

        def report(k: int, n: int, what: str) -> None:
            if progress:
                cost = costs[what.partition(" ")[0].rstrip(":")]
                progress(_SEARCHED * (spent + k * cost) / whole, what)

        outcomes = (
            _timed(name, chain, grid, data[name], options, criterion, report)
            for name, chain, grid in chains
        )
    for outcome in outcomes:
        done += outcome[2]
        spent += outcome[2] * costs[outcome[0]]
        _collect(outcome, searches, failed)
        if progress:
            progress(_SEARCHED * spent / whole, f"searched {done} of {total} orders")
    return searches, {k: v for k, v in failed.items() if k not in searches}


_SEARCHED = 0.75
"""Share of the time that the searches take of a fit without given orders, as measured; the fits to
all data and their covariances take the rest."""


def _cost(name: str) -> float:
    """What one order of a structure takes, against others; what is solved at once takes least."""
    return max(structure_class(name).traits.search_cost, 0.05)


Outcome = tuple[str, OrderSearch | str, int, float]


def _timed(
    name: str,
    chain: Sequence[Mapping[str, Any]],
    grid: Sequence[Mapping[str, Any]],
    data: Data,
    options: FitOptions,
    criterion: str,
    progress: Callable[[int, int, str], None] | None = None,
) -> Outcome:
    started = perf_counter()
    search: OrderSearch | str
    try:
        search = search_orders(name, chain, data[0], options, criterion, progress, grid, data[1])
    except UsageError:
        raise
    except SysidError as error:
        search = str(error)
    return name, search, len(chain), perf_counter() - started


def _collect(
    outcome: Outcome,
    searches: dict[str, tuple[OrderSearch, float]],
    failed: dict[str, str],
) -> None:
    """Merge the chains of one structure; deterministic whatever order they arrive in."""
    name, search, _, seconds = outcome
    if isinstance(search, str):
        failed[name] = search
        return
    if name in searches:
        before, spent = searches[name]
        both = (*before.candidates, *search.candidates)
        order = ranked(both, search.criterion, search.margin, search.equations)
        search = replace(search, candidates=order)
        seconds += spent
    searches[name] = (search, seconds)


def _delays(name: str, grid: Grid) -> list[Any]:
    """The delays of a grid, each once; one stands for all where candidates are no starts."""
    if structure_class(name).traits.solved_at_once:
        return [ANY]
    every = [orders.get("nk") for orders in grid]
    return [nk for k, nk in enumerate(every) if nk not in every[:k]]
