"""Rows of a log that is still being written, in SI units, read as a whole log would be."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.io import chosen, signal_conversions
from sysid.data.reading.columns import Choice
from sysid.data.reading.data_lines import DataLines
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.row_times import numbered_clock, row_times
from sysid.data.reading.table import Table, read_table
from sysid.data.reading.text_layout import Layout, split_line
from sysid.data.reading.timing import GAP, plan_grid
from sysid.data.record import Array, Channel
from sysid.errors import DataError, UsageError

HEAD = 20
"""Data lines from which channels, units and sample time are read; fewer if no more come."""

MIN_DATA_LINES = 3
"""Data lines needed: two intervals define a sample time."""

WHOLE_LOG_ONLY = ("join", "join_offset", "speed_of", "unwrap", "encoding", "missing")
"""Options that need the whole log."""

BAGS_ONLY = ("stamps", "latency")
"""Options of bags, whose streams are compared with each other."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows as they came.

    Attributes:
        t: instants since the first row [s], (N,).
        u, y: inputs (N, nu) and outputs (N, ny), in SI units.
        gap: whether something is missing before a row, (N,).
    """

    t: Array
    u: Array
    y: Array
    gap: NDArray[np.bool_]


@dataclass(frozen=True)
class Lost:
    """Lines that gave no row, counted: unreadable, with an empty cell, twice there."""

    unreadable: int = 0
    incomplete: int = 0
    doubled: int = 0


def check_followable(options: ReadOptions) -> None:
    """Refuse options that need the whole log."""
    plain = ReadOptions()
    given = [n for n in (*WHOLE_LOG_ONLY, *BAGS_ONLY) if getattr(options, n) != getattr(plain, n)]
    if options.held not in ("auto", "keep"):
        given.append("held")
    if options.resample not in ("auto", "hold", "split"):
        given.append("resample")
    if given:
        raise UsageError(
            f"`{given[0]}` needs the whole log; leave it out while following, or fit the log when "
            "it is finished"
        )


class RowReader:
    """Lines into rows. What is what is decided once, on the first lines.

    Attributes:
        lost: lines that gave no row so far.
    """

    def __init__(self, where: str, options: ReadOptions | None = None) -> None:
        """Args:
        where: what to call the log in messages.
        options: how to read it.
        """
        self._where, self._options = where, options or ReadOptions()
        check_followable(self._options)
        self._first: list[str] = []
        self._format: _Format | None = None
        self.lost = Lost()
        self._last: tuple[float, Array] | None = None
        self._broken = False
        self._ahead = 0.0

    @property
    def inputs(self) -> tuple[Channel, ...]:
        return self._known.inputs

    @property
    def outputs(self) -> tuple[Channel, ...]:
        return self._known.outputs

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return self._known.dt

    def restart(self) -> None:
        """The file begins anew: its header comes again, and its time may."""
        self._broken = True

    def read(self, lines: Sequence[str], last: bool = False) -> Rows | None:
        """The rows of more lines.

        Args:
            last: decide on the format now, even where few lines have come.

        Returns:
            None as long as the format is not known.
        """
        if self._format is None:
            self._first += [line for line in lines if line.strip()]
            wanted = MIN_DATA_LINES + 1 if last else HEAD + 1
            if len(self._first) < wanted:
                return None
            text = "\n".join(self._first) + "\n"
            self._format = _Format.of(text.encode(), self._where, self._options)
            lines, self._first = self._format.layout.rows, []
        return self._rows([line for line in lines if line.strip()])

    @property
    def _known(self) -> "_Format":
        if self._format is None:
            raise DataError(f"{self._where}: no header and rows so far")
        return self._format

    def _rows(self, lines: Sequence[str]) -> Rows:
        format = self._known
        good = [line for line in lines if format.is_row(line)]
        self._lose(unreadable=sum(not format.is_header(line) for line in lines) - len(good))
        try:
            t, values = format.numbers(good)
        except DataError:
            parts = [p for p in (self._alone(line) for line in good) if p is not None]
            self._lose(unreadable=len(good) - len(parts))
            if not parts:
                return self._kept(np.zeros(0), np.zeros((0, format.width)))
            t, values = (np.concatenate(p) for p in zip(*parts, strict=True))
        return self._kept(t, values)

    def _alone(self, line: str) -> tuple[Array, Array] | None:
        try:
            return self._known.numbers([line])
        except DataError:
            return None

    def _kept(self, t: Array, values: Array) -> Rows:
        """Complete rows, each once, and where something is missing."""
        format = self._known
        nu = len(format.inputs)
        times: list[float] = []
        kept: list[Array] = []
        gaps: list[bool] = []
        for at, row in zip(t.tolist(), values, strict=True):
            if self._options.resample == "hold" and self._last is not None:
                row[nu:] = np.where(np.isnan(row[nu:]), self._last[1][nu:], row[nu:])
            if not np.isfinite(row).all() or not np.isfinite(at):
                self._lose(incomplete=1)
                self._broken = True
                continue
            place = format.place(at, self._last) + self._ahead
            if self._last is not None and place <= self._last[0] + format.dt * (GAP - 1.0):
                if not self._broken and place > self._last[0] - format.dt * (GAP - 1.0):
                    self._lose(doubled=1)
                    continue
                self._ahead += self._last[0] + format.dt - place  # the clock began again
                place, self._broken = self._last[0] + format.dt, True
            late = self._last is not None and place - self._last[0] > GAP * format.dt
            gaps.append(self._last is not None and (self._broken or late))
            self._last, self._broken = (place, row), False
            times.append(place)
            kept.append(row)
        block = np.array(kept).reshape(-1, format.width) * format.scale
        return Rows(np.array(times), block[:, :nu], block[:, nu:], np.array(gaps, dtype=bool))

    def _lose(self, **more: int) -> None:
        self.lost = replace(self.lost, **{n: getattr(self.lost, n) + k for n, k in more.items()})


@dataclass(frozen=True, eq=False)
class _Format:
    """The format of a log, read from its first lines.

    Attributes:
        dt: sample time [s].
        stamps: columns of the clock; none where rows are only counted, or it holds dates.
        zero: stamps of the first row.
        unit: seconds in a stamp's unit.
        dated: whether its clock holds dates.
    """

    table: Table
    choice: Choice
    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    dt: float
    stamps: tuple[str, ...]
    zero: Array
    unit: float
    dated: bool

    @staticmethod
    def of(data: bytes, where: str, options: ReadOptions) -> "_Format":
        table = read_table(data, where, replace(options, strict=True))
        if not isinstance(table.source, Layout):
            raise UsageError(f"{where} is not text; only a CSV log can be followed")
        options, choice, _ = chosen(table, options)
        if not choice.inputs:
            raise DataError(f"{where} has no input; a followed plant needs one")
        values = table.columns((*choice.inputs, *choice.outputs, *choice.pose))
        conversions = signal_conversions(table, choice, options, np.nan_to_num(values))
        stamps = numbered_clock(table, choice.clock)
        dates = None if choice.clock is None else table.dates(choice.clock.name)
        clock = row_times(table, choice.clock, options.units, options.ts)
        raw = table.columns(stamps) if stamps else np.zeros((len(table), 0))
        whole = _combined(raw, raw[0]) if stamps else np.zeros(len(table))
        # by option a log may be timed by its rows alone
        dt = plan_grid(_once(clock.t), "fill", table.place, where).dt
        unit = 1.0
        if stamps and whole[-1] != whole[0]:
            unit = float((clock.t[-1] - clock.t[0]) / (whole[-1] - whole[0]))
        inputs, outputs = (
            tuple(c.channel(n, dt) for n, c in group.items()) for group in conversions
        )
        if dates is not None and dates.order:
            table = replace(table, date_order=dates.order)
        zero = raw[0] if stamps else np.zeros(0)
        return _Format(table, choice, inputs, outputs, dt, stamps, zero, unit, dates is not None)

    @property
    def layout(self) -> Layout:
        """The text of the first lines."""
        assert isinstance(self.table.source, Layout)
        return self.table.source

    @property
    def width(self) -> int:
        return len(self.inputs) + len(self.outputs)

    @property
    def scale(self) -> Array:
        """What brings each signal to its unit, (width,)."""
        return np.array([c.scale for c in (*self.inputs, *self.outputs)])

    def is_header(self, line: str) -> bool:
        return tuple(split_line(line, self.layout.delimiter)) == self.layout.names

    def is_row(self, line: str) -> bool:
        """Whether a line has as many cells as the header, and is not the header."""
        cells = split_line(line, self.layout.delimiter)
        return len(cells) == len(self.layout.names) and not self.is_header(line)

    def numbers(self, lines: Sequence[str]) -> tuple[Array, Array]:
        """Instants [s] and signals as in the file; NaN where a cell is empty."""
        signals = (*self.choice.inputs, *self.choice.outputs)
        if not lines:
            return np.zeros(0), np.zeros((0, len(signals)))
        rows = DataLines(list(lines))
        source = replace(self.layout, rows=rows, lines=range(1, len(lines) + 1))
        table = replace(self.table, source=source)
        block = table.columns((*signals, *self.stamps))
        values = block[:, : len(signals)]
        if self.stamps:
            return self.unit * _combined(block[:, len(signals) :], self.zero), values
        if self.dated and self.choice.clock is not None:
            # after the first row: one row by itself shows no order of day and month
            rows = DataLines([self.layout.rows[0], *lines])
            source = replace(source, rows=rows, lines=range(len(rows)))
            dates = replace(table, source=source).dates(self.choice.clock.name)
            assert dates is not None  # as the first row has one
            return dates.elapsed[1:], values
        return np.zeros(len(lines)), values

    def place(self, at: float, last: tuple[float, Array] | None) -> float:
        """The instant of a row; one sample after the previous row where no column states it."""
        if self.stamps or self.dated:
            return at
        return 0.0 if last is None else last[0] + self.dt


def _combined(stamps: Array, zero: Array) -> Array:
    """Stamps counted from the first; a second column holds nanoseconds."""
    elapsed = stamps[:, 0] - zero[0]
    if stamps.shape[1] == 2:
        elapsed = elapsed + 1e-9 * (stamps[:, 1] - zero[1])
    return np.asarray(elapsed)


def _once(t: Array) -> Array:
    """Instants without those that do not rise: a line that is there twice."""
    kept = np.concatenate([[True], np.diff(t) > 0.0])
    return t[kept] if np.count_nonzero(kept) > 1 else np.arange(len(t), dtype=np.float64)
