"""Streams of different rates on one uniform grid: commands held, measurements interpolated."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.bags.streams import Stream
from sysid.data.column_words import meaning
from sysid.data.finding import Finding, Severity
from sysid.data.joining.between_rows import spanned
from sysid.data.reading.columns import NO_INPUT, choose_columns
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.timing import GAP, ROUNDING, held, positions, round_period
from sysid.data.record import Array
from sysid.errors import DataError, UsageError

TIME = "t"
"""Name of the time column that the rows get."""

MIN_SHARED_ROWS = 10
"""Rows that streams must share."""

ENDS = 3.0
"""A period of two digits that over the recording moves its end by no more than so many spreads of a
step is the period: jitter of the first and of the last message is as large."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Even instants for all streams.

    Attributes:
        start: the first one [s].
        dt: the step [s].
        topic: the stream that sets it; empty where an option does.
    """

    start: float
    dt: float
    topic: str


def zero_order_hold_columns(names: Sequence[str], options: ReadOptions) -> frozenset[str]:
    """The columns that keep a value until the next one: inputs, commands and set points."""
    zero_order_hold = {n for n in names if meaning(n).quantity in ("command", "reference")}
    inputs = {n for n in options.inputs if n != NO_INPUT}
    lower = {n.lower(): n for n in names}
    with suppress(DataError, UsageError):
        outputs = options.outputs or options.speed_of
        chosen = choose_columns(names, options.inputs, outputs, timed=True)
        inputs |= set(chosen.inputs)
        zero_order_hold -= set(chosen.outputs)
    return frozenset(zero_order_hold | {lower[n.lower()] for n in inputs if n.lower() in lower})


def aligned(
    streams: Sequence[Stream],
    zero_order_hold: frozenset[str],
    ts: float | None,
    where: str,
    setting: Sequence[Stream] = (),
) -> tuple[Array, dict[str, Array], Grid, tuple[Finding, ...]]:
    """Bring streams onto one grid.

    Its step is that of the command where commands come at a steady rate, and that of the slowest
    measurement where that is slower, or where no command is steady: faster rows would hold numbers
        that nobody measured. Its instants are those of that stream. A command is held from its
        instant on, and averaged over a step that it changes in; what is measured is read between
        measurements by lines, an angle along its shorter way.

    Args:
        streams: on one clock.
        zero_order_hold: names of the columns that are commands.
        ts: the step [s] where an option gives it.
        where: the bag, for messages.
        setting: those of the streams that may set the step; all where none is named.

    Returns:
        the instants (N,) [s], without those that a measurement does not cover; the columns by name,
        (N,) each; what they stand on; and what was done.
    """
    grid = _grid(setting or streams, zero_order_hold, ts, where)
    low, high = _span(streams, zero_order_hold, grid, where)
    first = np.ceil((low - grid.start) / grid.dt - ROUNDING)
    count = int(np.floor((high - grid.start) / grid.dt + ROUNDING) - first) + 1
    if count < MIN_SHARED_ROWS:
        raise DataError(
            f"{where}: its mapped topics share {max(count, 0)} rows of {grid.dt:.4g} s, "
            + ", ".join(f"{s.topic} from {s.t[0]:.4g} to {s.t[-1]:.4g} s" for s in streams)
            + "; map topics that were recorded together, or choose their clock with `stamps`"
        )
    k = np.arange(first, first + count)
    rows = np.ones(count, dtype=bool)
    columns: dict[str, Array] = {}
    for stream in streams:
        at = positions(stream.t, grid.start, grid.dt)
        for name, values in zip(stream.names, stream.values.T, strict=True):
            if name in zero_order_hold:
                known = np.isfinite(values)
                columns[name] = held(at[known], values[known, None], k)[:, 0]
            else:
                columns[name] = _between(at, values, k, name in stream.angles)
                rows &= _covered(at, k, max(stream.step / grid.dt, 1.0))
    t = grid.start + grid.dt * k[rows]
    findings = _alignment_findings(streams, zero_order_hold, grid, where)
    return t, {n: c[rows] for n, c in columns.items()}, grid, findings


def _grid(
    streams: Sequence[Stream], zero_order_hold: frozenset[str], ts: float | None, where: str
) -> Grid:
    for stream in streams:
        if len(stream.t) < 2:
            raise DataError(
                f"{where}: {stream.topic} holds one message; map another topic, or record longer"
            )
    measured = [s for s in streams if set(s.names) - zero_order_hold]
    commands = [s for s in streams if s not in measured and s.regular]
    setting = min(commands, key=lambda s: s.step, default=None)
    slowest = max(measured, key=lambda s: s.step, default=None)
    if slowest is not None and (setting is None or slowest.step > (1.0 + ROUNDING) * setting.step):
        setting = slowest
    setting = setting or streams[0]
    dt = _period(setting.t) if ts is None else ts
    turns = (setting.t - setting.t[0]) / dt
    off = turns - np.rint(turns)
    phase = float(np.angle(np.mean(np.exp(2j * np.pi * off)))) / (2.0 * np.pi)
    phase = phase if np.max(np.abs(off - phase)) > 1e-6 else 0.0
    topic = setting.topic if ts is None else ""
    return Grid(float(setting.t[0] + phase * dt), dt, topic)


def _period(t: Array) -> float:
    """The mean step of a steady stream, missing messages counted."""
    d = np.diff(t)
    usual = float(np.median(d))
    count = max(float(np.sum(np.rint(d / usual))), 1.0)
    dt = float(f"{np.sum(d) / count:.9g}")
    round_one = float(f"{dt:.2g}")
    spread = float(np.std(d[d < GAP * usual]))
    return round_one if abs(round_one - dt) * count <= ENDS * spread else round_period(t, dt)


def _span(
    streams: Sequence[Stream], zero_order_hold: frozenset[str], grid: Grid, where: str
) -> tuple[float, float]:
    """The first and the last instant at which everything is known."""
    low, high = -np.inf, np.inf
    for stream in streams:
        low = max(low, float(stream.t[0]))
        only_commands = set(stream.names) <= zero_order_hold
        if not only_commands:
            high = min(high, float(stream.t[-1]))
        elif stream.regular:
            high = min(
                high, float(stream.t[-1]) + max(stream.step, grid.dt) * (1.0 - 2.0 * ROUNDING)
            )
    if not np.isfinite(high):
        high = max(float(s.t[-1]) for s in streams)
    return low, high


def _between(at: Array, values: Array, k: Array, turning: bool) -> Array:
    if turning:
        known = np.isfinite(values)
        values = values.copy()
        values[known] = np.unwrap(values[known])
    return np.interp(k, at, values)


def _covered(at: Array, k: Array, step: float) -> NDArray[np.bool_]:
    """Rows between two measurements that are not further apart than one and a half steps."""
    ends = (np.abs(k - at[-1]) <= ROUNDING) | (np.abs(k - at[0]) <= ROUNDING)
    return np.asarray(np.isin(k, at) | ends | spanned(k, at, GAP * step))


def _alignment_findings(
    streams: Sequence[Stream], zero_order_hold: frozenset[str], grid: Grid, where: str
) -> tuple[Finding, ...]:
    """A sentence a stream, and one on the grid."""
    sentences = []
    for s in streams:
        held = [n for n in s.names if n in zero_order_hold]
        interpolated = [n for n in s.names if n not in zero_order_hold]
        rate = f"{len(s.t) / np.ptp(s.t):.3g} Hz" if s.regular else "irregular"
        text = f"{s.topic}: {len(s.t)} messages, {rate}, by {s.by}"
        if np.isfinite(s.way):
            text += f" ({1e3 * s.way:.3g} ms before receipt)"
        if held:
            longest = float(np.max(np.diff(s.t)))
            text += f"; {', '.join(held)} held between messages"
            text += f" (up to {longest:.3g} s)" if longest > 2.5 * s.step else ""
        text += f"; {', '.join(interpolated)} interpolated between messages" if interpolated else ""
        sentences.append(text)
    source = f"the period of {grid.topic}" if grid.topic else "as requested"
    sentences.append(f"one row every {grid.dt:.6g} s, {source}")
    return tuple(
        Finding("bag", Severity.NOTE, f"{where}: {text}.", record=where) for text in sentences
    )
