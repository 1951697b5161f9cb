"""Input delays for the order search: estimated from the data, confirmed by free runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.checks.delay import Delay
from sysid.data.facts import LogFacts
from sysid.data.record import Array, Record
from sysid.errors import DataError, ModelError
from sysid.estimation.offsets.offsets import Offsets
from sysid.estimation.pem import fit_prepared
from sysid.estimation.selection.orders import searching
from sysid.fitting.holdout import HoldOut, allowing, hold_out, tie_margin
from sysid.fitting.options import FitOptions
from sysid.structures.held_out_error import free_run_error
from sysid.structures.initial_state_window import initial_state_window
from sysid.structures.linear.constant_input import with_constant, with_ones
from sysid.structures.linear.oe import OE
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.orders import MAX_ORDER

WEAK = 0.05
"""An input that explains less than this part of what the output's main input explains takes that
one's delay: its own is mostly chance."""

PLAIN = 1
"""The delay of a plant without dead time."""

EARLIER = 6
"""Samples by which the delay of a plant of two lags may seem longer than it is: at a sampling much
faster than the plant, its answer begins below the noise."""

BLOCKS = 20
"""Stretches of the data whose errors are compared: each far longer than what correlates errors."""

CLEARLY = 2.5
"""Standard errors of the mean difference from which on the shorter delay meets the data better:
one chance in a hundred, and one in twenty over all delays that are looked at."""

Row = tuple[int, ...]
"""Delays of all inputs."""


@dataclass(frozen=True)
class ChosenDelay:
    """The delay to search with.

    Attributes:
        nk: a number where all pairs agree, else a matrix (outputs × inputs).
        notes: sentences about delays that orders cannot express.
    """

    nk: int | list[list[int]]
    notes: tuple[str, ...] = ()


def chosen_delay(facts: LogFacts, offsets: Offsets) -> ChosenDelay:
    """The delay of every pair: a number where all agree, else a matrix (outputs × inputs).

    The long regression that estimates delays misleads where the sampling is much faster than the
    plant (it is biased by the noise) and in closed loop (a controller that answers within
    the sample looks like a delay of zero). So, output by output, each delay that the data allow is
    tried in a free run of low order; the estimate stays unless another one is clearly better,
    and a plant without dead time is preferred where a single coefficient an input, which leaves
    no slack to hide a delay in, does as well. Last, an earlier answer is taken where a plant of two
    lags that begins there meets the data clearly better, stretch by stretch.

    Args:
        offsets: what is removed before, and whether each model estimates a level of its own.
    """
    delays = facts.delays
    if delays is None:
        return ChosenDelay(PLAIN)
    data = hold_out([offsets.detrend.remove(r) for r in facts.sample])
    first, level = data.whole[0], any(offsets.estimated)
    notes = tuple(
        f"{d.output} seems to respond to {d.input} after {d.delay} samples, more than the "
        f"{MAX_ORDER} that orders allow; the search left this delay out. If it is real, decimate."
        for d in delays
        if d.delay is not None and d.delay > MAX_ORDER
    )
    delays = tuple(d if (d.delay or 0) <= MAX_ORDER else replace(d, delay=None) for d in delays)
    rows = [
        _confirmed(_only(data, output), [d for d in delays if d.output == output], level)
        for output in first.output_names
    ]
    if (
        not facts.closed_loop
    ):  # there a free run errs least where it takes noise for the plant's answer
        rows = [
            _as_early_as_seen(_only(data, output), row, level)
            for output, row in zip(first.output_names, rows, strict=True)
        ]
    alike = len({nk for row in rows for nk in row}) == 1
    return ChosenDelay(rows[0][0] if alike else [list(row) for row in rows], notes)


def _confirmed(data: HoldOut, delays: Sequence[Delay], level: bool) -> Row:
    """The delays to one output."""
    estimate = _estimate(delays)
    plain = (PLAIN,) * len(delays)
    if estimate == plain:
        return plain
    data = allowing(data, [estimate])
    tried = {
        row: _errors(data, row, level) for row in (estimate, *_neighbours(delays, estimate), plain)
    }
    best = min(min(errors) for errors in tried.values())
    limit = (1.0 + tie_margin(data.holdout)) * best
    if not np.isfinite(best):
        return estimate
    if tried[plain][0] <= limit:
        return plain
    if min(tried[estimate]) <= limit:
        return estimate
    return min(tried, key=lambda row: min(tried[row]))


def _as_early_as_seen(data: HoldOut, row: Row, level: bool) -> Row:
    """The row, or the same some samples earlier where two lags then err clearly less.

    Models of as many parameters on the same samples are compared by the differences of their
    squared errors, which are far more certain than either sum (Diebold & Mariano 1995, J. Bus.
    Econ. Stat. 13): the means of BLOCKS stretches give their standard error, correlated or not.
    """
    earliest = min(min(row) - PLAIN, EARLIER)
    if earliest < 1:
        return row
    data = allowing(data, [row])
    runs = {
        shift: _squares(data, tuple(nk - shift for nk in row), level)
        for shift in range(earliest + 1)
    }
    here = runs.pop(0)
    if here is None:
        return row
    gains = {shift: here - run for shift, run in runs.items() if run is not None}
    if not gains:
        return row
    if not any(_clearly_positive(gain) for gain in gains.values()):
        return row
    best = max(gains, key=lambda shift: float(gains[shift].mean()))
    return tuple(nk - best for nk in row)


def _clearly_positive(gain: Array) -> bool:
    means = np.array([float(part.mean()) for part in np.array_split(gain, BLOCKS)])
    error = float(means.std(ddof=1)) / np.sqrt(BLOCKS)
    return bool(means.mean() > CLEARLY * error)


def _squares(data: HoldOut, row: Row, level: bool) -> Array | None:
    """Squared free-run errors of two lags with these delays, record after record, (N,)."""
    fitted = _fitted(data, {"nb": 2, "nf": 2, "nk": [list(row)]}, level)
    if fitted is None:
        return None
    structure, theta, whole = fitted
    window = initial_state_window(structure, theta)
    sums = []
    for r in whole:
        state = structure.fitted_state(theta, r.u, r.y, window)
        sums.append((r.y - structure.simulate(theta, r.u, state))[:, 0] ** 2)
    squares = np.concatenate(sums)
    return squares if len(squares) >= BLOCKS and np.all(np.isfinite(squares)) else None


def _estimate(delays: Sequence[Delay]) -> Row:
    main = max(delays, key=lambda d: d.evidence)
    common = PLAIN if main.delay is None else main.delay
    return tuple(
        common if d.delay is None or d.evidence < WEAK * main.evidence else d.delay for d in delays
    )


def _neighbours(delays: Sequence[Delay], estimate: Row) -> list[Row]:
    """The estimate moved by a sample either way, as far as the main input allows."""
    main = max(delays, key=lambda d: d.evidence)
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
    fitted = _fitted(data, orders, level)
    if fitted is None:
        return float("inf")
    structure, theta, whole = fitted
    return free_run_error(structure, theta, whole, data.counted)


def _fitted(
    data: HoldOut, orders: dict[str, Any], level: bool
) -> tuple[PolynomialStructure, Array, tuple[Record, ...]] | None:
    """An output-error model of the part to fit on, and the records as it takes them."""
    structure: PolynomialStructure = OE.from_orders(orders, data.whole[0].nu, 1)
    if level:
        structure, data = with_constant(structure, (True,)), data.of(with_ones)
    try:
        theta = fit_prepared(structure, data.train, searching(FitOptions())).theta
    except (DataError, ModelError):
        return None
    return (structure, theta, data.whole) if structure.stable(theta) else None


def _only(data: HoldOut, output: str) -> HoldOut:
    """The data of one output."""

    def part(records: Sequence[Record]) -> tuple[Record, ...]:
        return tuple(r.select(r.input_names, [output]) for r in records)

    return HoldOut(part(data.train), part(data.holdout), part(data.whole), data.counted, data.words)
