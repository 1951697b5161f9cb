"""What the fit of a Wiener–Hammerstein model tries.

Short fits rank the starts (``wiener_hammerstein_starts``), the best few are fitted longer, and the
winner grows in samples, in intervals of its spline and, where orders are open, in numerators.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

from sysid.data.record import Record
from sysid.errors import ModelError
from sysid.structures.blocks.static.functions import Static, parse_static
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.blocks.trials import (
    ChainData,
    Effort,
    Trial,
    independent_samples_count,
    preferred,
)
from sysid.structures.blocks.wiener_hammerstein import WienerHammerstein
from sysid.structures.blocks.wiener_hammerstein_starts import ranked_starts
from sysid.structures.orders import Orders, orders_text

SHORT, MIDDLE, LONG = 2_500, 10_000, 40_000
"""Samples of the fits that rank, that choose and that settle; the last search sees all."""

GROWTH = (18, 26, 38)
"""Points of the splines tried after that of the starts."""

KINDS = ("dead-zone", "saturation", "saturation-upper", "saturation-lower", "polynomial:3")
"""Kinds tried in the place of the spline."""

RANKED, EACH = 8, 2
"""Starts fitted longer: of all, and at least of every pair of orders."""

FINER, CHOSEN = 4, 2
"""Of these those that get a finer spline (besides one of every pair of orders), and of these those
that are settled."""

FINE = parse_static("spline:12")
"""A spline that shows which start is right: on a coarse one a sharp bend hides it."""

TOTALS = (2, 4, 6)
"""Poles of the best linear approximation tried when no orders are given."""

BEARS = 100
"""Samples that must stand behind each of these poles."""

UNEVEN = 2
"""Largest difference of the two blocks' orders tried then."""

RANKING, SETTLING = Effort(20, 1e-5), Effort(40, 1e-5)
"""Of the descents that rank the best starts, and of all later ones."""

PAYS = 0.99
"""A finer spline must lower the held-out error below this share."""


def proposals(
    structure: WienerHammerstein, records: Sequence[Record]
) -> tuple[Trial, Sequence[Trial]]:
    """The trial to fit to everything, and all trials."""
    resolved = structure.resolved(records[0].inputs, records[0].outputs)
    short, middle, settled = (ChainData.held_out(records, n) for n in (SHORT, MIDDLE, LONG))
    sizes = (
        _sizes(structure, sum(len(r) for r in records)) if structure.choose_orders else [resolved]
    )
    tried = [*chain.from_iterable(ranked_starts(s, records, short) for s in sizes)]
    if not tried:
        raise ModelError(
            f"{structure.name}: no start gives a finite error; lower the orders or check the data"
        )
    ranked = _best_of_each(tried, EACH, RANKED, lambda t: t.cost)
    longer = [t.moved(middle, RANKING) for t in ranked]
    fine = _best_of_each(longer, 1, FINER, lambda t: t.holdout_error)
    finer = [_with_static(t, [FINE] * structure.nu, middle) for t in fine]
    finer.sort(key=lambda t: t.holdout_error)
    models = [t.moved(settled, SETTLING) for t in finer[:CHOSEN]]
    best = _preferred(models, settled)
    if structure.is_open(0):
        best, more = _grown(best, settled)
    else:
        best = best.with_statics(resolved.statics, settled, SETTLING, FINE)
        more = [best]
    if structure.choose_orders:
        best, wider = _widened(best, settled)
        more += wider
    return best, (*tried, *longer, *finer, *models, *more)


def _preferred(tried: Sequence[Trial], data: ChainData) -> Trial:
    """The most probable of the best: splines of so many points are chosen by independent errors."""
    return preferred(tried, data, independent_samples_count)


def _sizes(structure: WienerHammerstein, samples: int) -> Iterator[WienerHammerstein]:
    """The structures whose poles are dealt out where no orders are given."""
    nk = structure.orders.value("nk")
    totals = TOTALS if structure.nu * structure.ny == 1 else TOTALS[:2]
    for total in totals:
        for first in range(1, total):
            second = total - first
            if abs(first - second) <= UNEVEN and (total == TOTALS[0] or samples > BEARS * total):
                orders = {"nb1": first + 1, "nf1": first, "nb": second + 1, "nf": second, "nk": nk}
                yield _plain(structure, orders)


def _plain(structure: BlockStructure, orders: Mapping[str, Any]) -> WienerHammerstein:
    """A settled structure with these orders, without statics."""
    sized = WienerHammerstein.from_orders(orders, structure.nu, structure.ny)
    return replace(sized, requested=None)


def _best_of_each(
    tried: Sequence[Trial], each: int, overall: int, by: Callable[[Trial], float]
) -> list[Trial]:
    """The best few of all, and of every pair of orders: short fits mislead between orders."""
    ordered = sorted(tried, key=by)
    kept = ordered[:overall]
    counts: Counter[tuple[Orders, ...]] = Counter()
    for t in ordered:
        counts[t.structure.linear_blocks] += 1
        if counts[t.structure.linear_blocks] <= each and t not in kept:
            kept.append(t)
    return kept


def _with_static(trial: Trial, statics: Sequence[Static], data: ChainData) -> Trial:
    """Other statics between the blocks, fitted."""
    return trial.with_statics([statics], data, SETTLING)


def _grown(best: Trial, data: ChainData) -> tuple[Trial, list[Trial]]:
    """Finer splines as long as they pay, then the simpler kinds beside them.

    Points moved to where the spline bends gained nothing, even for a sharp diode: what is left
    then is what happens between the samples.
    """
    nu = best.structure.nu
    tried = []
    for size in GROWTH:
        finer = _with_static(best, [parse_static(f"spline:{size}")] * nu, data)
        tried.append(finer)
        if finer.holdout_error > PAYS * best.holdout_error:
            break
        best = finer
    kinds = [_with_static(best, [parse_static(kind)] * nu, data) for kind in KINDS]
    return _preferred([best, *kinds], data), [*tried, *kinds]


def _widened(best: Trial, data: ChainData) -> tuple[Trial, list[Trial]]:
    """Further numerator coefficients where they pay: earlier lags first, then later ones.

    Sampling a continuous-time circuit gives its blocks numerators that its poles do not limit, and
    the delay of a smooth filter, as it is read off a log, is longer than the circuit's own: its
    first coefficients are small but not zero.
    """
    tried = []

    def paid(**more: int) -> bool:
        nonlocal best
        orders = best.structure.order_values()
        orders |= {name: _changed(orders[name], by) for name, by in more.items()}
        wide = _plain(best.structure, orders)
        words = [f"{name} {by:+d}" for name, by in more.items()]
        label = ", ".join([orders_text(wide.order_values()), *words])
        tried.append(best.with_orders(wide.linear_blocks, data, SETTLING, label))
        before, best = best, _preferred([best, tried[-1]], data)
        return best is not before

    while min(min(row) for row in best.structure.orders.nk) > 0 and paid(nk=-1, nb=1):
        pass
    paid(nb1=1)
    paid(nb=1)
    return best, tried


def _changed(order: Any, by: int) -> Any:
    return [_changed(o, by) for o in order] if isinstance(order, list) else order + by
