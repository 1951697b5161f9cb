"""Instant of each row of a log, from its time column, a counter of rows, or ``ts`` alone."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.finding import Finding, Severity
from sysid.data.reading.clock import FIRST_WHOLE, Clock, instants, stated_unit, unrolled
from sysid.data.reading.table import Table
from sysid.data.reading.time_column import TimeColumn, is_steady
from sysid.data.record import Array
from sysid.errors import DataError, argument

SAME_STEP = 0.01
"""Relative difference within which the sample times of option and time column agree."""


MORE_DIGITS = "log it with more digits"

IN_TURN = 0.4
"""Share of the rows in which a column of machines changes; one of states keeps them for long."""

APART = 3.0
"""A signal jumps so many times more between machines than within each."""

MOST_SERIES = 50
"""Names in a column beyond which it separates no machines."""


def still_clock_advice(table: Table, column: TimeColumn | None) -> str:
    """What to do about a clock that stands: rows of several machines, another clock, or neither."""
    others = [n for n in table.names if column is not None and n != column.name]
    time = None if column is None else table.read(column.name)
    for name in others:
        keys, of = np.unique(table.texts(name), return_inverse=True)
        if time is not None and 1 < len(keys) <= MOST_SERIES and _rises_in_each(time, of):
            return _separates(name, keys.tolist())
    columns = {n: table.read(n) for n in others}
    clocks = [
        argument(time=n)
        for n, c in columns.items()
        if c is not None and is_steady(c) and np.all(np.diff(c) > 0)
    ]
    named = f"name the clock with {' or '.join(clocks[:3])}" if clocks else MORE_DIGITS
    return f"{named}, or count the rows, without their gaps, at `ts` seconds each"


def check_one_machine(table: Table, t: Array, values: Array) -> None:
    """That the rows are not those of several machines in turn, each with stamps of its own.

    A column of words that mostly changes from row to row, in each of whose series the clock goes on
    steadily, separates machines where a signal jumps more between its series than within them.

    Args:
        t: instants [s], (N,).
        values: inputs and outputs, (N, n).

    Raises:
        DataError: they are.
    """
    for name in filter(table.is_words, table.names):
        keys, of = np.unique(table.texts(name), return_inverse=True)
        changes = np.diff(of) != 0
        if not (1 < len(keys) <= MOST_SERIES and len(of) == len(t) and np.mean(changes) > IN_TURN):
            continue
        series = [np.flatnonzero(of == k) for k in range(len(keys))]
        if not all(is_steady(t[s]) for s in series):
            continue
        between = np.nanmedian(np.abs(np.diff(values, axis=0))[changes], axis=0)
        within = [np.nanmedian(np.abs(np.diff(values[s], axis=0)), axis=0) for s in series]
        if np.any(between > APART * np.max(within, axis=0)):
            raise DataError(f"{table.where}: {_separates(name, keys.tolist())}")


def _separates(name: str, keys: Sequence[str]) -> str:
    return (
        f"column {name} separates {len(keys)} series ({', '.join(keys[:3])}) with a time each: "
        "write the rows of each to a file of its own"
    )


def _rises_in_each(time: Array, of: NDArray[np.intp]) -> bool:
    order = np.argsort(of, kind="stable")
    same = np.diff(of[order]) == 0
    return len(of) == len(time) and bool(np.all(np.diff(time[order])[same] > 0))


def numbered_clock(table: Table, column: TimeColumn | None) -> tuple[str, ...]:
    """The columns of a clock that holds numbers; none where it holds dates or is not there."""
    if column is None or table.dates(column.name) is not None:
        return ()
    return column.columns


def row_times(
    table: Table,
    column: TimeColumn | None,
    units: Mapping[str, str],
    ts: float | None,
) -> Clock:
    """Instants [s] of every row.

    Args:
        column: its time column or counter, None where it has none.
        units: column name → unit by option.
        ts: sample time [s] by option, None to go by the column.
    """
    clock = _row_times(table, column, units, ts)
    if column is None or column.over is None:
        return clock
    text = (
        f"{table.where}: the time is {column.name}, the sender's stamp; {column.over}, the time of "
        "recording, was not used."
    )
    advice = f"To use the recorder's clock give {argument(time=column.over)}."
    note = Finding("time-unit", Severity.NOTE, text, advice, record=table.where)
    return replace(clock, findings=(*clock.findings, note))


def _row_times(
    table: Table,
    column: TimeColumn | None,
    units: Mapping[str, str],
    ts: float | None,
) -> Clock:
    where = table.where
    if column is None:
        every: Array = np.arange(len(table), dtype=np.float64) * (ts or table.interval or 1.0)
        return Clock(every, 0.0, _unknown_sample_time(ts, table))
    given = next((u for n, u in units.items() if n.lower() == column.name.lower()), None)
    dates = table.dates(column.name)
    if dates is not None:
        for row in np.flatnonzero(np.isnan(dates[0]))[:1]:
            raise DataError(
                f"{table.place(int(row))}, column {column.name}: the date is missing; correct or "
                "delete that line"
            )
        elapsed, notes = unrolled(dates[0], column.name, where, table.place)
        return _checked(Clock(elapsed, dates[1], notes), column, ts, where)
    block = table.columns(numbered_clock(table, column))
    raw = block[:, 0]
    if not np.any(np.isfinite(raw)):  # LabVIEW's ``X_Columns No``: a name over nothing
        return _row_times(table, None, units, ts)
    if column.fine:
        whole = raw - raw[0]
        origin = float(raw[0]) if raw[0] > FIRST_WHOLE else 0.0
        t = whole + block[:, 1] * 1e-9 + (0.0 if origin else raw[0])
        text = f"{where}: the time is {column.name} in s plus {column.fine} in ns."
        note = Finding("time-unit", Severity.NOTE, text, record=where)
        return _checked(Clock(t, origin, (note,)), column, ts, where)
    if column.counts and given is None:
        place = table.place
        counts = instants(raw, column, 1.0, where, place).t if column.by_name else raw
        step = median_step(counts)
        each = ts or table.interval or 1.0
        return Clock(
            (counts - counts[0]) / step * each, 0.0, _unknown_sample_time(ts, table, column)
        )
    bracket = table.brackets.get(column.name, "")
    unit = stated_unit(column, bracket, given)
    if unit is None and ts is not None:
        # the option says what a step is; the column only says which rows are missing
        clock = instants(raw, column, 1.0, where, table.place)
        return _scaled(clock, column, ts, where)
    return _checked(instants(raw, column, unit, where, table.place), column, ts, where)


def median_step(t: Array) -> float:
    """The usual step between rows; 1 where there is none."""
    step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    return step if step > 0 else 1.0


def _scaled(clock: Clock, column: TimeColumn, ts: float, where: str) -> Clock:
    """Stamps of unknown unit under a sample time by option."""
    step = median_step(clock.t)
    for unit in (1.0, 1e-3, 1e-6, 1e-9):
        if abs(step * unit / ts - 1.0) <= SAME_STEP:
            return Clock(clock.t * unit, clock.origin * unit, clock.findings)
    return _checked(clock, column, ts, where)


def _checked(clock: Clock, column: TimeColumn, ts: float | None, where: str) -> Clock:
    """The clock, or ``ts`` with a warning where the two contradict each other."""
    step = median_step(clock.t)
    if ts is None or abs(step / ts - 1.0) <= SAME_STEP:
        return clock
    text = (
        f"{where}: column {column.name} says {step:.4g} s between samples, `ts` says {ts:g} s; "
        "`ts` was used."
    )
    advice = "Omit `ts` if the time column is right."
    note = Finding("sample-time", Severity.WARNING, text, advice, record=where)
    return Clock(clock.t / step * ts, clock.origin, (*clock.findings, note))


def _unknown_sample_time(
    ts: float | None, table: Table, column: TimeColumn | None = None
) -> tuple[Finding, ...]:
    """Warning where no column states the time; none where the option does."""
    where = table.where
    if ts is not None:
        return ()
    if table.interval is not None:
        text = f"{where}: the title above the header states one row every {table.interval:.6g} s."
        advice = "If that is wrong, give the sample time in seconds with `ts`."
        return (Finding("sample-time", Severity.NOTE, text, advice, record=where),)
    counts, unit = "", ""
    if column is not None:
        counts = f" ({column.name} only counts rows)"
        unit = f", or the unit with {argument(units={column.name: 'ms'})}"
    return (
        Finding(
            "sample-time",
            Severity.WARNING,
            f"{where} has no sample time{counts}; it was set to 1 s, so every time below counts "
            "samples.",
            f"Give the sample time in seconds with `ts`{unit}.",
            record=where,
        ),
    )
