"""A log larger than memory as tables of some of its rows: stretches of it, or all in order."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.data.files import open_regular
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.table import Table, frame_table, read_table
from sysid.data.reading.text_layout import Layout
from sysid.errors import SysidError

ROWS_IN_MEMORY = 4_000_000
"""Rows from which on a log is not read as a whole: with copies 4·10⁶ rows of ten take 1 GB."""
STRETCHES = 20
"""Stretches of a larger log that orders and structures are searched on …"""
STRETCH_ROWS = 25_000
"""… each of so many rows: half a million, which a search takes minutes for."""
BATCH_ROWS = 65_536
"""Rows of Parquet that are decoded at once."""
HEAD_BYTES = 1 << 20
"""Bytes of a text in which the header stands and the length of a line is seen."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """A large log.

    Attributes:
        rows: how many it has; of a text by the length of its first lines.
        head: the bytes above the first row of a text; empty of Parquet.
        line: bytes of a row of a text; 0 of Parquet.
    """

    path: Path
    rows: int
    options: ReadOptions
    head: bytes = b""
    line: float = 0.0

    def stretches(self, count: int = STRETCHES, rows: int = STRETCH_ROWS) -> Iterator[Table]:
        """Tables of ``rows`` rows each, spread evenly over the log."""
        room = max(self.rows - rows, 0)
        firsts = [k * room // max(count - 1, 1) for k in range(count)]
        if not self.line:
            yield from self._frames(rows, firsts)
            return
        for first in firsts:
            with open_regular(self.path) as file:
                file.seek(len(self.head) + int(first * self.line))
                if first:
                    file.readline()  # the rest of a row
                data = file.read(int(rows * self.line))
            yield self._table(data[: data.rfind(b"\n") + 1])

    def every(self, rows: int) -> Iterator[Table]:
        """All rows, in tables of about ``rows``."""
        if not self.line:
            yield from self._frames(rows, range(0, self.rows, rows))
            return
        rest = b""
        with open_regular(self.path) as file:
            file.seek(len(self.head))
            while data := file.read(int(rows * self.line)):
                data = rest + data
                end = data.rfind(b"\n") + 1
                rest = data[end:]
                if end:
                    yield self._table(data[:end])
            if rest.strip():
                yield self._table(rest + b"\n")

    def _table(self, data: bytes) -> Table:
        return read_table(self.head + data, self.path.name, self.options)

    def _frames(self, rows: int, firsts: Iterable[int]) -> Iterator[Table]:
        """Tables of ``rows`` rows from each of these on, in one pass."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        batches = pq.ParquetFile(self.path).iter_batches(min(rows, BATCH_ROWS))
        kept, start = [next(batches)], 0  # from row ``start`` on
        for first in firsts:
            while start + sum(map(len, kept)) < min(first + rows, self.rows):
                while kept and start + len(kept[0]) <= first:
                    start += len(kept.pop(0))
                kept.append(next(batches))
            table = pa.Table.from_batches(kept).slice(first - start, rows)
            yield frame_table(table.to_pandas(), self.path.name, self.options)


def large_log(path: Path, options: ReadOptions, most: int = ROWS_IN_MEMORY) -> Blocks | None:
    """A log of more than ``most`` rows; None for a smaller one and for other formats."""
    if options.join or options.map or not path.is_file() or path.stat().st_size < 4 * most:
        return None
    with open_regular(path) as file:
        head = file.read(HEAD_BYTES)
    if b"\0" in head[4:] and not head.startswith(b"PAR1"):
        return None  # two bytes a sign: its lines are not found by their ends
    if head.startswith(b"PAR1"):
        import pyarrow.parquet as pq

        try:
            rows = pq.ParquetFile(path).metadata.num_rows
        except Exception:  # pyarrow's errors share no base class; read as a whole it is refused
            return None
        return Blocks(path, rows, options) if rows > most else None
    try:
        whole = head[: head.rfind(b"\n") + 1]
        layout: Any = read_table(whole, path.name, options).source
    except SysidError:
        return None
    if not isinstance(layout, Layout) or len(layout.lines) < 2:
        return None
    lines = head.split(b"\n")
    above = sum(len(line) + 1 for line in lines[: layout.lines[0] - 1])
    size = path.stat().st_size
    line = _mean_line(path, above, size)
    rows = int((size - above) / line)
    return Blocks(path, rows, options, head[:above], line) if rows > most else None


def _mean_line(path: Path, above: int, size: int) -> float:
    """The mean length of a line in samples from all of a text [bytes]."""
    read = lines = 0
    with open_regular(path) as file:
        for k in range(STRETCHES):
            file.seek(above + k * (size - above) // STRETCHES)
            file.readline()
            data = file.read(HEAD_BYTES // STRETCHES)
            end = data.rfind(b"\n") + 1
            read, lines = read + end, lines + data.count(b"\n", 0, end)
    return read / max(lines, 1)
