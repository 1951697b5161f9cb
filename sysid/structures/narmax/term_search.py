"""Term search for the equation of one output: pools, paths, and an inner hold-out."""

from collections.abc import Sequence
from dataclasses import replace
from math import comb

import numpy as np

from sysid.errors import UsageError
from sysid.structures.difference_equations.frols import (
    TermGram,
    best_sizes,
    bic_size,
    forward,
    term_gram,
)
from sysid.structures.difference_equations.monomials import Term, pool
from sysid.structures.difference_equations.signals import lagged_signals
from sysid.structures.difference_equations.trials import as_good_as
from sysid.structures.narmax.chunk_fits import CandidateRuns, select_by_simulation
from sysid.structures.narmax.term_growth import grown, pruned
from sysid.structures.narmax.term_trials import Row, Trial, refined
from sysid.structures.orders import MAX_ORDER, Orders

DEGREES = (1, 2, 3)
"""Degrees tried when none is given."""

HIGH = 5
HIGH_LAGS = 2
HIGH_POOL = 300
CLEARLY = 0.9
"""A high degree, or inputs of the same sample, are taken when the held-out error is below this
multiple of what it is without: they win easily inside the data and for the wrong reason."""

ENOUGH = 0.01
"""Held-out error below which no higher degree is looked at."""

MOST_TERMS = 30
"""Terms an output gets at most unless the user asks for more."""

SIZES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30)
SHORTLIST = 60
"""Candidates that the simulation-error selection runs."""

REFINED = 6
"""Sets of terms that are refined in free run."""

GROWN = 2
"""Refined sets from which terms are added and left out."""

SMALL = 6
"""Terms of a small set."""

MUCH_WORSE = 1.3
"""Ratio of held-out errors up to which an equation that stays near its data is preferred."""


def pools(
    row: Row, degrees: Sequence[int], lags: int
) -> tuple[tuple[Term, ...], list[tuple[int, int, list[int]]]]:
    """The largest pool, and (degree, lags, members) of the smaller ones inside it."""
    s, degree = row.structure, max(degrees)
    while True:
        try:
            largest = pool(capped(s.orders, lags), row.output, degree)
            break
        except UsageError:
            if s.degree or degree <= 1:
                raise
            degree -= 1
    largest = tuple(t for t in largest if row.identifiable(t))
    terms = [row.inward(t) for t in largest]
    most = max([f.lag for t in terms for f in t], default=0)
    caps = sorted({c for c in (1, 2, 3, 5, 8, 12, 20) if c < most} | {most})
    pools_of_row: list[tuple[int, int, list[int]]] = []
    for each in degrees:
        for cap in caps:
            inside = [
                k for k, t in enumerate(terms) if len(t) <= each and all(f.lag <= cap for f in t)
            ]
            if inside and (not pools_of_row or inside != pools_of_row[-1][2]):
                pools_of_row.append((each, cap, inside))
    return tuple(terms), pools_of_row


def capped(orders: Orders, lags: int) -> Orders:
    """The same orders with at most so many lags of each signal."""
    na, nb = (
        tuple(tuple(min(n, lags) for n in row) for row in matrix)
        for matrix in (orders.na, orders.nb)
    )
    return replace(orders, na=na, nb=nb)


def search_terms(row: Row, refine: bool, evaluations: int) -> tuple[Trial, list[Trial]]:
    """The best equation of one output, and all that were tried.

    Unless the degree is given, the fifth is tried too, over few lags: it must be clearly better on
    the held-out data, because inside the data it wins easily and outside it runs away.

    Args:
        refine: whether coefficients may be refined in free run.
    """
    s = row.structure
    if s.degree:
        return _search(row, (s.degree,), MAX_ORDER, refine, evaluations)
    best, tried = _search(row, DEGREES, MAX_ORDER, refine, evaluations)
    count = len(lagged_signals(capped(s.orders, HIGH_LAGS), row.output))
    if comb(count + HIGH, HIGH) <= HIGH_POOL and best.error > ENOUGH:
        other, more = _search(row, (HIGH,), HIGH_LAGS, refine, evaluations)
        tried = tried + more
        if other.error < CLEARLY * best.error:
            best = other
    return best, tried


def _search(
    row: Row, degrees: Sequence[int], lags: int, refine: bool, evaluations: int
) -> tuple[Trial, list[Trial]]:
    s = row.structure
    terms, inside = pools(row, degrees, lags)
    first = max((f.lag for t in terms for f in t), default=0)
    gram = term_gram(terms, row.search, 0, first)
    grams = [gram]
    if row.folds[0].train is not row.search:
        grams = [term_gram(terms, fold.train, 0, first) for fold in row.folds]
    later = [
        (degree, cap, [k for k in m if not any(f.kind == "u" and f.lag == 0 for f in terms[k])])
        for degree, cap, m in inside
    ]
    if later == inside or not all(m for _, _, m in later):
        tried = _err_trials(row, gram, grams, inside)
    else:
        tried = _err_trials(row, gram, grams, later)
        more = _err_trials(row, gram, grams, inside)
        if min(t.error for t in more) < CLEARLY * min(t.error for t in tried):
            tried = tried + more
        else:
            kept = later[-1][2]
            terms = tuple(terms[k] for k in kept)
            gram, grams = subset(gram, kept), [subset(g, kept) for g in grams]
    if s.selection != "err":
        tried += _simulation_trials(row, gram, grams, tried)
    usable = tried
    if s.size:
        exact = [t for t in tried if len(t.terms) == s.size]
        usable = exact or tried
    if refine:
        more = [t for trial in _to_refine(usable) for t in refined(row, trial, evaluations)]
        tried, usable = tried + more, usable + more
        if not s.size:
            most = min(MOST_TERMS, max(gram.samples // 8, 1))
            for trial in _to_grow(more):
                larger = grown(row, trial, terms, most, evaluations)
                smaller = pruned(row, best(row, [trial, *larger]), evaluations)
                tried, usable = tried + larger + smaller, usable + larger + smaller
    return best(row, usable), tried


def best(row: Row, trials: Sequence[Trial]) -> Trial:
    """The smallest of those that are as good as the best and stay near their data.

    An equation that runs away under inputs like those of the data is passed over unless all that
    do not are much worse: its free run is right only along the paths it has seen.
    """
    order = sorted(trials, key=lambda t: t.error)
    worst = MUCH_WORSE * order[0].error
    sound = next((t for t in order if t.error <= worst and row.stays_near(t)), None)
    for t in as_good_as((sound or order[0]).error, order, row.tie):
        if sound is None or row.stays_near(t):
            return t
    return order[0]


def _to_refine(trials: Sequence[Trial]) -> list[Trial]:
    """The best, and the best small ones: free runs show uses of terms that one step does not."""
    order = sorted(trials, key=lambda t: t.error)
    small = [t for t in order if len(t.terms) <= SMALL]
    linear = [t for t in order if all(len(x) <= 1 for x in t.terms)]
    return _distinct([*order[: REFINED - 2], *small[:1], *linear[:1], *order], REFINED)


def _to_grow(refined_ones: Sequence[Trial]) -> list[Trial]:
    """The best refined set and the best one of a few terms."""
    order = sorted(refined_ones, key=lambda t: t.error)
    small = [t for t in order if len(t.terms) <= SMALL]
    return _distinct([*order[:1], *small[:1], *order], GROWN)


def _err_trials(
    row: Row,
    gram: TermGram,
    grams: Sequence[TermGram],
    inside: Sequence[tuple[int, int, list[int]]],
) -> list[Trial]:
    """Least squares at several sizes along the path of every pool."""
    s = row.structure
    most = s.size or min(MOST_TERMS, max(gram.samples // 8, 1))
    seen: set[frozenset[int]] = set()
    trials = []
    for degree, cap, members in inside:
        sets = best_sizes(gram, members, most)
        enough = bic_size([unexplained for _, unexplained in sets], gram.samples)
        sizes = [s.size] if s.size else [n for n in SIZES if n < enough] + [enough]
        for n in sizes:
            chosen = sets[min(n, len(sets)) - 1][0] if sets else []
            if not chosen or frozenset(chosen) in seen:
                continue
            seen.add(frozenset(chosen))
            how = f"error reduction, degree {degree}, lags to {cap}, {len(chosen)} terms"
            trials.append(_least_squares(row, grams, chosen, how))
    return trials


def _least_squares(row: Row, grams: Sequence[TermGram], chosen: Sequence[int], how: str) -> Trial:
    terms = tuple(grams[0].terms[k] for k in chosen)
    thetas = tuple(g.solve(chosen) for g in grams)
    return Trial(terms, thetas, row.held_out_error(terms, thetas), how)


def _simulation_trials(
    row: Row, gram: TermGram, grams: Sequence[TermGram], tried: Sequence[Trial]
) -> list[Trial]:
    """Growing and pruning by the simulation error, from the best set and from its linear part."""
    s = row.structure
    place = {t: k for k, t in enumerate(gram.terms)}
    every_term = range(len(gram.terms))
    ahead = best(row, tried)
    known = [
        k for t in sorted(tried, key=lambda t: t.error)[:8] for k in (place[x] for x in t.terms)
    ]
    linear = [k for k in every_term if len(gram.terms[k]) == 1]
    path = forward(gram, list(every_term), SHORTLIST).order.tolist()
    short = list(dict.fromkeys([*(place[x] for x in ahead.terms), *known, *linear, *path]))
    short = short[: max(SHORTLIST, len(ahead.terms))]
    part = subset(gram, short)
    runs = CandidateRuns(part.terms, row.search, row.limits)
    begin = [[short.index(place[x]) for x in ahead.terms]]
    begin.append([k for k in begin[0] if len(part.terms[k]) <= 1])
    most = s.size or min(MOST_TERMS, max(gram.samples // 8, 1))
    trials = []
    seen: set[frozenset[int]] = set()
    for start in begin:
        if not start or frozenset(start) in seen or len(start) > most:
            continue
        for chosen, _ in select_by_simulation(part, runs, start, most):
            if frozenset(chosen) not in seen:
                seen.add(frozenset(chosen))
                how = f"simulation error, {len(chosen)} terms"
                original = [short[k] for k in chosen]
                trials.append(_least_squares(row, grams, original, how))
    return trials


def subset(gram: TermGram, chosen: Sequence[int]) -> TermGram:
    """The Gram matrix of some of its terms."""
    where = np.asarray(chosen, dtype=int)
    return replace(
        gram,
        terms=tuple(gram.terms[k] for k in chosen),
        norms=gram.norms[where],
        gram=gram.gram[np.ix_(where, where)],
        right=gram.right[where],
    )


def _distinct(trials: Sequence[Trial], count: int) -> list[Trial]:
    distinct: list[Trial] = []
    for t in trials:
        if all(set(t.terms) != set(f.terms) for f in distinct):
            distinct.append(t)
        if len(distinct) == count:
            break
    return distinct
