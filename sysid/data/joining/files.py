"""Join two files of one experiment: the columns of the second on the rows and clock of the log.

A camera's pose at 120 Hz and wheel speeds at 50 Hz come in files of their own, each with a clock
of its own. Where the wheels of the one and the pose of the other are known, the clocks are brought
together by the motion that both saw; else the stamps are taken as they are. What is measured is
read between rows by lines; a command, and a file written only when something changes, is held.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sysid.data.decision import amount
from sysid.data.files import read_bytes
from sysid.data.finding import Finding, Severity
from sysid.data.joining.between_rows import (
    held_at,
    is_event_log,
    spanned,
    zero_order_hold_names,
)
from sysid.data.joining.clock_offset import (
    AGREES,
    Shift,
    clock_shift,
    travelled,
    way_and_turn,
)
from sysid.data.reading.columns import choose_columns
from sysid.data.reading.counters import counted
from sysid.data.reading.pose import angle_unit, find_pose
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.row_times import median_step, row_times
from sysid.data.reading.stale import between_measurements, refreshed
from sysid.data.reading.table import Table, read_table
from sysid.data.reading.time_column import TimeColumn, find_time
from sysid.data.record import Array
from sysid.errors import DataError, UsageError, argument

MIN_COVERED_ROWS = 20
"""Rows of the log that the second file must cover."""

LONGEST_STEP = 5.0
"""The second file holds nothing over intervals longer than so many of its usual steps …"""

LONGEST_GAP = 0.5
"""… if they are longer than this [s]: such rows of the log are left without its columns."""


@dataclass(frozen=True, eq=False)
class Series:
    """One file with its instants.

    Attributes:
        t: instants of the rows [s], (N,).
        origin: what was subtracted from them [s], 0 for none.
        clock: names of the columns that make the time.
    """

    table: Table
    t: Array
    origin: float
    clock: tuple[str, ...]
    findings: tuple[Finding, ...]


def joined(
    table: Table, other: Path, options: ReadOptions
) -> tuple[Table, tuple[Finding, ...], bytes]:
    """A log with the columns of a second file, in the rows that both cover.

    Args:
        options: how the log is read; ``join_offset`` is t_log − t_other [s], None to estimate it.

    Returns:
        the log with more columns, what was done, and the bytes of the second file.

    Raises:
        DataError: the second file cannot serve, or the two do not overlap or agree.
        UsageError: there is no such file.
    """
    data = read_bytes(other)
    log = _series(table, options.time, options.ts, options.units)
    second_table = read_table(data, other.name)
    second_series = _series(
        second_table, None, None, {**_unit_of_log(log, second_table), **options.units}
    )
    names = tuple(n for n in second_series.table.names if n not in second_series.clock)
    called = _new_names(names, table.names, other.stem)
    numbers = _numbers(second_series.table, names)
    raw = {called[n]: numbers[n] for n in names if n in numbers}
    known = {n: _filled(column) for n, column in raw.items()}
    if not known:
        raise DataError(f"{other.name} has no column of numbers besides its time")
    shift, findings = _shift(log, second_series, known, options)
    where = f"{other.name} joined to {table.where}"
    rows, columns, said = _brought(log, shift.to_log(second_series.t), known, raw, where)
    brackets = second_series.table.brackets
    more = {called[n]: brackets[n] for n in names if called[n] in columns}
    wider = table.at(np.flatnonzero(rows)).with_columns(columns, more)
    note = Finding("join", Severity.NOTE, f"{where}: {said}.", record=table.where)
    return wider, (*second_series.findings, *findings, note), data


def _brought(
    log: Series,
    at: Array,
    known: Mapping[str, Array],
    raw: Mapping[str, Array],
    where: str,
) -> tuple[NDArray[np.bool_], dict[str, Array], str]:
    """The columns at the rows of the log: what is measured by lines, what is commanded held.

    Args:
        at: instants of the second file's rows on the clock of the log [s], (M,).
        known: its columns without empty cells, (M,) each.
        raw: the same as written.
        where: the two files, for the sentence.

    Returns:
        the rows of the log that both cover, (N,); the columns by name, a value each of these; and
        what was done, in words.
    """
    order = np.flatnonzero(np.diff(at, prepend=-np.inf) > 0.0)
    by_events = is_event_log(log.t, at[order])
    still = tuple(n for n in known if n not in find_pose(tuple(known)).names)
    kept = zero_order_hold_names({n: known[n][order] for n in still}, by_events)
    steps = {n: held_at(log.t, at[order], raw[n][order]) for n in kept}
    rows = np.ones(len(log.t), dtype=bool) if by_events else _covered(log.t, at[order])
    for _, there in steps.values():
        rows &= there
    if by_events and len(kept) < len(known):
        rows &= _covered(log.t, at[order])
    if (count := int(np.count_nonzero(rows))) < MIN_COVERED_ROWS:
        raise DataError(
            f"{where}: both cover {amount(count, 'row')} of the log, which runs from "
            f"{log.t[0]:.6g} to {log.t[-1]:.6g} s and the other, on its clock, from {at[0]:.6g} "
            f"to {at[-1]:.6g} s; give the shift of the clocks with `join_offset=SECONDS`"
        )
    columns = {n: values[rows] for n, (values, _) in steps.items()}
    for name in (n for n in known if n not in kept):
        series, period, low = without_turns(known[name])
        on_log = np.interp(log.t[rows], at[order], series[order])
        columns[name] = low + np.mod(on_log - low, period) if period else on_log
    lost = len(rows) - count
    were = "was" if len(known) == 1 else "were"
    share = f"; {amount(lost, 'row')} of the log without its data left out" if lost else ""
    said = f"{', '.join(known)} {were} interpolated at the rows of the log{share}"
    if kept:
        why = f" (its {len(order)} rows are written at changes)" if by_events else ""
        are = "is" if len(kept) == 1 else "are"
        said += f"; {', '.join(kept)} {are} held between them{why}"
    return rows, {n: columns[n] for n in known}, said


def _series(table: Table, time: str | None, ts: float | None, units: Mapping[str, str]) -> Series:
    column = find_time(table.names, table) if time is None else TimeColumn(time)
    if column is None and ts is None:
        raise DataError(
            f"{table.where} has no time column; files are joined by time, so name one with `time`"
        )
    clock = row_times(table, column, units, ts)
    taken = () if column is None else column.columns
    return Series(table, clock.t, clock.origin, taken, clock.findings)


def _unit_of_log(log: Series, other: Table) -> dict[str, str]:
    """The unit of the log's clock for a second file's column of the same name, by name.

    A file of events has rows too far apart for its steps to show the unit.
    """
    name = log.clock[0] if len(log.clock) == 1 else ""
    if name not in other.names or other.brackets[name]:
        return {}
    if log.table.dates(name) is not None or other.dates(name) is not None:
        return {}
    ratio = median_step(log.t) / median_step(log.table.columns((name,))[:, 0])
    units = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    matching = [u for u, seconds in units.items() if abs(ratio / seconds - 1.0) < 1e-3]
    return {name: matching[0]} if matching else {}


def _new_names(names: Sequence[str], taken: Sequence[str], stem: str) -> dict[str, str]:
    """Names in the joined log; the file's own name goes before one that is there already."""
    lower = {n.lower() for n in taken}
    return {n: n if n.lower() not in lower else f"{stem}_{n}" for n in names}


def _numbers(table: Table, names: Sequence[str]) -> dict[str, Array]:
    """The columns that hold numbers, with NaN in empty cells."""
    columns = {name: table.read(name) for name in names}
    return {n: c for n, c in columns.items() if c is not None and np.isfinite(c).any()}


def _filled(column: Array) -> Array:
    """A column whose empty cells are filled from their neighbours."""
    there = np.isfinite(column)
    rows = np.arange(len(column))
    return np.interp(rows, rows[there], column[there])


def without_turns(values: Array) -> tuple[Array, float, float]:
    """A column without the jumps of an angle, its period (0 for none) and where that begins."""
    unwrapped = counted(values, (2.0 * np.pi, 360.0))
    if not unwrapped.period:
        return values, 0.0, 0.0
    whole = unwrapped.period != 2.0 * np.pi and np.all(values == np.rint(values))
    low = -unwrapped.period / 2.0 if np.min(values) < 0.0 else 0.0
    # a register cannot be read between two counts: it stays what it is, continued
    return unwrapped.values, 0.0 if whole and unwrapped.period != 360.0 else unwrapped.period, low


def _covered(t: Array, at: Array) -> NDArray[np.bool_]:
    """Rows of the log between two instants of the second file that are not far apart."""
    return spanned(t, at, max(LONGEST_STEP * float(np.median(np.diff(at))), LONGEST_GAP))


def _shift(
    log: Series,
    second: Series,
    known: Mapping[str, Array],
    options: ReadOptions,
) -> tuple[Shift, tuple[Finding, ...]]:
    log_name, other = log.table.where, second.table.where
    if options.join_offset is not None:
        return Shift(options.join_offset), ()
    moved = _wheels_and_pose(log, known, options)
    start = second.origin - log.origin if second.origin and log.origin else 0.0
    if moved is None:
        pose = bool(find_pose(tuple(known)).names)
        why = ", as no wheel speeds are known to estimate their shift" if pose else ""
        text = f"{other} was read on the clock of {log_name}{why}."
        dated = bool(second.origin and log.origin)
        if dated and not pose:
            text = f"{other} was joined to {log_name} by the dates of both files."
        advice = "If their clocks differ, give the shift with `join_offset=SECONDS`."
        severity = Severity.NOTE if dated else Severity.WARNING
        return Shift(start), (Finding("join", severity, text, advice, record=log_name),)
    found = clock_shift(log.t, moved[0], second.t, moved[1])
    sentence = f"the pose of {other} follows the wheels of {log_name}"
    if found.agreement < AGREES:
        raise DataError(
            f"{sentence} at no shift of the clocks (best agreement {100 * found.agreement:.0f} %); "
            "check that both are of one drive, or give the shift with `join_offset=SECONDS`"
        )
    if found.rival is not None:
        raise DataError(
            f"{sentence} nearly as well {found.seconds:.3f} s and {found.rival:.3f} s later, as a "
            f"repeated motion does; choose one with "
            f"{argument(join_offset=round(float(found.seconds), 3))}"
        )
    late = "behind" if found.seconds >= 0.0 else "ahead of"
    error = f" ± {max(found.std_error, 1e-4):.1g}" if found.std_error else ""
    drift = f" and drifts by {1e6 * found.drift:.0f} µs a second" if found.drift else ""
    text = (
        f"{other}: its clock is {abs(found.seconds):.4f}{error} s {late} that of "
        f"{log_name}{drift}, "
        f"estimated from the motion in both files (agreement {100 * found.agreement:.0f} %)."
    )
    return found, (Finding("join", Severity.NOTE, text, record=log_name),)


def _wheels_and_pose(
    log: Series, known: Mapping[str, Array], options: ReadOptions
) -> tuple[Array, Array] | None:
    """What the log's wheels have rolled, and way and turn of the second file's pose."""
    pose = find_pose(tuple(known)).names
    if not pose:
        return None
    other_columns = [n for n in log.table.names if n not in log.clock]
    wanted = options.outputs or options.speed_of
    outputs: dict[str, None] = {}
    # one wheel sees half of the motion: the others count although they are not asked for
    for inputs, named in ((options.inputs, wanted), ((), ())):
        with suppress(DataError, UsageError):
            chosen = choose_columns((*other_columns, *pose), inputs, named, timed=True).outputs
            outputs |= dict.fromkeys(n for n in chosen if n in other_columns)
    rolled = []
    for name in outputs:
        column = log.table.read(name)
        if column is None or not np.isfinite(column).all():
            return None
        if name in options.speed_of:
            rolled.append(counted(column, (2.0 * np.pi, 360.0)).values[:, None])
            continue
        slow = refreshed([column], [np.arange(len(column), dtype=np.float64)[:, None]])
        if slow is not None:
            column = between_measurements(log.t, column, slow.fresh[0])
        rolled.append(travelled(log.t, column[:, None]))
    if not rolled:
        return None
    x, y, psi = (known[n] for n in pose)
    unit, _ = angle_unit(x, y, psi)
    heading = np.unwrap(np.radians(psi) if unit == "deg" else psi)
    return np.column_stack(rolled), way_and_turn(x, y, heading)


def companion(joins: Sequence[str], log: Path) -> Path | None:
    """The file to join to a log: ``LOG=FILE`` names it for one, a plain path for all."""
    called = (log.name, log.stem, str(log))
    pairs = [j.split("=", 1) for j in joins if "=" in j]
    for_this_log = [file for name, file in pairs if name in called]
    plain = [j for j in joins if "=" not in j]
    chosen = for_this_log or plain
    if len(chosen) > 1:
        raise UsageError(
            f"`join` names {', '.join(chosen)} for {log.name}; join one file to a log, LOG=FILE "
            "where there are several logs"
        )
    return Path(chosen[0]) if chosen else None
