"""Holding data out: how orders and structures are chosen without touching validation data."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Record

BLOCKS = 10
LONG_ENOUGH = 600
"""Records from this many samples on are cut into interleaved blocks, shorter ones at 70 %."""

MANY = 4
"""From this many records on each is cut once: every piece costs initial states to estimate."""


@dataclass(frozen=True, eq=False)
class HoldOut:
    """Estimation data cut into what is fitted and what chooses.

    Attributes:
        train: pieces to fit on, each with an initial state of its own.
        held: the pieces held out.
        whole: the records uncut: a free run goes through all of a record, because a state fitted
            to the head of a short block would hide a model that drifts.
        counted: by record, the samples of ``whole`` that are held out, (N,) each.
        words: what was done.
    """

    train: tuple[Record, ...]
    held: tuple[Record, ...]
    whole: tuple[Record, ...]
    counted: tuple[NDArray[np.bool_], ...]
    words: str

    @property
    def samples(self) -> int:
        """Samples to fit on."""
        return sum(len(r) for r in self.train)


def hold_out(records: Sequence[Record]) -> HoldOut:
    """Split estimation data into a part to fit on and a part to choose on.

    A few long records give three of ten interleaved blocks, so that the held-out part covers the
    operating range even where a record is ordered by level or sign; short ones, and each of
    many, give their last 30 %.
    """
    train: list[Record] = []
    held: list[Record] = []
    counted = []
    once = [len(r) < LONG_ENOUGH or len(records) >= MANY for r in records]
    for r, cut_once in zip(records, once, strict=True):
        n = len(r)
        edges = [round(k * n / BLOCKS) for k in range(BLOCKS + 1)]
        # T T H  T T H  T T H  T: the blocks to fit on stay joined in pairs
        fitted = [(edges[k], edges[min(k + 2, BLOCKS)]) for k in (0, 3, 6, 9)]
        chosen = [(edges[k], edges[k + 1]) for k in (2, 5, 8)]
        if cut_once:
            fitted, chosen = [(0, edges[7])], [(edges[7], n)]
        train += [r.rows(a, b) for a, b in fitted]
        held += [r.rows(a, b) for a, b in chosen]
        mask = np.zeros(n, dtype=bool)
        for a, b in chosen:
            mask[a:b] = True
        counted.append(mask)
    words = (
        "the last 30 % of the estimation data"
        if all(once) and len(records) == 1
        else "the last 30 % of each piece of the estimation data"
        if all(once)
        else "three of ten interleaved blocks of the estimation data"
    )
    return HoldOut(tuple(train), tuple(held), tuple(records), tuple(counted), words)


def shortened(records: Sequence[Record], samples: int) -> tuple[Record, ...]:
    """At most ``samples`` samples in all, as evenly spread contiguous pieces of each record.

    Order searches on very long logs cost more than they tell; the chosen orders are then
    fitted to everything.
    """
    total = sum(len(r) for r in records)
    if total <= samples:
        return tuple(records)
    found: list[Record] = []
    pieces = 4
    for r in records:
        each = max(int(len(r) * samples / total) // pieces, 1)
        stride = len(r) / pieces
        found += [r.rows(int(k * stride), int(k * stride) + each) for k in range(pieces)]
    return tuple(found)
