"""Holding data out: how orders and structures are chosen without touching validation data."""

from collections.abc import Sequence

from sysid.data.record import Record

BLOCKS = 10
LONG_ENOUGH = 600
"""Records from this many samples on are cut into interleaved blocks, shorter ones at 70 %."""


def hold_out(records: Sequence[Record]) -> tuple[tuple[Record, ...], tuple[Record, ...], str]:
    """Split estimation data into a part to fit on and a part to choose on.

    Long records give three of ten interleaved blocks, so that the held-out part covers the
    operating range even where a record is ordered by level or sign; short ones give their last
    30 %. Every block starts from a state of its own.

    Returns:
        (records to fit on, records to choose on, what was done in words).
    """
    train: list[Record] = []
    held: list[Record] = []
    for r in records:
        n = len(r)
        if n < LONG_ENOUGH:
            first, last = r.rows(0, round(0.7 * n)), r.rows(round(0.7 * n), n)
            train.append(first)
            held.append(last)
            continue
        edges = [round(k * n / BLOCKS) for k in range(BLOCKS + 1)]
        # T T H  T T H  T T H  T: the blocks to fit on stay joined in pairs
        train += [r.rows(edges[k], edges[min(k + 2, BLOCKS)]) for k in (0, 3, 6, 9)]
        held += [r.rows(edges[k], edges[k + 1]) for k in (2, 5, 8)]
    short = all(len(r) < LONG_ENOUGH for r in records)
    words = (
        "the last 30 % of the estimation data"
        if short
        else "three of ten interleaved blocks of the estimation data"
    )
    return tuple(train), tuple(held), words


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
