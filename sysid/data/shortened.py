"""Shorten long logs to evenly spread pieces, for costly tests."""

from collections.abc import Sequence

from sysid.data.record import Record

PIECES = 4
"""Pieces of each record: enough to meet what changes within it, few enough to keep them long."""


def shortened(records: Sequence[Record], samples: int, parts: int = PIECES) -> tuple[Record, ...]:
    """At most ``samples`` samples in all, as evenly spread contiguous pieces of each record."""
    total = sum(len(r) for r in records)
    if total <= samples:
        return tuple(records)
    pieces: list[Record] = []
    for r in records:
        each = max(len(r) * samples // total // parts, 1)
        starts = [k * len(r) // parts for k in range(parts)]
        pieces += [r.rows(start, start + each) for start in starts]
    return tuple(pieces)
