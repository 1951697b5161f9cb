"""A bag as the table of a log: its mapped streams on one clock and a uniform grid."""

from pathlib import Path

import numpy as np

from sysid.data.bags.clocks import Timed, runs, timed
from sysid.data.bags.contents import read_contents
from sysid.data.bags.frames import frame_findings
from sysid.data.bags.grid import TIME, aligned, zero_order_hold_columns
from sysid.data.bags.latency import without_latency
from sysid.data.bags.mapping import sources
from sysid.data.bags.proposal import propose
from sysid.data.bags.streams import Streams, read_streams
from sysid.data.finding import Finding
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.table import Rows, Table
from sysid.data.record import Array
from sysid.errors import DataError, UsageError, argument


def bag_table(
    path: Path, options: ReadOptions, *, even: bool = True
) -> tuple[Table, tuple[Finding, ...]]:
    """The table of a bag, and what was done.

    Args:
        path: bag, folder or MCAP file.
        options: ``map``, ``stamps``, ``latency``, ``ts`` and the names of inputs and outputs count.
        even: onto even rows, as a fit needs them; else a row an instant of the fastest stream, with
            empty cells where a slower one said nothing.

    Raises:
        UsageError: nothing is mapped, or a field is not there.
        DataError: the bag cannot serve.
    """
    if not options.map:
        raise UsageError(_unmapped(path))
    recording = read_streams(path, sources(options.map))
    parts = list(runs(recording))
    if not parts:
        raise DataError(f"{recording.where}: its mapped topics do not overlap in time")
    if len(parts) > 1 and options.resample != "split" and even:
        raise DataError(
            f"{recording.where}: the clock of the simulation starts again {len(parts) - 1} times; "
            "`resample='split'` makes an experiment of each run"
        )
    names = [n for s in recording.streams for n in s.names]
    zero_order_hold = zero_order_hold_columns(names, options)
    tables: list[tuple[Array, dict[str, Array]]] = []
    findings: list[Finding] = []
    ts = options.ts
    for part in parts:
        streams = timed(part, options.stamps)
        findings += [f for s in streams for f in s.findings]
        streams, of_latency = without_latency(
            streams, zero_order_hold, options.latency, recording.where
        )
        findings += (*of_latency, *frame_findings(streams, recording.where))
        if not even:
            tables.append(_sparse(streams))
            continue
        rows = aligned(streams, zero_order_hold, ts, recording.where)
        ts = rows.grid.dt if ts is None else ts
        findings += rows.findings
        tables.append((rows.t, dict(rows.columns)))
    return _table(recording, tables, even), tuple(dict.fromkeys(findings))


def _table(recording: Streams, tables: list[tuple[Array, dict[str, Array]]], even: bool) -> Table:
    t = np.concatenate([rows for rows, _ in tables])
    units = {n: u for s in recording.streams for n, u in zip(s.names, s.units, strict=True)}
    names = [n for s in recording.streams for n in s.names]
    columns = {n: np.concatenate([c[n] for _, c in tables]) for n in names}
    return Table(
        where=recording.where,
        names=(TIME, *names),
        units=("s", *(units[n] for n in names)),
        notes=(),
        source=Rows(len(t), t),
        extra={TIME: t + recording.origin, **columns},
    )


def _sparse(streams: tuple[Timed, ...]) -> tuple[Array, dict[str, Array]]:
    """Rows at the instants of the fastest stream; what others said at the row next to it."""
    t = max(streams, key=lambda s: len(s.t)).t
    columns: dict[str, Array] = {}
    for s in streams:
        row = np.clip(np.searchsorted(t, s.t), 1, len(t) - 1)
        row -= (s.t - t[row - 1]) < (t[row] - s.t)
        for name, values in zip(s.stream.names, s.stream.values.T, strict=True):
            columns[name] = np.full(len(t), np.nan)
            columns[name][row] = values
    return t, columns


def _unmapped(path: Path) -> str:
    """The error for a bag without a mapping, with a proposal."""
    proposal = propose(read_contents(path))
    lists = "`sysid inspect` lists its topics"
    if proposal is None:
        return f"{path.name} is a bag; map its fields to columns with `map`; {lists}"
    options = argument(map=proposal.map)
    if proposal.inputs:
        options += f" {argument(inputs=proposal.inputs)} {argument(outputs=proposal.outputs)}"
    return f"{path.name} is a bag without mapped fields; try {options}; {lists}"
