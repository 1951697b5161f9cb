"""A bag as the table of a log: its mapped streams on one clock and a uniform grid.

Check by the motion that poses and twists follow the conventions of ROS (REP-103, Odometry).

Yaw counts counter-clockwise from x, so that a robot's way points along its heading, forward or
backward; the twist of an Odometry is expressed in the frame of the body, not of the world.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sysid.data.bags.clocks import runs, timed
from sysid.data.bags.contents import read_contents
from sysid.data.bags.grid import TIME, aligned, zero_order_hold_columns
from sysid.data.bags.latency import without_latency
from sysid.data.bags.mapping import sources
from sysid.data.bags.proposal import propose
from sysid.data.bags.streams import Stream, Streams, read_streams
from sysid.data.finding import Finding, Severity
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.table import Rows, Table
from sysid.data.record import Array
from sysid.errors import DataError, UsageError, argument

ALONG = 0.9
"""Share of the way that lies along the heading where a robot drives as it points …"""
ACROSS = 0.6
"""… and where the heading is another angle; a robot that slides sideways lies between."""
SIDEWAYS = 0.1
"""… or, where nearly none lies along it, a frame turned by 90° (a robot on Swedish wheels
drives where it likes and has half of it there)."""
TURNS = 0.5
"""Variation of the heading [rad] below which its sense cannot be judged."""
BETTER = 0.25
"""A frame is accepted where its squared errors are below this share of the other frame's."""
WINDOWS = 200
"""Stretches of the drive that are compared: long ones, as positions are noisy."""


def frame_findings(streams: Sequence[Stream], where: str) -> tuple[Finding, ...]:
    """Poses and twists that break the conventions of ROS.

    Args:
        streams: on one clock.
        where: the bag, for messages.
    """
    column = {n: (s.t, v) for s in streams
              for n, v in zip(s.names, s.values.T, strict=True)}  # fmt: skip
    if not {"x", "y", "psi"} <= column.keys():
        return ()
    t = column["x"][0]
    edges = np.linspace(max(c[0][0] for c in column.values()), t[-1], WINDOWS + 1)
    known = {n: _at(edges, *column[n], n == "psi") for n in ("x", "y", "psi")}
    dx, dy = np.diff(known["x"]), np.diff(known["y"])
    psi = 0.5 * (known["psi"][1:] + known["psi"][:-1])
    moved = np.hypot(dx, dy) > 0.1 * np.max(np.hypot(dx, dy))
    if not moved.any() or np.ptp(psi[moved]) < TURNS:
        return ()
    if problem := _sense(dx[moved], dy[moved], psi[moved]):
        text, advice = problem
        return (Finding("bag", Severity.WARNING, f"{where}: {text}", advice, record=where),)
    way = np.column_stack([dx, dy])
    return tuple(f for s in streams for f in _twist(s, edges, way, psi, where))


def _at(edges: Array, t: Array, values: Array, turning: bool) -> Array:
    kept = np.isfinite(values)
    values = np.unwrap(values[kept]) if turning else values[kept]
    return np.interp(edges, t[kept], values)


def _sense(dx: Array, dy: Array, psi: Array) -> tuple[str, str] | None:
    """What a heading counts instead of counter-clockwise from x, and what to do."""
    course = np.arctan2(dy, dx)

    def along(heading: Array) -> float:
        return float(np.mean(np.cos(course - heading) ** 2))

    if along(psi) > ACROSS:
        return None
    if along(-psi) > ALONG:
        text = "by the path driven, psi counts clockwise; ROS counts counter-clockwise."
        return text, "Map x, y and psi one by one, psi with a minus before its path."
    if along(0.5 * np.pi - psi) > ALONG:
        text = "by the path driven, psi counts clockwise from north, like a compass."
        return text, "Map psi with a minus before its path, and swap x and y with a sign."
    if along(psi) > SIDEWAYS:
        return None
    text = "the path driven is perpendicular to psi."
    return text, "Check that the pose is that of the robot and psi its yaw."


def _twist(stream: Stream, edges: Array, way: Array, psi: Array, where: str) -> tuple[Finding, ...]:
    """Whether the speed of an Odometry is that along the world's x, not along the body's."""
    at = [k for k, path in enumerate(stream.paths) if path.endswith("twist.linear.x")]
    if not at or not stream.kind.endswith("Odometry"):
        return ()
    speed = stream.values[:, at[0]]
    area = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(stream.t))])
    published = np.diff(np.interp(edges, stream.t, area))
    body = way[:, 0] * np.cos(psi) + way[:, 1] * np.sin(psi)
    squared_errors = [float(np.sum((published - w) ** 2)) for w in (way[:, 0], body)]
    if not squared_errors[0] < BETTER * squared_errors[1]:
        return ()
    frame, child = stream.frames
    text = (
        f"{where}: by the path driven, twist.twist.linear of {stream.topic} is expressed in "
        f"{frame or 'the world'}; nav_msgs/Odometry expects {child or 'the body'}."
    )
    advice = "Map the wheel speeds instead, or correct the publisher."
    return (Finding("bag", Severity.WARNING, text, advice, record=where),)


def bag_table(
    path: Path, options: ReadOptions, *, even: bool = True
) -> tuple[Table, tuple[Finding, ...]]:
    """The table of a bag, and what was done.

    Args:
        path: bag, folder or MCAP file.
        options: ``map``, ``stamps``, ``latency``, ``ts`` and the names of inputs and outputs count.
        even: onto even rows, as a fit needs them; else a row an instant of the fastest stream, with
            empty cells where a slower one said nothing.
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
        streams, of_clocks = timed(part, options.stamps)
        findings += of_clocks
        streams, of_latency = without_latency(
            streams, zero_order_hold, options.latency, recording.where
        )
        findings += (*of_latency, *frame_findings(streams, recording.where))
        if not even:
            tables.append(_sparse(streams))
            continue
        t, columns, grid, said = aligned(streams, zero_order_hold, ts, recording.where)
        ts = grid.dt
        findings += said
        tables.append((t, columns))
    return _table(recording, tables), tuple(dict.fromkeys(findings))


def _table(recording: Streams, tables: list[tuple[Array, dict[str, Array]]]) -> Table:
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


def _sparse(streams: tuple[Stream, ...]) -> tuple[Array, dict[str, Array]]:
    """Rows at the instants of the fastest stream; what others said at the row next to it."""
    t = max(streams, key=lambda s: len(s.t)).t
    columns: dict[str, Array] = {}
    for s in streams:
        row = np.clip(np.searchsorted(t, s.t), 1, len(t) - 1)
        row -= (s.t - t[row - 1]) < (t[row] - s.t)
        for name, values in zip(s.names, s.values.T, strict=True):
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
