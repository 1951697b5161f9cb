"""Input delays for the order search: those of the log, as orders express them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.checks.delay import Delay
from sysid.data.facts import LogFacts
from sysid.structures.orders import MAX_ORDER

WEAK = 0.05
"""An input that explains less than this part of what the output's main input explains takes that
one's delay, unless a process model shows its own: a regression's is mostly chance."""

PLAIN = 1
"""The delay of a plant without dead time."""


@dataclass(frozen=True)
class ChosenDelay:
    """The delay to search with.

    Attributes:
        nk: a number where all pairs agree, else a matrix (outputs × inputs).
        notes: sentences about delays that orders cannot express.
    """

    nk: int | list[list[int]]
    notes: tuple[str, ...] = ()


def chosen_delay(facts: LogFacts) -> ChosenDelay:
    """The delay of every pair, as ``inspect`` says it: a number where all agree, else a matrix."""
    delays = facts.delays
    if delays is None:
        return ChosenDelay(PLAIN)
    notes = tuple(
        f"{d.output} seems to respond to {d.input} after {d.delay} samples, more than the "
        f"{MAX_ORDER} that orders allow; the search left this delay out. If it is real, decimate."
        for d in delays
        if d.delay is not None and d.delay > MAX_ORDER
    )
    delays = tuple(d if (d.delay or 0) <= MAX_ORDER else replace(d, delay=None) for d in delays)
    rows = [
        _row([d for d in delays if d.output == output]) for output in facts.records[0].output_names
    ]
    alike = len({nk for row in rows for nk in row}) == 1
    return ChosenDelay(rows[0][0] if alike else rows, notes)


def _row(delays: Sequence[Delay]) -> list[int]:
    """The delays to one output; an input without visible effect has that of the main one."""
    main = max(delays, key=lambda d: d.evidence)
    common = PLAIN if main.delay is None else main.delay
    return [
        common
        if d.delay is None or (d.evidence < WEAK * main.evidence and np.isnan(d.dead_s))
        else d.delay
        for d in delays
    ]
