"""Which input delay to search with: estimated from the data, confirmed by free runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.delay import Delay, estimate_delays
from sysid.data.feedback import in_feedback
from sysid.data.record import Record
from sysid.errors import DataError, ModelError
from sysid.estimation.holdout import HoldOut, allowing
from sysid.estimation.orders import free_run_error, searching, tie_margin
from sysid.estimation.pem import fit_prepared
from sysid.estimation.search import FitOptions
from sysid.structures.constant_input import with_constant, with_ones
from sysid.structures.oe import OE
from sysid.structures.orders import MAX_ORDER
from sysid.structures.polynomial import PolynomialStructure

LONGEST_DELAY = 30
"""Delays up to this one are looked for everywhere, longer ones where a correlation shows them."""

WEAK = 0.05
"""An input that explains less than this part of what the output's main input explains takes that
one's delay: its own is mostly chance."""

PLAIN = 1
"""The delay of a plant without dead time."""

Row = tuple[int, ...]


@dataclass(frozen=True)
class ChosenDelay:
    """The delay to search with.

    Attributes:
        nk: a number where all pairs agree, else a matrix (outputs × inputs).
        notes: sentences about delays that orders cannot express.
    """

    nk: int | list[list[int]]
    notes: tuple[str, ...] = ()


def choose_delay(data: HoldOut, level: bool = False) -> int | list[list[int]]:
    """What :func:`chosen_delay` finds, without its sentences."""
    return chosen_delay(data, level).nk


def chosen_delay(data: HoldOut, level: bool = False) -> ChosenDelay:
    """The delay of every pair: a number where all agree, else a matrix (outputs × inputs).

    The long regression that estimates delays misleads where the sampling is much faster than the
    plant (it is biased by the noise) and in closed loop (a controller that answers within
    the sample looks like a delay of zero). So, output by output, each delay that the data allow is
    tried in a free run of low order; the estimate stays unless another one is clearly better,
    and a plant without dead time is preferred where a single coefficient an input, which leaves
    no slack to hide a delay in, does as well.

    Args:
        data: what to fit and what to choose on, offsets removed.
        level: whether each of these models estimates a level of its own.
    """
    first = data.whole[0]
    try:
        longest = min(LONGEST_DELAY, max(min(len(r) for r in data.whole) // 20, 2))
        found = estimate_delays(data.whole, longest, shortest=int(in_feedback(data.whole)))
    except DataError:
        return ChosenDelay(PLAIN)
    notes = tuple(
        f"{d.output} seems to answer to {d.input} after {d.delay} samples, more than the "
        f"{MAX_ORDER} that orders allow; the search left this delay out. If it is real, decimate."
        for d in found
        if d.delay is not None and d.delay > MAX_ORDER
    )
    found = tuple(d if (d.delay or 0) <= MAX_ORDER else replace(d, delay=None) for d in found)
    rows = [
        _confirmed(_only(data, output), [d for d in found if d.output == output], level)
        for output in first.output_names
    ]
    alike = len({nk for row in rows for nk in row}) == 1
    return ChosenDelay(rows[0][0] if alike else [list(row) for row in rows], notes)


def _confirmed(data: HoldOut, found: Sequence[Delay], level: bool) -> Row:
    """The delays to one output."""
    estimate = _estimate(found)
    plain = (PLAIN,) * len(found)
    if estimate == plain:
        return plain
    data = allowing(data, [estimate])
    tried = {
        row: _errors(data, row, level) for row in (estimate, *_neighbours(found, estimate), plain)
    }
    best = min(min(errors) for errors in tried.values())
    limit = (1.0 + tie_margin(data.held)) * best
    if not np.isfinite(best):
        return estimate
    if tried[plain][0] <= limit:
        return plain
    if min(tried[estimate]) <= limit:
        return estimate
    return min(tried, key=lambda row: min(tried[row]))


def _estimate(found: Sequence[Delay]) -> Row:
    main = max(found, key=lambda d: d.evidence)
    common = PLAIN if main.delay is None else main.delay
    return tuple(
        common if d.delay is None or d.evidence < WEAK * main.evidence else d.delay for d in found
    )


def _neighbours(found: Sequence[Delay], estimate: Row) -> list[Row]:
    """The estimate moved by a sample either way, as far as the main input allows."""
    main = max(found, key=lambda d: d.evidence)
    steps = [
        s for s in (-1, 1) if main.delay is not None and main.low <= main.delay + s <= main.high
    ]
    return [tuple(nk + s for nk in estimate) for s in steps if min(estimate) + s >= 0]


def _errors(data: HoldOut, row: Row, level: bool) -> tuple[float, float]:
    """Free-run error with one coefficient an input and with two, the better of one and two poles.

    Fitted as output error, which does not suffer from the noise as ARX does.
    """
    one, two = (
        min(_error(data, {"nb": nb, "nf": nf, "nk": [list(row)]}, level) for nf in (1, 2))
        for nb in (1, 2)
    )
    return one, two


def _error(data: HoldOut, orders: dict[str, Any], level: bool) -> float:
    structure: PolynomialStructure = OE.from_orders(orders, data.whole[0].nu, 1)
    if level:
        structure, data = with_constant(structure, (True,)), data.of(with_ones)
    try:
        theta = fit_prepared(structure, data.train, searching(FitOptions())).theta
    except (DataError, ModelError):
        return float("inf")
    if not structure.stable(theta):
        return float("inf")
    return free_run_error(structure, theta, data.whole, data.counted)


def _only(data: HoldOut, output: str) -> HoldOut:
    """The data of one output."""

    def part(records: Sequence[Record]) -> tuple[Record, ...]:
        return tuple(r.select(r.input_names, [output]) for r in records)

    return HoldOut(part(data.train), part(data.held), part(data.whole), data.counted, data.words)
