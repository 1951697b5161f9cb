"""Several structures on one log: orders searched, each fitted, and one of them ahead, with why."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from sysid.criteria.information import information_criteria, on_common_samples
from sysid.data.preprocess import Detrend
from sysid.data.record import Record
from sysid.errors import DataError, ModelError, SysidError, UsageError
from sysid.estimation.delays import choose_delay
from sysid.estimation.grid import default_grid
from sysid.estimation.holdout import HoldOut, hold_out, shortened
from sysid.estimation.orders import (
    ERROR_CRITERIA,
    OrderSearch,
    bounded_run,
    free_run_error,
    orders_text,
    ranked,
    search_orders,
    tie_margin,
)
from sysid.estimation.pem import fit, head_window
from sysid.estimation.search import FitOptions
from sysid.structures.base import Structure
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

SEARCH_SAMPLES = 12_000
"""Samples an order search looks at; the chosen orders are fitted to all of them."""

PARALLEL_WORK = 400_000
"""Candidates × samples from which a second process pays for its start (about a second)."""

FOLLOWS = 1.5
"""A model whose free run over all data errs by more than so many times the best one's does not
lead: its search saw a good fit that the fit to all data did not find again."""

LINEAR = ("arx", "armax", "oe", "bj")

Progress = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class Entry:
    """One structure's model and how its orders were found.

    Attributes:
        model: fitted to all estimation data.
        search: the order search, or None when the orders were given.
        seconds: time of search and fit.
        notes: what was changed on the way, for the user.
    """

    model: Model
    search: OrderSearch | None
    seconds: float
    notes: tuple[str, ...] = ()

    @property
    def error(self) -> float | None:
        """Free-run error on the held-out part of the estimation data, relative to its spread."""
        return None if self.search is None else self.search.best.error


@dataclass(frozen=True, eq=False)
class Contest:
    """All entries, the winner first, and why it is ahead.

    Attributes:
        entries: fitted structures.
        reason: one sentence.
        failed: structure → why it could not be fitted.
    """

    entries: tuple[Entry, ...]
    reason: str
    failed: Mapping[str, str]


def run_contest(
    names: Sequence[str],
    records: Sequence[Record],
    options: FitOptions,
    detrend: Detrend,
    *,
    grid: Sequence[Mapping[str, Any]] | None = None,
    criterion: str = "fit",
    jobs: int = 1,
    progress: Progress | None = None,
) -> Contest:
    """Search the orders of each structure on estimation data only, fit it, and rank them.

    Args:
        names: structures to fit.
        records: estimation data.
        options: how to fit.
        detrend: offsets stored with each model.
        grid: orders to try, or None for each structure's default grid; a single entry is fitted
            without a search.
        criterion: what ranks orders and structures.
        jobs: processes for the search.
        progress: called with (share done, what).

    Raises:
        DataError: no structure could be fitted.
        UsageError: the orders do not fit a structure.
    """
    plain = tuple(detrend.remove(r) for r in records)
    small = shortened(plain, SEARCH_SAMPLES)
    data = hold_out(small)
    nu, ny = plain[0].nu, plain[0].ny
    tasks = []
    nk = choose_delay(data) if grid is None else 1
    for name in names:
        chosen = list(grid) if grid is not None else _grid(name, nu, ny, data.samples, nk)
        for orders in chosen:
            structure_class(name).from_orders(dict(orders), nu, ny, options.structure_options)
        tasks.append((name, chosen))
    searches, failed = _searches(tasks, data, options, criterion, jobs, progress)
    entries = []
    for k, (name, chosen) in enumerate(tasks):
        if name in failed:
            continue
        if progress:
            progress(0.9 + 0.1 * k / len(tasks), f"fitting {name} to all data")
        started = perf_counter()
        search = searches.get(name)
        orders = chosen[0] if search is None else search[0].best.orders
        structure = structure_class(name).from_orders(
            dict(orders), nu, ny, options.structure_options
        )
        try:
            model, notes = _fitted(structure, records, options, detrend)
        except (DataError, ModelError) as error:
            if len(tasks) == 1:
                raise
            failed[name] = str(error)
            continue
        spent = perf_counter() - started + (search[1] if search else 0.0)
        entries.append(Entry(model, search[0] if search else None, spent, notes))
    if not entries:
        raise DataError("; ".join(failed.values()) or "no structure could be fitted")
    if progress:
        progress(1.0, "done")
    order = _in_order(entries, records, options, criterion, tie_margin(data.held))
    return Contest(order.entries, _reason(order, criterion, data.words), failed)


def _fitted(
    structure: Structure, records: Sequence[Record], options: FitOptions, detrend: Detrend
) -> tuple[Model, tuple[str, ...]]:
    """The fit; for output-error structures a second one with stable poles where it needs it.

    An unstable predictor of OE or BJ cannot even be evaluated on a longer record, so stability
    is part of what the structure means; for ARX and ARMAX it is reported and left to the user.
    """
    model = fit(structure, records, options, detrend=detrend)
    # a structure that chooses within itself knows its θ only when it is fitted
    settled = bounded_run(model.structure, model.theta)
    if settled or options.stable or "nf" not in structure.order_names:
        return model, ()
    bounded = fit(structure, records, replace(options, stable=True), detrend=detrend)
    return bounded, (
        "The unconstrained fit had an unstable pole; the poles were kept inside the unit circle.",
    )


def _grid(
    name: str, nu: int, ny: int, samples: int, nk: int | list[list[int]]
) -> list[dict[str, Any]]:
    found = default_grid(name, nu, ny, samples, nk)
    if not found and name not in LINEAR:
        raise DataError(f"{samples} samples are too few for {name}; record more or give --orders")
    # a record that bears no order at all still gets the lowest one: the fit itself will refuse
    lowest = {"arx": {"na": 1}, "armax": {"na": 1, "nc": 1}, "oe": {"nf": 1}}
    return found or [{**lowest.get(name, {"nc": 1, "nd": 1, "nf": 1}), "nb": 1, "nk": 1}]


def _searches(
    tasks: Sequence[tuple[str, list[Any]]],
    data: HoldOut,
    options: FitOptions,
    criterion: str,
    jobs: int,
    progress: Progress | None,
) -> tuple[dict[str, tuple[OrderSearch, float]], dict[str, str]]:
    # a structure that searches within itself has one candidate: beside others it is judged as they
    searched = [
        (name, grid)
        for name, grid in tasks
        if len(grid) > 1 or (len(tasks) > 1 and name not in LINEAR)
    ]
    found: dict[str, tuple[OrderSearch, float]] = {}
    failed: dict[str, str] = {}
    total = sum(len(grid) for _, grid in searched)
    work = total * data.samples
    if jobs > 1 and work > PARALLEL_WORK:
        from joblib import Parallel, delayed

        # chains of one structure and one delay: neighbours stay together for warm starts
        chains = [
            (name, [o for o in grid if o.get("nk") == nk])
            for name, grid in searched
            for nk in _distinct([o.get("nk") for o in grid])
        ]
        chains.sort(key=lambda c: -len(c[1]) * _WEIGHT.get(c[0], 1))
        outcomes = Parallel(n_jobs=jobs, return_as="generator_unordered")(
            delayed(_timed)(name, grid, data, options, criterion) for name, grid in chains
        )
        done = 0
        for outcome in outcomes:
            done += outcome[2]
            _collect(outcome, found, failed)
            if progress:
                progress(0.9 * done / total, f"searched {done} of {total} orders")
    else:
        done = 0
        for name, grid in searched:

            def tell(k: int, n: int, what: str, base: int = done) -> None:
                if progress:
                    progress(0.9 * (base + k) / total, what)

            _collect(_timed(name, grid, data, options, criterion, tell), found, failed)
            done += len(grid)
    return found, {k: v for k, v in failed.items() if k not in found}


_WEIGHT = {"arx": 0, "oe": 2, "armax": 2, "bj": 4}
"""Rough cost of one candidate, to start the longest chains first."""

Outcome = tuple[str, OrderSearch | str, int, float]


def _timed(
    name: str,
    grid: Sequence[Mapping[str, Any]],
    data: HoldOut,
    options: FitOptions,
    criterion: str,
    progress: Callable[[int, int, str], None] | None = None,
) -> Outcome:
    started = perf_counter()
    try:
        search = search_orders(name, grid, data, options, criterion, progress)
    except UsageError:
        raise
    except SysidError as error:
        return name, str(error), len(grid), perf_counter() - started
    return name, search, len(grid), perf_counter() - started


def _collect(
    outcome: Outcome,
    found: dict[str, tuple[OrderSearch, float]],
    failed: dict[str, str],
) -> None:
    """Merge the chains of one structure; deterministic whatever order they arrive in."""
    name, search, _, seconds = outcome
    if isinstance(search, str):
        failed[name] = search
        return
    if name in found:
        before, spent = found[name]
        both = (*before.candidates, *search.candidates)
        search = replace(search, candidates=ranked(both, search.criterion, search.margin))
        seconds += spent
    found[name] = (search, seconds)


def _distinct(values: Sequence[Any]) -> list[Any]:
    found: list[Any] = []
    for v in values:
        if v not in found:
            found.append(v)
    return found


@dataclass(frozen=True, eq=False)
class _Order:
    """Entries, the leading one first.

    Attributes:
        entries: all of them.
        sound: those that may lead.
        margin: fraction within which held-out errors tie.
        rule: what decided among equals: the name of a criterion, or ``size``.
    """

    entries: tuple[Entry, ...]
    sound: tuple[Entry, ...]
    margin: float
    rule: str


def _in_order(
    entries: Sequence[Entry],
    records: Sequence[Record],
    options: FitOptions,
    criterion: str,
    margin: float,
) -> _Order:
    """Entries by held-out error; of those within ``margin`` of the best the lowest BIC leads.

    Free runs of different structures tie more often than not: what then tells them apart is
    how well they predict with how many parameters, and BIC finds the true one (Schwarz 1978).
    Under an information criterion that one ranks alone. Models that cannot lead come last: those
    whose free run is unbounded, and those whose fit to all data follows them much worse than
    another one does.
    """
    counted = [np.ones(len(r), dtype=bool) for r in records]
    follows = {
        id(e): free_run_error(
            e.model.structure, e.model.theta, _seen(e, records), counted, options.robust
        )
        for e in entries
    }
    limit = FOLLOWS * min(follows.values())
    sound = [
        e
        for e in entries
        if bounded_run(e.model.structure, e.model.theta) and follows[id(e)] <= limit
    ]
    sound = sound or [e for e in entries if follows[id(e)] <= limit] or list(entries)
    searched = all(e.error is not None for e in entries)
    rule = criterion if criterion not in ERROR_CRITERIA else "bic" if searched else "aic"
    values = _information(entries, records, rule)
    score = {id(e): (v, _size(e)) for e, v in zip(entries, values, strict=True)}
    ahead: tuple[Entry, ...] = ()
    if searched and criterion in ERROR_CRITERIA:
        errors = {id(e): (float(e.error or 0.0), _size(e)) for e in entries}
        close = (1.0 + margin) * min(errors[id(e)][0] for e in sound)
        tied = [e for e in sound if errors[id(e)][0] <= close]
        # outliers rule the likelihood: a robust fit goes by size alone
        ahead = (min(tied, key=lambda e: _size(e) if options.robust else score[id(e)]),)
        score = errors
    rest = sorted(
        (e for e in entries if e not in ahead), key=lambda e: (e not in sound, score[id(e)])
    )
    decided = "size" if options.robust and ahead else rule
    return _Order((*ahead, *rest), tuple(sound), margin, decided)


def _seen(entry: Entry, records: Sequence[Record]) -> list[Record]:
    """The records as the model sees them."""
    return [entry.model.detrend.remove(r) for r in records]


def _information(entries: Sequence[Entry], records: Sequence[Record], name: str) -> list[float]:
    """A criterion of every entry from one-step errors on the samples that all of them predict."""
    errors = []
    for e in entries:
        s, theta = e.model.structure, e.model.theta
        window = head_window(s, theta)
        errors.append([s.errors(theta, r.u, r.y, window) for r in _seen(e, records)])
    found = []
    for e, common in zip(entries, on_common_samples(errors), strict=True):
        value = float(getattr(information_criteria(common, e.model.n_estimated), name))
        found.append(value if np.isfinite(value) else np.inf)
    return found


def _size(entry: Entry) -> int:
    """Parameters to estimate; initial states belong to the record, not to the model."""
    return sum(p.fixed is None for p in entry.model.parameters)


def _reason(order: _Order, criterion: str, words: str) -> str:
    first = order.entries[0]
    name, values = first.model.structure.name, first.model.structure.order_values()
    text = f"{name} {orders_text(values)}".rstrip()
    if first.error is None:
        return (
            f"{text}: {'fitted with the orders given' if values else 'fitted; it has no orders'}."
            if len(order.entries) == 1
            else f"{text} is ahead by {order.rule.upper()} on the estimation data."
        )
    if criterion not in ERROR_CRITERIA:
        return f"{text} is ahead by {criterion} over one-step errors on the estimation data."
    share = 100.0 * (1.0 - first.error)
    if len(order.entries) == 1:
        return f"{text} was chosen by {criterion} on {words}: {share:.2f} % in free run."
    second = order.entries[1]
    said = (
        f"{text} is ahead: {share:.2f} % free-run fit on {words} with {_size(first)} parameters; "
        f"next {second.model.structure.name} with {100.0 * (1.0 - (second.error or 0.0)):.2f} % "
        f"and {_size(second)}"
    )
    if second not in order.sound:
        return f"{said}, which does not hold in a free run over all estimation data."
    if (second.error or 0.0) <= (1.0 + order.margin) * first.error:
        rule = "the smallest leads" if order.rule == "size" else "the lowest BIC leads"
        return f"{said} (errors within {100.0 * order.margin:.2g} % tie; of those {rule})."
    return f"{said}."
