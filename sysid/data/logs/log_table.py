"""Read the table of a log of any kind: text, Parquet or a bag of ROS."""

from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.column_words import words
from sysid.data.files import checksum, read_bytes
from sysid.data.finding import Finding
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.table import Rows, Table, read_table
from sysid.data.reading.time_column import find_time, is_time
from sysid.data.unit_words import word_set
from sysid.errors import UsageError

if TYPE_CHECKING:
    from hashlib import _Hash


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
    time = find_time(others, None) or find_time(others, table)
    t = table.read(time.name) if time is not None else None
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


def read_log_table(
    path: Path, options: ReadOptions, *, even: bool = True
) -> tuple[Table, tuple[Finding, ...], "_Hash"]:
    """The table of a log.

    Args:
        path: CSV, Parquet, or a bag, for which ``options.map`` says what is which column.
        even: whether streams of a bag are to share even rows; other files are as they are.

    Returns:
        the table, what was done to make it, and the checksum of its bytes, to be continued with
        those of a second file.
    """
    from sysid.data.bags.opening import is_bag

    if is_bag(path):
        from sysid.data.bags.log import bag_table

        table, said = bag_table(path, options, even=even)
        return table, said, checksum(path)
    data = read_bytes(path)
    _check_no_bag_options(path, options)
    table = read_table(data, path.name, options)
    return wide(table), table.findings, sha256(data)


def _check_no_bag_options(path: Path, options: ReadOptions) -> None:
    """Refuse what only a bag can take."""
    if options.map:
        raise UsageError(f"{path.name} is not a bag, and `map` is for bags only; name its columns")
    plain = ReadOptions()
    for name in ("stamps", "latency"):
        if getattr(options, name) != getattr(plain, name):
            raise UsageError(f"{path.name} is not a bag, and `{name}` is for bags only; omit it")
