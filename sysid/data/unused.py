"""Columns of a log that were chosen for nothing, on the rows of its records.

A gain that seems to change with time may go with one of them: the throttle of a car whose steering
is looked at, the length of a crane's rope.
"""

from dataclasses import replace

import numpy as np

from sysid.data.column_words import is_set_point
from sysid.data.reading.columns import Choice
from sysid.data.reading.table import Table
from sysid.data.reading.time_column import is_counter, is_time
from sysid.data.record import Array, Record

MOST_COLUMNS, MOST_CELLS, MIN_CELLS = 20, 5_000_000, 20
"""Columns and cells that are read for it at most, and cells that a column must have."""


def with_unused(table: Table, choice: Choice, t: Array, records: list[Record]) -> list[Record]:
    """Records with the unused columns of numbers that move to and fro, on lines between rows.

    Args:
        t: instants of the rows of the table [s], (N,).
    """
    names = [n for n in choice.ignored if not (is_set_point(n) or is_time(n) or is_counter(n))]
    found = {}
    for name in names[: min(MOST_COLUMNS, MOST_CELLS // len(t))]:
        column = None if table.is_date(name) else table.read(name)
        if column is None:
            continue
        rows = np.flatnonzero(np.isfinite(column) & np.isfinite(t))
        rows = rows[np.argsort(t[rows], kind="stable")]
        step = np.diff(column[rows])
        if len(rows) >= MIN_CELLS and np.any(step > 0.0) and np.any(step < 0.0):
            found[name] = t[rows], column[rows]
    if not found:
        return records
    each = ([np.interp(r.t, *column) for column in found.values()] for r in records)
    return [
        replace(r, unused=np.column_stack(values), unused_names=tuple(found))
        for r, values in zip(records, each, strict=True)
    ]
