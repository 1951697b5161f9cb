"""Long tables (time, name, value) as wide ones: a column for each name."""

import numpy as np

from sysid.data.column_words import words
from sysid.data.reading.row_times import ColumnReader
from sysid.data.reading.table import Rows, Table
from sysid.data.reading.time_column import find_time, is_time
from sysid.data.unit_words import word_set

NAMES = word_set(
    "name signal variable field channel tag key topic sensor parameter entity id metric item point"
)
"""Words of a column with the names of signals."""
VALUES = frozenset(("value", "val", "reading", "wert", "values", "state"))
"""Words of a column with their numbers."""
MOST_NAMES = 200
"""Names that a log may have."""


def wide(table: Table) -> Table:
    """The table with a column for each name where it is a long one, else as it is.

    A long table has a column of names, each of which returns, and one of values. Its rows become
    one an instant, with empty cells where a name says nothing.
    """
    names, values = _column(table, NAMES), _column(table, VALUES)
    if names is None or values is None:
        return table
    labels = table.texts(names)
    signals = list(dict.fromkeys(labels))
    if not 2 <= len(signals) <= min(MOST_NAMES, len(labels) // 2):
        return table
    numbers = table.columns((values,))[:, 0]
    others = [n for n in table.names if n not in (names, values)]
    read = ColumnReader(table)
    time = find_time(others, None) or find_time(others, read)
    t = read(time.name) if time is not None else None
    if time is None or t is None:
        return table
    _, first, row = np.unique(t, return_index=True, return_inverse=True)
    columns = np.full((len(first), len(signals)), np.nan)
    columns[row, [signals.index(label) for label in labels]] = numbers
    note = (
        f"{table.where} is a long table: {values} of {', '.join(signals)} in columns of their own."
    )
    unit = table.brackets[time.name]
    clock = time.name if is_time(time.name) else "time"  # last_changed
    dates = table.dates(time.name)
    stamps = t[first] if dates is None else t[first] + dates[1]
    return Table(
        table.where,
        (clock, *signals),
        (unit if dates is None else "s", *("" for _ in signals)),
        (*table.notes, note),
        Rows(len(first), t[first]),
        {clock: stamps} | dict(zip(signals, columns.T, strict=True)),
    )


def _column(table: Table, wanted: frozenset[str]) -> str | None:
    """The one column whose name has no other word, None where there is none or several."""
    fitting = [n for n in table.names if words(n) and set(words(n)) <= wanted]
    return fitting[0] if len(fitting) == 1 else None
