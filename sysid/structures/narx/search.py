"""Search for the products and units of one output's map: a grid of starts, judged and refined."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from sysid.data.record import Array
from sysid.structures.difference_equations.signals import Signal
from sysid.structures.difference_equations.trials import as_good_as
from sysid.structures.narx.simulation_error import RowRuns, Trial
from sysid.structures.narx.structure import NarxWavelet
from sysid.structures.narx.wavelet_frame import (
    Dictionary,
    Units,
    dictionary,
    least_squares,
    projected,
    scaled_design,
    select_products,
    select_units,
    separate,
)
from sysid.structures.narx.wavelet_network import DEGREE, RowDesign

RUNGS = (50, 500)
"""Chunk lengths of the refinement, each started from the last."""

ITERATIONS = 12
FEWER = 6
SHORT = 2_000
"""Iterations of the refinement on each rung: on records of at least SHORT samples fewer, because
all their data together refine the winner once more."""

PRODUCTS = (3, 8, 20)
"""Numbers of products tried, up to what generalised cross-validation allows."""

BELOW = 8
"""Products under a network at most."""

UNITS = (3, 6, 12, 20)
DIMENSIONS = {"each": 1, "pairs": 2, "outputs": 3, "all": 4}
"""Entries of v that a unit sees: one regressor, two of them, or so many principal components."""

PAIRED = 8
"""Regressors among which pairs are looked for at most."""


def search_row(row: RowRuns, rungs: Sequence[int], simulate: bool) -> tuple[Trial, list[Trial]]:
    """The best map of one output, and all that were tried.

    Args:
        rungs: chunk lengths of the refinement; none for least squares only.
        simulate: whether only refined maps may win.
    """
    tried = row.judged(one_step_trials(row))
    if not rungs:
        return best(tried), tried
    current = chosen(tried, row.structure.options_given.starts)
    refined: list[Trial] = []
    iterations = ITERATIONS if len(row.y) < SHORT else FEWER
    longest = max(len(y) for _, y in row.whole)
    for rung in dict.fromkeys(min(r, longest) for r in rungs):
        current = row.refined(current, rung, iterations)
        refined += current
    return best(refined if simulate else [*tried, *refined]), [*tried, *refined]


def largest(s: NarxWavelet) -> tuple[int, int, int]:
    """Most products and units of any map, and dimensions that units see."""
    given = s.options_given
    products = 0 if given.degree == 1 else max(PRODUCTS)
    units = max(UNITS) if given.units is None else given.units
    names = tuple(DIMENSIONS) if given.network == "auto" else (given.network,)
    seen = min(max(DIMENSIONS[n] for n in names), max(len(row) for row in s.rows))
    return products, units, seen if units else 0


def best(trials: Sequence[Trial]) -> Trial:
    """The smallest of those that are as good as the best."""
    return as_good_as(min(t.error for t in trials), trials)[0]


def chosen(trials: Sequence[Trial], count: int) -> list[Trial]:
    """What is refined: the best of each kind of map first, then the next best of all."""
    ordered = sorted((t for t in trials if np.isfinite(t.error)), key=lambda t: t.error)
    ordered = ordered or list(trials)
    kinds: dict[tuple[bool, bool], Trial] = {}
    for t in ordered:
        kinds.setdefault((bool(t.design.terms), bool(t.design.flags)), t)
    leaders = sorted(kinds.values(), key=lambda t: t.error)
    rest = [t for t in ordered if all(t is not k for k in leaders)]
    return [*leaders, *rest][:count]


def one_step_trials(row: RowRuns) -> list[Trial]:
    """Maps of several degrees, sets of regressors and sizes, each by least squares."""
    given = row.structure.options_given
    plain = scaled_design(row.x, given.margin)
    degrees = (given.degree,) if given.degree else range(1, DEGREE + 1)
    trials: list[Trial] = []
    dictionaries = _dictionaries(row, plain) if given.units != 0 else {}
    for degree in degrees:
        terms: tuple[tuple[int, ...], ...] = ()
        if degree == 1:
            if not given.units:
                trials.append(_trial(row, plain, None, "linear"))
        else:
            pool, most = select_products(plain, row.x, row.y, degree, max(PRODUCTS))
            sizes = sorted({n for n in PRODUCTS if n < most} | {min(most, max(PRODUCTS))})
            for n in sizes if not given.units else ():
                if n:
                    design = replace(plain, terms=pool[:n])
                    trials.append(_trial(row, design, None, f"degree {degree}, {n} products"))
            terms = pool[: min(most, BELOW)]
            if not terms:
                continue
        if given.units != 0:
            trials += _networks(row, terms, degree, dictionaries)
    if not trials:
        trials.append(_trial(row, plain, None, "linear"))
    return trials


Dictionaries = Mapping[str, tuple[RowDesign, Dictionary]]
"""For each kind of network a design with its Q and no products, and candidate units over it."""


def _dictionaries(row: RowRuns, plain: RowDesign) -> Dictionaries:
    given = row.structure.options_given
    names = tuple(DIMENSIONS) if given.network == "auto" else (given.network,)
    sets = {name: seen(row, name) for name in names}
    if given.network == "auto" and sets["outputs"] == sets["all"]:
        del sets["outputs"]
    if given.network == "auto" and len(row.row) == 1:
        sets = {"each": sets["all"]}
    if given.network == "auto" and len(row.row) == 2:
        del sets["pairs"]
    dictionaries = {}
    for name, regressors in sets.items():
        views = groups(regressors, DIMENSIONS[name]) if name in ("each", "pairs") else ()
        if views:
            design = separate(plain, row.x)
        else:
            design = projected(plain, row.x, regressors, DIMENSIONS[name])
        dictionaries[name] = design, dictionary(design, row.x, row.estimator, given.seed, views)
    return dictionaries


def _networks(
    row: RowRuns, terms: tuple[tuple[int, ...], ...], degree: int, dictionaries: Dictionaries
) -> list[Trial]:
    given = row.structure.options_given
    most = given.units or max(UNITS)
    networks = []
    for name, (plain, candidates) in dictionaries.items():
        design = replace(plain, terms=terms)
        s = select_units(design, row.x, row.y, candidates, most)
        if given.units:
            sizes = [min(given.units, len(s.order))]
        else:
            sizes = sorted({n for n in UNITS if n < s.most} | {min(s.most, most)})
        for n in sizes:
            if n:
                full, units = s.leading(design, n)
                words = f"degree {degree}, {n} units over {name}"
                networks.append(_trial(row, full, units, words))
    return networks


def seen(row: RowRuns, name: str) -> list[int]:
    """Regressors the units see: the output's own lags and the newest of every input, or all."""
    every_regressor = list(range(len(row.row)))
    if name in ("each", "all") or (name == "pairs" and len(every_regressor) <= PAIRED):
        return every_regressor
    past_outputs = [k for k, e in enumerate(row.row) if isinstance(e, Signal) and e.kind == "y"]
    newest: dict[int, int] = {}
    for k, e in enumerate(row.row):
        if isinstance(e, Signal) and e.kind == "u" and e.channel < row.structure.nu:
            newest.setdefault(e.channel, k)
    columns = sorted([*past_outputs, *newest.values()])
    return columns[:PAIRED] if name == "pairs" else columns


def groups(regressors: Sequence[int], size: int) -> list[tuple[int, ...]]:
    """Every regressor, or every pair of them; all of them where they are fewer."""
    return list(combinations(regressors, min(size, len(regressors))))


def _trial(row: RowRuns, design: RowDesign, units: Units | None, how: str) -> Trial:
    nothing: tuple[Array, Array, Array] = (np.zeros(0), np.zeros((0, 0)), np.zeros(0))
    theta = least_squares(design, row.estimator, row.x, row.y, units or nothing)
    return Trial(design, theta, np.inf, how)
