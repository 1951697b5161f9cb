"""How Wiener–Hammerstein models are fitted.

Short fits rank the starts (``wiener_hammerstein_starts``), the best few are fitted longer, and the
winner grows in samples, in intervals of its spline and, where orders are open, in numerators.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sysid.data.record import Record, shortened
from sysid.errors import ModelError
from sysid.fitting.holdout import hold_out
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Parameter
from sysid.structures.base import Structure
from sysid.structures.blocks.candidates import by_names, last_search, points_last, preferred
from sysid.structures.blocks.changed_statics import with_statics
from sysid.structures.blocks.fit import (
    ChainData,
    abscissae,
    descend,
)
from sysid.structures.blocks.static.functions import Static, parse_static
from sysid.structures.blocks.wiener_hammerstein import WienerHammerstein
from sysid.structures.blocks.wiener_hammerstein_starts import Candidate, ranked_starts
from sysid.structures.orders import orders_text
from sysid.structures.outcome import FitOutcome, InitialGuesses

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

FINE = "spline:12"
"""A spline that shows which start is right: on a coarse one a sharp bend hides it."""

TOTALS = (2, 4, 6)
"""Poles of the best linear approximation tried when no orders are given."""

BEARS = 100
"""Samples that must stand behind each of these poles."""

UNEVEN = 2
"""Largest difference of the two blocks' orders tried then."""

PAYS = 0.99
"""A finer spline must lower the held-out error below this share."""


def fit(
    structure: Structure,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    initial_guesses: InitialGuesses,
) -> FitOutcome:
    """Rank the ways of dealing the poles out, fit the best ones, grow the winner."""
    assert isinstance(structure, WienerHammerstein)
    plain = replace(structure.resolved(records[0].inputs), requested=None, choose_orders=False)
    open_static = structure.requested is None or structure.requested.open
    short, middle, settled = (_held_out(records, n) for n in (SHORT, MIDDLE, LONG))
    tried: list[Candidate] = []
    for orders in _orders(structure, sum(len(r) for r in records)):
        tried += ranked_starts(orders, records, short.data)
    if not tried:
        raise ModelError(
            f"{structure.name}: no start gives a finite error; lower the orders or check the data"
        )
    longer = [_moved(c, middle, 20) for c in _best_of_each(tried, EACH, RANKED, _cost)]
    fine = [parse_static(FINE)] * structure.nu
    finer = [_with_static(c, fine, middle) for c in _best_of_each(longer, 1, FINER, _holdout_error)]
    finer.sort(key=lambda c: c.found.holdout_error)
    models = [_moved(c, settled, 40) for c in finer[:CHOSEN]]
    best = preferred(models, settled.data)
    if open_static:
        best, more = _grown(best, settled)
    else:
        best = _as_requested(best, plain.statics, settled)
        more = [best]
    if structure.choose_orders:
        best, wider = _widened(best, records, settled)
        more += wider
    every = (*tried, *longer, *finer, *models, *more)
    return last_search(best, every, records, options, parameters, initial_guesses)


@dataclass(frozen=True, eq=False)
class Part:
    """Part of the data with its hold-out."""

    records: tuple[Record, ...]
    data: ChainData


def _held_out(records: Sequence[Record], samples: int) -> Part:
    cut = hold_out(shortened(records, samples))
    return Part(cut.whole, ChainData.of(cut.whole, cut.counted))


def _orders(structure: WienerHammerstein, samples: int) -> Iterator[WienerHammerstein]:
    """The structures whose poles are dealt out: as given, or of several sizes."""
    plain = replace(structure, requested=None, choose_orders=False)
    if not structure.choose_orders:
        yield plain
        return
    nk = structure.orders.value("nk")
    totals = TOTALS if structure.nu * structure.ny == 1 else TOTALS[:2]
    for total in totals:
        for first in range(1, total):
            second = total - first
            if abs(first - second) <= UNEVEN and (total == TOTALS[0] or samples > BEARS * total):
                orders = {"nb1": first + 1, "nf1": first, "nb": second + 1, "nf": second, "nk": nk}
                sized = WienerHammerstein.from_orders(orders, structure.nu, structure.ny)
                yield replace(sized, requested=None, choose_orders=False)


def _best_of_each(
    tried: Sequence[Candidate], each: int, overall: int, by: Callable[[Candidate], float]
) -> list[Candidate]:
    """The best few of all, and of every pair of orders: short fits mislead between orders."""
    ordered = sorted(tried, key=by)
    kept = ordered[:overall]
    counts: dict[str, int] = {}
    for c in ordered:
        name = _orders_text(c.structure)
        counts[name] = counts.get(name, 0) + 1
        if counts[name] <= each and c not in kept:
            kept.append(c)
    return kept


def _cost(c: Candidate) -> float:
    return c.found.cost


def _holdout_error(c: Candidate) -> float:
    return c.found.holdout_error


def _moved(c: Candidate, part: Part, evaluations: int, tolerance: float = 1e-5) -> Candidate:
    """The same model fitted to other data."""
    solution = descend(
        c.found.chain,
        c.found.theta,
        part.data,
        evaluations=evaluations,
        fixed_entries=abscissae(c.found.chain),
        tolerance=tolerance,
    )
    return replace(c, found=solution)


def _with_static(c: Candidate, statics: Sequence[Static], part: Part) -> Candidate:
    """Another static that follows the present one, then fitted; points move last."""
    changed = with_statics(c.found, 1, statics, part.data)
    solution = points_last(changed, part.data, 40, 1e-5)
    texts = ", ".join(dict.fromkeys(s.text for s in statics))
    structure = c.structure.with_chain(solution.chain)
    return Candidate(structure, solution, f"{_orders_text(structure)}, static {texts}")


def _grown(best: Candidate, part: Part) -> tuple[Candidate, list[Candidate]]:
    """Finer splines as long as they pay, then the simpler kinds beside them.

    Points moved to where the spline bends gained nothing, even for a sharp diode: what is left
    then is what happens between the samples.
    """
    nu = best.structure.nu
    tried = []
    for size in GROWTH:
        finer = _with_static(best, [parse_static(f"spline:{size}")] * nu, part)
        tried.append(finer)
        if finer.found.holdout_error > PAYS * best.found.holdout_error:
            break
        best = finer
    kinds = [_with_static(best, [parse_static(kind)] * nu, part) for kind in KINDS]
    return preferred([best, *kinds], part.data), [*tried, *kinds]


def _widened(
    best: Candidate, records: Sequence[Record], part: Part
) -> tuple[Candidate, list[Candidate]]:
    """Further numerator coefficients where they pay: earlier lags first, then later ones.

    Sampling a continuous-time circuit gives its blocks numerators that its poles do not limit, and
    the delay of a smooth filter, as it is read off a log, is longer than the circuit's own: its
    first coefficients are small but not zero.
    """
    tried = []

    def paid(**more: int) -> bool:
        nonlocal best
        wide = _wider(best, records, part, more)
        tried.append(wide)
        before, best = best, preferred([best, wide], part.data)
        return best is not before

    while min(min(row) for row in best.structure.orders.nk) > 0 and paid(nk=-1, nb=1):
        pass
    paid(nb1=1)
    paid(nb=1)
    return best, tried


def _wider(
    best: Candidate, records: Sequence[Record], part: Part, more: Mapping[str, int]
) -> Candidate:
    """The same model with some orders changed by so much, fitted again."""
    s = best.structure
    raw = s.order_values()
    raw |= {name: _changed(raw[name], by) for name, by in more.items()}
    wide = WienerHammerstein.from_orders(raw, s.nu, s.ny)
    wide = replace(wide, statics=s.statics, requested=None, choose_orders=False)
    theta = by_names(wide, best.values(records), records)
    solution = descend(wide.chain, theta, part.data, evaluations=40, tolerance=1e-5)
    words = ", ".join(f"{name} {by:+d}" for name, by in more.items())
    return Candidate(wide, solution, f"{_orders_text(wide)}, {words}")


def _changed(order: Any, by: int) -> Any:
    if isinstance(order, list):
        return [_changed(o, by) for o in order]
    return order + by


def _as_requested(best: Candidate, statics: Sequence[Static], part: Part) -> Candidate:
    """The statics the user asked for, by way of a finer spline."""
    finer = [s if s.is_identity else parse_static(FINE) for s in statics]
    return _with_static(_with_static(best, finer, part), statics, part)


def _orders_text(s: WienerHammerstein) -> str:
    return orders_text(s.order_values())
