"""How Wiener–Hammerstein models are fitted.

Short fits rank the starts (``wiener_hammerstein_starts``), the best few are fitted longer, and the
winner grows in samples, in intervals of its spline and, where orders are open, in numerators.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.record import Record
from sysid.errors import ModelError
from sysid.estimation.block_fit import ChainData, abscissae, descend, outer_abscissae
from sysid.estimation.block_outcome import finished
from sysid.estimation.holdout import hold_out, shortened
from sysid.estimation.orders import orders_text, tie_margin
from sysid.estimation.search import FitOptions
from sysid.estimation.static_change import with_statics
from sysid.estimation.strategies import Outcome, Warm
from sysid.estimation.wiener_hammerstein_starts import Candidate, ranked_starts
from sysid.structures.base import Parameter
from sysid.structures.model import StartReport
from sysid.structures.static import Static, parse_static
from sysid.structures.wiener_hammerstein import WienerHammerstein

SHORT, MIDDLE, LONG = 2_500, 10_000, 40_000
"""Samples of the fits that rank, that choose and that settle; the last search sees all."""

GROWTH = (8, 12, 18, 26, 38)
"""Points of the splines tried after that of the starts."""

KINDS = ("dead-zone", "saturation", "saturation-upper", "saturation-lower", "polynomial:3")
"""Kinds tried in the place of the spline."""

RANKED, EACH, CHOSEN = 8, 3, 2
"""Starts fitted longer, of every size where orders are open, and of these those settled."""

TOTALS = (2, 4, 6)
"""Poles of the best linear approximation tried when no orders are given."""

BEARS = 100
"""Samples that must stand behind each of these poles."""

UNEVEN = 2
"""Largest difference of the two blocks' orders tried then."""

PAYS = 0.99
"""A finer spline must lower the held-out error below this share."""


def fit(
    structure: WienerHammerstein,
    records: Sequence[Record],
    options: FitOptions,
    parameters: tuple[Parameter, ...],
    warm: Warm,
) -> Outcome:
    """Rank the ways of dealing the poles out, fit the best ones, grow the winner."""
    plain = replace(structure.resolved(records[0].inputs), asked=None, choose_orders=False)
    open_static = structure.asked is None or structure.asked.open
    short, middle, settled = (_held_out(records, n) for n in (SHORT, MIDDLE, LONG))
    tried: list[Candidate] = []
    for orders in _orders(structure, sum(len(r) for r in records)):
        tried += ranked_starts(orders, records, short.data)
    if not tried:
        raise ModelError(
            f"{structure.name}: no start gives a finite error; lower the orders or check the data"
        )
    if structure.choose_orders:
        kept = _best_of_each_size(tried)
    else:
        kept = sorted(tried, key=lambda c: c.found.cost)[:RANKED]
    longer = [_moved(c, middle, 25) for c in kept]
    longer.sort(key=lambda c: c.found.held)
    models = [_moved(c, settled, 40) for c in longer[:CHOSEN]]
    best = min(models, key=lambda c: c.found.held)
    if open_static:
        best, more = _grown(best, settled)
    else:
        best = _as_asked(best, plain.statics, settled)
        more = [best]
    if structure.choose_orders:
        best, wider = _widened(best, records, settled)
        more += wider
    starts = [(best.label, best.found.theta)]
    starts += [(name, theta) for name, theta in warm if len(theta) == best.structure.chain.n]
    reports = tuple(
        StartReport("all", c.label, None, c.found.cost, c.found.evaluations)
        for c in (*tried, *longer, *models, *more)
    )
    return finished(best.structure, records, options, parameters, starts, reports)


@dataclass(frozen=True, eq=False)
class Part:
    """Part of the data with its hold-out."""

    records: tuple[Record, ...]
    data: ChainData
    margin: float


def _held_out(records: Sequence[Record], samples: int) -> Part:
    cut = hold_out(shortened(records, samples))
    return Part(cut.whole, ChainData.of(cut.whole, cut.counted), tie_margin(cut.held))


def _orders(structure: WienerHammerstein, samples: int) -> Iterator[WienerHammerstein]:
    """The structures whose poles are dealt out: as given, or of several sizes."""
    plain = replace(structure, asked=None, choose_orders=False)
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
                yield replace(sized, asked=None, choose_orders=False)


def _best_of_each_size(tried: Sequence[Candidate]) -> list[Candidate]:
    """The best few of every total order."""
    sizes: dict[int, list[Candidate]] = {}
    for c in sorted(tried, key=lambda c: c.found.cost):
        sizes.setdefault(c.structure.chain.n, []).append(c)
    return [c for group in sizes.values() for c in group[:EACH]]


def _moved(c: Candidate, part: Part, evaluations: int, tolerance: float = 1e-5) -> Candidate:
    """The same model fitted to other data."""
    found = descend(
        c.found.chain,
        c.found.theta,
        part.data,
        evaluations=evaluations,
        held_entries=abscissae(c.found.chain),
        tolerance=tolerance,
    )
    return replace(c, found=found)


def _with_static(c: Candidate, statics: Sequence[Static], part: Part) -> Candidate:
    """Another static that follows the present one, then fitted; points move last."""
    changed = with_statics(c.found, 1, statics, part.data)
    fixed = abscissae(changed.chain)
    found = descend(
        changed.chain, changed.p, part.data, evaluations=40, held_entries=fixed, tolerance=1e-5
    )
    if fixed:
        inner = outer_abscissae(changed.chain)
        moved = descend(
            found.chain, found.p, part.data, evaluations=40, held_entries=inner, tolerance=1e-5
        )
        if not moved.held > found.held:
            found = moved
    texts = ", ".join(dict.fromkeys(s.text for s in statics))
    structure = c.structure.with_chain(found.chain)
    return Candidate(structure, found, f"{_orders_text(structure)}, static {texts}")


def _grown(best: Candidate, part: Part) -> tuple[Candidate, list[Candidate]]:
    """Finer splines as long as they pay, then simpler kinds that do as well."""
    nu = best.structure.nu
    tried = []
    for size in GROWTH:
        finer = _with_static(best, [parse_static(f"spline:{size}")] * nu, part)
        tried.append(finer)
        if finer.found.held > PAYS * best.found.held:
            break
        best = finer
    limit = (1.0 + part.margin) * best.found.held
    for kind in KINDS:
        other = _with_static(best, [parse_static(kind)] * nu, part)
        tried.append(other)
        if other.found.held <= limit and other.structure.chain.n < best.structure.chain.n:
            best = other
    return best, tried


def _widened(
    best: Candidate, records: Sequence[Record], part: Part
) -> tuple[Candidate, list[Candidate]]:
    """One more numerator coefficient in the first block, then in the second, where that pays.

    Sampling a continuous-time circuit gives its blocks numerators that its poles do not limit.
    """
    tried = []
    for name in ("nb1", "nb"):
        s = best.structure
        raw = s.order_values()
        raw[name] = _one_more(raw[name])
        wide = WienerHammerstein.from_orders(raw, s.nu, s.ny)
        wide = replace(wide, statics=s.statics, asked=None, choose_orders=False)
        channels = records[0].inputs, records[0].outputs
        known = dict(
            zip([p.name for p in s.parameters(*channels)], best.found.theta.tolist(), strict=True)
        )
        theta = np.array([known.get(p.name, 0.0) for p in wide.parameters(*channels)])
        found = descend(wide.chain, theta, part.data, evaluations=40, tolerance=1e-5)
        tried.append(Candidate(wide, found, f"{_orders_text(wide)}, one more {name}"))
        if found.held < PAYS * best.found.held:
            best = tried[-1]
    return best, tried


def _one_more(order: Any) -> Any:
    if isinstance(order, list):
        return [_one_more(o) for o in order]
    return order + 1


def _as_asked(best: Candidate, statics: Sequence[Static], part: Part) -> Candidate:
    """The statics the user asked for, by way of a finer spline."""
    finer = [s if s.is_identity else parse_static(f"spline:{GROWTH[0]}") for s in statics]
    return _with_static(_with_static(best, finer, part), statics, part)


def _orders_text(s: WienerHammerstein) -> str:
    return orders_text(s.order_values())
