"""Read logs (CSV, Parquet, bags) into records: columns, units and time."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.bags.opening import is_bag
from sysid.data.checks.integral import counts_that_integrate
from sysid.data.column_words import is_set_point
from sysid.data.files import checksum
from sysid.data.finding import Finding, Severity
from sysid.data.joining.files import companion, joined
from sysid.data.logs.log_table import read_log_table
from sysid.data.reading.blocks import STRETCH_ROWS, STRETCHES, Blocks, large_log
from sysid.data.reading.columns import Choice, choose_columns, matching
from sysid.data.reading.counters import as_speeds, without_jumps
from sysid.data.reading.dates import ORDERS
from sysid.data.reading.decisions import decisions, led_elsewhere
from sysid.data.reading.missing_codes import without_codes
from sysid.data.reading.pose import pose_in_si, usable_pose
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.row_times import (
    check_one_machine,
    numbered_clock,
    row_times,
    still_clock_advice,
)
from sysid.data.reading.stale import at_sensor_rate, slow_sensors
from sysid.data.reading.table import Table
from sysid.data.reading.timing import (
    Grid,
    ResamplePolicy,
    Segment,
    held_on_grid,
    measured_on_grid,
    plan_grid,
)
from sysid.data.record import Array, Channel, Record
from sysid.data.same_kind import common_step, require_same_kind
from sysid.data.units import Conversion, conversions, without_false_pulses
from sysid.data.usable_rows import UsableRows, usable_rows, with_times, with_unused
from sysid.errors import DataError, UsageError


@dataclass(frozen=True)
class LogFile:
    """One file as read: its experiments and what there is to say about the reading.

    Attributes:
        records: one experiment, or several where the file was split at gaps.
        findings: verdicts on time stamps, missing cells, units and ignored columns.
        origin: what was subtracted from its stamps [s] where they count from 1970; else 0.
    """

    path: Path
    records: tuple[Record, ...]
    findings: tuple[Finding, ...]
    options: ReadOptions
    origin: float = 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        return tuple(f.text for f in self.findings)


def read_log(path: str | Path, options: ReadOptions | None = None, **fields: Any) -> Record:
    """One log file as one record.

    Args:
        fields: of the options, instead of them: ``read_log(path, inputs="u", outputs="y")``.

    Raises:
        DataError: the file cannot serve; where and why is in the sentence.
        UsageError: there is no such file, or an option does not fit it.
    """
    if options is not None and fields:
        raise UsageError("give the options as one value or by their names, not both")
    log = read_file(path, ReadOptions(**fields) if fields else options)
    if len(log.records) > 1:
        raise DataError(
            f"{log.path.name} holds {len(log.records)} experiments after splitting; "
            "read it as several records"
        )
    return log.records[0]


def read_logs(
    paths: Sequence[str | Path], options: ReadOptions | None = None
) -> tuple[Record, ...]:
    """Several files as several experiments of one system.

    Raises:
        DataError: a file cannot serve, or channels, units or sample times differ between files.
        UsageError: no file is named, one does not exist, or an option does not fit.
    """
    return tuple(r for log in read_files(paths, options) for r in log.records)


def read_files(
    paths: Sequence[str | Path], options: ReadOptions | None = None
) -> tuple[LogFile, ...]:
    """As ``read_logs``, with the findings of each file.

    They share the sample time of the coarsest, see ``common_step``.
    """
    if not paths:
        raise UsageError("no log given; name at least one CSV or Parquet file")
    logs = [read_file(p, options) for p in paths]
    first = logs[0].records[0]
    for log in logs[1:]:
        require_same_kind([replace(log.records[0], dt=first.dt)], first)
    every = [r for log in logs for r in log.records]
    records, resampled = common_step(every)
    at = iter(records)
    return tuple(
        replace(
            log,
            records=tuple(next(at) for _ in log.records),
            findings=(
                *log.findings,
                *(f for f in resampled if f.record in {r.name for r in log.records}),
            ),
        )
        for log in logs
    )


def read_file(path: str | Path, options: ReadOptions | None = None) -> LogFile:
    """One log file with everything there is to say about the reading."""
    options = options or ReadOptions()
    path = Path(path)
    large = large_log(path, options)
    if large is not None:
        return thinned(large)
    table, together, digest = _table(path, options)
    return _read(path, table, options, together, digest)


def thinned(large: Blocks, count: int = STRETCHES, rows: int = STRETCH_ROWS) -> LogFile:
    """Stretches of a log larger than memory, as one experiment each."""
    digest = checksum(large.path).hexdigest()
    logs = [_read(large.path, t, large.options, (), digest) for t in large.stretches(count, rows)]
    first = logs[0].origin
    name = large.path.name
    records = [
        replace(r, t0=r.t0 + log.origin - first, dt=logs[0].records[0].dt)
        for log in logs
        for r in log.records
    ]
    named = tuple(replace(r, name=f"{name} part {k}") for k, r in enumerate(records, 1))
    text = (
        f"{name} has {f'about {large.rows:.2g}' if large.line else large.rows} rows, more than are "
        f"read at once: {len(named)} stretches, {sum(map(len, named))} rows in all, are used."
    )
    note = Finding("large-log", Severity.WARNING, text, record=name)
    return LogFile(large.path, named, (note, *logs[0].findings), large.options, first)


def blocks_of(large: Blocks, rows: int) -> Iterator[LogFile]:
    """All rows of a log beyond memory in blocks of about ``rows``, read as the first one is."""
    options, first = large.options, None
    for table in large.every(rows):
        log = _read(large.path, table, options, (), "-")
        record = log.records[0]
        if first is None:
            first = record
            if record.inputs and not options.speed_of:
                options = replace(options, inputs=record.input_names, outputs=record.output_names)
            options = replace(options, held="keep" if options.held == "auto" else options.held)
        require_same_kind(log.records, first)
        yield log


def _read(
    path: Path,
    table: Table,
    options: ReadOptions,
    together: tuple[Finding, ...],
    digest: str,
) -> LogFile:
    given = options
    options, choice, pose_units = chosen(table, options)
    signals = (*choice.inputs, *choice.outputs, *choice.pose)
    table, without_time = with_times(table, choice.clock, options.strict)
    stamps = numbered_clock(table, choice.clock)
    # in one go: a long text is slow to read
    values = table.columns((*signals, *stamps))[:, : len(signals)]
    clock = row_times(table, choice.clock, options.units, options.ts)
    check_one_machine(table, clock.t, values)
    values, coded = without_codes(values, signals, len(choice.inputs), options.missing, table.where)
    rows = usable_rows(table, clock.t, values, choice, options)
    policy: ResamplePolicy = "auto" if options.resample == "hold" else options.resample
    grid = plan_grid(
        rows.t, policy, rows.place, table.where, lambda: still_clock_advice(table, choice.clock)
    )
    inputs, outputs = signal_conversions(table, choice, options, rows.values)
    values, of_pose = pose_in_si(rows.values, choice, pose_units, table.where)
    turning = choice.pose[2:]
    read, jumps = without_jumps(
        values, signals, outputs, turning, options.periods, table.where, options.speed_of
    )
    sizes = (len(choice.inputs), len(choice.outputs))
    slow = slow_sensors(rows.t, read, signals, sizes, options.held, table.where)
    read, outputs, derived = as_speeds(
        rows.t, slow.values, signals, outputs, options.speed_of, table.where
    )
    channels = (
        tuple(c.channel(n, grid.dt) for n, c in inputs.items()),
        tuple(c.channel(n, grid.dt) for n, c in outputs.items()),
    )
    findings = (
        *_reading_notes(table, choice, tuple(rows.references), channels),
        *together,
        *of_pose,
        *without_time,
        *clock.findings,
        *coded,
        *rows.findings,
        *jumps,
        *slow.findings,
        *derived,
        *grid.findings,
    )
    records = []
    for segment, name in zip(grid.segments, _names(path.name, grid), strict=True):
        record = _record(read, rows.t, grid.dt, channels, rows.references, segment)
        record = replace(record, name=name, sha256=digest, still_references=_still(choice, rows))
        part = slice(segment.start, segment.stop)
        records.append(at_sensor_rate(record, slow, rows.t, part))
    said = decisions(table, choice, clock.t, rows.counted, records, findings, pose_units)
    records = with_unused(table, choice, clock.t, [replace(r, read_as=said) for r in records])
    findings = counts_that_integrate(findings, records)
    return LogFile(path, tuple(records), findings, given, clock.origin)


def _still(choice: Choice, rows: UsableRows) -> tuple[str, ...]:
    """The set points of a file that never move."""
    return tuple(n for n in choice.ignored if is_set_point(n) and n not in rows.references)


def chosen(
    table: Table, options: ReadOptions
) -> tuple[ReadOptions, Choice, tuple[Conversion, ...]]:
    """The options with whole column names, the roles of the columns, and the units of the pose.

    Raises:
        DataError, UsageError: no columns can serve, or an option names none; see
            ``choose_columns`` and ``usable_pose``.
    """

    def whole(name: str) -> str:
        near = matching(name, table.names)
        return near[0] if len(near) == 1 else name

    options = replace(
        options,
        units={whole(n): u for n, u in options.units.items()},
        unwrap={whole(n): p for n, p in options.unwrap.items()},
        speed_of=tuple(map(whole, options.speed_of)),
    )
    choice = choose_columns(
        table,
        options.inputs,
        options.outputs or options.speed_of,
        options.time,
        options.ts is not None,
    )
    return options, *usable_pose(choice, table.brackets, options.units)


def _table(path: Path, options: ReadOptions) -> tuple[Table, tuple[Finding, ...], str]:
    """The table of a file, with the columns of a second one where there is one.

    Returns:
        the table, what is said about the joining, and the checksum of all bytes read.
    """
    table, findings, digest = read_log_table(path, options)
    other = companion(options.join, path)
    if other is not None:
        if is_bag(other):
            raise UsageError(
                f"{other.name} is a bag, which cannot be joined to a log: read it as the log, and "
                "join the other file to it with `join`"
            )
        table, of_joining, more = joined(table, other, options)
        findings = (*findings, *of_joining)
        digest.update(more)
    return table, findings, digest.hexdigest()


def signal_conversions(
    table: Table, choice: Choice, options: ReadOptions, values: Array
) -> tuple[dict[str, Conversion], dict[str, Conversion]]:
    """How inputs and outputs come to SI units; ``values`` are the signals' rows."""
    bracketed = table.brackets
    inputs, outputs = conversions(
        choice.inputs,
        choice.outputs,
        bracketed,
        _of_signals(options.units, choice),
        options.pwm_max,
        table.where,
    )
    signals = (*choice.inputs, *choice.outputs, *choice.pose)
    largest = dict(zip(signals, np.max(np.abs(values), axis=0), strict=True))
    by_option = {n.lower() for n in options.units}
    named = {n for n in choice.inputs if bracketed[n] or n.lower() in by_option}
    return without_false_pulses(inputs, named, largest), outputs


def _of_signals(units: Mapping[str, str], choice: Choice) -> dict[str, str]:
    """The units by option without those of times and of the pose, which are read on their own."""
    others = {n.lower() for n in (*choice.pose, choice.time or "")}
    signals = {n.lower() for n in (*choice.inputs, *choice.outputs)}
    return {n: u for n, u in units.items() if n.lower() not in others - signals and u not in ORDERS}


def _reading_notes(
    table: Table,
    choice: Choice,
    references: Sequence[str],
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]],
) -> tuple[Finding, ...]:
    notes = list(table.notes)
    signals = (*choice.inputs, *choice.outputs)
    notes += [
        f"{table.where}: {name} was read as a switch ({how})."
        for name, how in table.switches(signals).items()
    ]
    if choice.last:
        side = "input" if choice.last == choice.inputs else "output"
        was = f"was taken as the {side}" if len(choice.last) == 1 else f"were taken as the {side}s"
        notes.append(f"{table.where}: {', '.join(choice.last)} {was}: no other column is left.")
    elsewhere = led_elsewhere(*channels)
    loops = [n for n in choice.inputs if is_set_point(n) and n not in elsewhere]
    notes += [
        f"{table.where}: {', '.join(names)} is a set point: the model is of {what}, not of the "
        "plant alone."
        for names, what in (
            (loops, "the closed loop that follows it"),
            (elsewhere, "the plant with the drive that follows it"),
        )
        if names
    ]
    clock = () if choice.clock is None else table.date_and_clock(choice.clock.name)
    set_points = [n for n in choice.ignored if is_set_point(n)]
    unused = [n for n in choice.ignored if n not in (*set_points, *clock)]
    if unused:
        notes.append(f"{table.where}: not used: {', '.join(unused)}.")
    led = [
        Finding(
            "set-point",
            Severity.NOTE,
            f"{table.where}: {name} "
            + (
                "serves to detect a controller, and to keep its bias out of fits (oe, tf, process)."
                if name in references
                else "is a set point that never moves: a controller may have written the input."
            ),
            channel=name,
            record=table.where,
        )
        for name in set_points
    ]
    return (*(Finding("reading", Severity.NOTE, n, record=table.where) for n in notes), *led)


def _record(
    values: Array,
    t: Array,
    dt: float,
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]],
    references: Mapping[str, Array],
    segment: Segment,
) -> Record:
    """One experiment of a file, in SI units and at even instants.

    Args:
        values: inputs and outputs in the file's units, then the pose in SI if any, (N, k).
        t: instants [s], (N,).
        dt: sample time [s].
        channels: of inputs and outputs.
        references: set points by column name, (N,) each.
    """
    part = slice(segment.start, segment.stop)
    inputs, outputs = channels
    nu, ny = len(inputs), len(outputs)
    u = np.column_stack([values[part, :nu], *(x[part] for x in references.values())])
    rest = values[part, nu:].copy()
    u[:, :nu] *= [c.scale for c in inputs]
    rest[:, :ny] *= [c.scale for c in outputs]
    if not segment.even:
        u, rest = held_on_grid(t[part], dt, u), measured_on_grid(t[part], dt, rest)
    return Record(
        u=u[:, :nu],
        y=rest[:, :ny],
        dt=dt,
        inputs=inputs,
        outputs=outputs,
        pose=rest[:, ny:] if rest.shape[1] > ny else None,
        t0=float(t[segment.start]),
        references=u[:, nu:] if references else None,
        reference_names=tuple(references),
    )


def _names(file: str, grid: Grid) -> list[str]:
    n = len(grid.segments)
    return [file] if n == 1 else [f"{file} part {i + 1}" for i in range(n)]
