"""Rows of a file that a record can be made of, and columns that have rates of their own.

A row is left out where it has no time, stands out of order, is written twice or lacks a cell. A
column that is empty in more rows than a fault would leave has a rate of its own: it is brought onto
one grid with the others as the topics of a bag are (``bags.grid``).

What seems to change with time may go with a column that was chosen for nothing: the throttle of a
car whose steering is looked at, the length of a crane's rope. Records carry these along.
"""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.bags.grid import aligned
from sysid.data.bags.streams import Stream
from sysid.data.column_words import is_set_point
from sysid.data.finding import Finding, Severity
from sysid.data.joining.files import without_turns
from sysid.data.reading.bad_lines import Skipped, few
from sysid.data.reading.clock import doubled_rows
from sysid.data.reading.columns import Choice, whole_name
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.released import NONE, may_release, released_rows
from sysid.data.reading.row_times import numbered_clock
from sysid.data.reading.table import Rows, Table
from sysid.data.reading.time_column import TimeColumn, is_counter, is_time
from sysid.data.reading.timing import SHORT_GAP, Place, set_back
from sysid.data.record import Array, Record
from sysid.errors import DataError, argument

Mask = NDArray[np.bool_]

OWN_RATE = 0.1
"""Share of empty cells from which on a column has a rate of its own."""
OUT_OF_ORDER = 0.01
"""Share of rows up to which stamps that break the order are of damaged lines."""
MIN_MEASUREMENTS = 10
"""Filled cells that an output needs."""


@dataclass(frozen=True, eq=False)
class UsableRows:
    """The rows of a file that serve.

    Attributes:
        t: instants [s], (N,).
        values: inputs, outputs and pose in the file's units, (N, n), without empty cells.
        references: set points by column name, (N,) each.
        place: row → where it stands in the file.
        findings: what was left out, and what was brought together.
        released: rows that were left out as the drive was off.
    """

    t: Array
    values: Array
    references: Mapping[str, Array]
    place: Place
    findings: tuple[Finding, ...]
    released: int = 0

    @property
    def counted(self) -> int:
        """Rows that were not lost."""
        return len(self.t) + self.released


def with_times(
    table: Table, column: TimeColumn | None, strict: bool
) -> tuple[Table, tuple[Finding, ...]]:
    """The table without the few rows that have no time."""
    if strict or column is None:
        return table, ()
    dates, stamps = table.dates(column.name), numbered_clock(table, column)
    times = table.columns(stamps) if dates is None else dates[0][:, None]
    missing = np.asarray(np.isnan(times).any(axis=1))
    if not few(int(np.count_nonzero(missing)), len(table)):
        return table, ()
    return table.at(np.flatnonzero(~missing)), _skipped(table, missing)


def usable_rows(
    table: Table, t: Array, values: Array, choice: Choice, options: ReadOptions
) -> UsableRows:
    """The rows that serve, on one grid where columns have rates of their own.

    Args:
        t: instants of its rows [s], (N,).
        values: inputs, outputs and pose, (N, n), NaN in empty cells.
        choice: what they are.
        options: ``resample`` and ``strict`` count.
    """
    names = (*choice.inputs, *choice.outputs, *choice.pose)
    if options.resample == "hold":
        values = _forward_filled(values, range(len(choice.inputs), len(names)))
    empty = np.isnan(values)
    twice = doubled_rows(t, values)
    disorder = np.zeros(len(t), dtype=bool)
    if not options.strict:
        disorder[~twice] = _out_of_order(t[~twice])
    others = np.asarray(empty.all(axis=1) & ~empty.all())
    off, released = _released(table, choice, options.enable)
    keep = ~(twice | disorder | others | off)
    findings = (*_doubled(table, twice), *_skipped(table, disorder), *released)
    shares = empty[keep].mean(axis=0) if keep.any() else np.zeros(len(names))
    references = _references(table, choice)
    if shares.max() > OWN_RATE and options.resample != "refuse":
        _check_filled(table, values[keep], names, len(choice.inputs))
        held = frozenset((*choice.inputs, *references))
        columns = dict(zip(names, values[keep].T, strict=True))
        columns |= {n: r[keep] for n, r in references.items()}
        found = _at_own_rates(table, t[keep], columns, names, held, findings)
        return replace(found, released=int(off.sum()))
    outputs = slice(len(choice.inputs), len(choice.inputs) + len(choice.outputs))
    lone: Mask = _lone(empty, outputs) & keep
    lost: Mask = empty.any(axis=1) & keep & ~lone
    findings += (
        *_others(table, others),
        *_incomplete(table, lost, empty, names, options, "rows were left out and treated as gaps"),
        *_incomplete(table, lone, empty, names, options, "cells of outputs were interpolated"),
    )
    values = _bridged(t, values, keep, outputs)
    rows = np.flatnonzero(keep & ~lost)
    if len(rows) < 2:
        raise DataError(
            f"{table.where} has {len(rows)} row{'' if len(rows) == 1 else 's'} of numbers; "
            "a log needs many"
        )
    led = {n: r[rows] for n, r in references.items() if np.isfinite(r[rows]).all()}
    moving = {n: r for n, r in led.items() if np.ptp(r) > 0.0}
    return UsableRows(
        t[rows],
        values[rows],
        moving,
        lambda i: table.place(int(rows[i])),
        findings,
        int(off.sum()),
    )


def _at_own_rates(
    table: Table,
    t: Array,
    columns: Mapping[str, Array],
    names: Sequence[str],
    held: frozenset[str],
    findings: tuple[Finding, ...],
) -> UsableRows:
    """Columns that are filled in rows of their own, on one grid."""
    streams = []
    for name, column in columns.items():
        there = np.isfinite(column)
        if np.count_nonzero(there) < 2:
            continue  # a set point that is written once leads nothing
        values = column[there] if name in held else without_turns(column[there])[0]
        no_stamps = np.full(len(values), np.nan)
        streams.append(Stream(name, t[there], no_stamps, values[:, None], (name,)))
    held |= {s.topic for s in streams if _is_written_at_changes(s)}
    measured = [s for s in streams if s.topic not in held]
    step = None if measured else float(np.median(np.diff(t)))
    t, shared, grid, _ = aligned(streams, held, step, table.where, measured)
    rates = ", ".join(
        f"{s.topic} {_rate(s)}{' (held)' if s.topic in held else ''}" for s in streams
    )
    text = (
        f"{table.where}: columns have rates of their own: {rates}; one row every "
        f"{grid.dt:.6g} s, the step of {grid.topic or 'the rows'}."
    )
    faster = [n for n in names if n not in held and n != grid.topic]
    advice = f"Without it, {argument(outputs=faster)}, the rows are finer." if faster else ""
    note = Finding("own-rates", Severity.NOTE, text, advice, record=table.where)
    source = Table(table.where, (), (), (), Rows(len(t), t))
    references = {n: c for n, c in shared.items() if n not in names and float(np.ptp(c)) > 0.0}
    values = np.column_stack([shared[n] for n in names])
    return UsableRows(t, values, references, source.place, (*findings, note))


def _is_written_at_changes(stream: Stream) -> bool:
    """Whether a value is only written when it is another one, at no steady rate."""
    return not stream.regular and bool(np.all(np.diff(stream.values[:, 0]) != 0.0))


def _rate(stream: Stream) -> str:
    return f"{1.0 / stream.step:.3g} Hz" if stream.regular else "at events"


def _released(table: Table, choice: Choice, given: str | None) -> tuple[Mask, tuple[Finding, ...]]:
    """Rows in which the drive is off."""
    if given is not None and given != NONE:
        given = whole_name(given, table.names, "`enable`", table.where)
    names = may_release(choice.ignored, given, choice.inputs)
    columns = {n: c for n in names if (c := table.read(n)) is not None}
    return released_rows(columns, given, len(table), table.where)


def _references(table: Table, choice: Choice) -> dict[str, Array]:
    """The unused columns that are set points, in the file's units, (N,)."""
    columns = {n: table.read(n) for n in choice.ignored if is_set_point(n)}
    return {n: c for n, c in columns.items() if c is not None}


def _out_of_order(t: Array) -> Mask:
    """Rows outside the longest rising sequence of stamps, where they are very few.

    Half a line may still be a row of numbers, whose time has lost its first or last digits. Those
    where a clock was set back are whole.
    """
    none = np.zeros(len(t), dtype=bool)
    back = np.count_nonzero(np.diff(t) <= 0.0)
    if not 0 < back <= OUT_OF_ORDER * len(t):
        return none
    ends: list[float] = []  # the least last stamp of a rising sequence of each length (patience)
    last: list[int] = []
    before = np.full(len(t), -1)
    for k, stamp in enumerate(t.tolist()):
        at = bisect_left(ends, stamp)
        before[k] = last[at - 1] if at else -1
        ends[at : at + 1], last[at : at + 1] = [stamp], [k]
    rising = none.copy()
    k = last[-1]
    while k >= 0:
        rising[k] = True
        k = int(before[k])
    edges = np.flatnonzero(np.diff(rising, prepend=True, append=True))
    jumps = set_back(t)
    for start, stop in edges.reshape(-1, 2):
        if np.any((jumps >= start - 1) & (jumps < stop)):  # whole lines of a clock that was set
            rising[start:stop] = True
    return ~rising if np.count_nonzero(~rising) <= OUT_OF_ORDER * len(t) else none


def _skipped(table: Table, rows: Mask) -> tuple[Finding, ...]:
    at = np.flatnonzero(rows)
    return Skipped(tuple(table.line(int(k)) for k in at)).finding(table.where)


def _doubled(table: Table, repeated: Mask) -> tuple[Finding, ...]:
    n = int(np.count_nonzero(repeated))
    if not n:
        return ()
    first = table.place(int(np.flatnonzero(repeated)[0]))
    more = "" if n == 1 else f" (the first of {n} such lines)"
    text = f"{first}: repeats the previous line, including its time{more}; left out."
    return (Finding("doubled-lines", Severity.NOTE, text, record=table.where),)


def _others(table: Table, rows: Mask) -> tuple[Finding, ...]:
    """Rows that hold none of the columns used: those of other sensors."""
    n = int(np.count_nonzero(rows))
    if not n:
        return ()
    text = f"{table.where}: {n} row{'s hold' if n > 1 else ' holds'} none of the columns used."
    return (Finding("other-rows", Severity.NOTE, text, record=table.where),)


def _forward_filled(values: Array, columns: Sequence[int]) -> Array:
    """Empty cells of columns less than half empty filled with the last measurement before them."""
    out = values.copy()
    rows = np.arange(len(values))
    for k in (k for k in columns if np.isnan(values[:, k]).mean() < 0.5):
        last = np.maximum.accumulate(np.where(np.isnan(values[:, k]), 0, rows))
        out[:, k] = values[last, k]
    return out


def _lone(empty: Mask, outputs: slice) -> Mask:
    """Rows of a short run in which outputs alone are empty: what drove the plant is known."""
    some = np.asarray(empty.any(axis=1))
    edges = np.flatnonzero(np.diff(some, prepend=False, append=False))
    lone = np.zeros(len(some), dtype=np.bool_)
    for start, stop in edges.reshape(-1, 2):
        lone[start:stop] = start > 0 and stop < len(some) and stop - start <= SHORT_GAP
    others = np.asarray(np.delete(empty, np.r_[outputs], axis=1).any(axis=1))
    return np.asarray(lone & ~others)


def _bridged(t: Array, values: Array, keep: Mask, outputs: slice) -> Array:
    """The outputs with lines in place of their empty cells."""
    values = values.copy()
    for column in values.T[outputs]:
        there = keep & np.isfinite(column)
        column[~there] = np.interp(t[~there], t[there], column[there]) if there.any() else np.nan
    return values


def _check_filled(table: Table, values: Array, names: Sequence[str], nu: int) -> None:
    """Refuse an input without a value, and an output with hardly any."""
    for k, name in enumerate(names):
        empty = int(np.count_nonzero(np.isnan(values[:, k])))
        if len(values) - empty < (2 if k < nu else MIN_MEASUREMENTS):
            raise DataError(
                f"{table.where}, column {name} is empty in {empty} of {len(values)} rows; choose "
                "other columns or record the log again"
            )


def _incomplete(
    table: Table,
    lost: Mask,
    empty: Mask,
    names: Sequence[str],
    options: ReadOptions,
    done: str,
) -> tuple[Finding, ...]:
    """Rows with some of the cells, and what was done about them."""
    n = int(np.count_nonzero(lost))
    if not n:
        return ()
    row = int(np.flatnonzero(lost)[0])
    column = names[int(np.flatnonzero(empty[row])[0])]
    more = "" if n == 1 else f" (the first of {n} such rows)"
    seen = f"{table.place(row)}, column {column}: the cell is empty or not a number{more}"
    if options.resample == "refuse":
        raise DataError(f"{seen}; correct it, or allow `resample='auto'`")
    text = f"{seen}; such {done}."
    advice = "Find out what kept the logger from writing."
    return (Finding("missing", Severity.WARNING, text, advice, column, table.where),)


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
