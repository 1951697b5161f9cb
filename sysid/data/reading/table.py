"""A log file as named columns of numbers: plain CSV by NumPy, other text and Parquet by pandas."""

import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.finding import Finding
from sysid.data.reading.containers import container
from sysid.data.reading.data_lines import DataLines
from sysid.data.reading.dates import ORDERS, Dates, date_format, only_day, only_time, seconds_of
from sysid.data.reading.header import MISSING, STATES, distinct, names_and_units
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.text_layout import Layout, lay_out, split_line
from sysid.data.record import Array
from sysid.errors import DataError
from sysid.outside_text import name_of

if TYPE_CHECKING:
    import pandas as pd

STRICT = ReadOptions(strict=True)
"""Lines that are no rows are refused."""
FIRST_CELL = 1000
"""Rows in which the first date of a column of dates stands."""
LARGEST = 1e100
"""No measured number is larger, and the squares of larger ones overflow."""


@dataclass(frozen=True)
class Rows:
    """Rows without a text: every column is in ``Table.extra``.

    Attributes:
        at: where row k is to be found, for a message: ``at 12.3 s``; (count,) instants [s].
    """

    count: int
    at: Array = field(hash=False)


@dataclass(frozen=True)
class Table:
    """The columns of one file, not yet read into numbers.

    Attributes:
        where: what to call the file in messages.
        names: column names, without a unit in brackets.
        units: unit in brackets behind the name in the file, by column; empty when there is none.
        notes: what a person should know about the reading.
        source: the text's layout, the pandas frame of a Parquet file, or the rows of a bag.
        extra: columns that another file brought, by name.
        date_order: of ``dates.ORDERS``, how its dates are written; None to decide by the dates.
    """

    where: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    notes: tuple[str, ...]
    source: "Layout | Rows | pd.DataFrame"
    extra: Mapping[str, Array] = field(default_factory=dict, hash=False)
    date_order: str | None = None
    _numbers: dict[str, Array] = field(default_factory=dict, init=False, repr=False, compare=False)
    _read: dict[str, Array | None] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    _dates: dict[str, Dates | None] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )  # what ``dates`` has read: half a second for 10⁵ rows, asked for by the choice and the clock

    def at(self, rows: NDArray[np.intp]) -> "Table":
        """Some of its rows, by their numbers in the order wanted."""
        kept = rows.tolist()
        if isinstance(self.source, Layout):
            source: Any = replace(
                self.source,
                rows=DataLines([self.source.rows[k] for k in kept]),
                lines=[self.source.lines[k] for k in kept],
            )
        elif isinstance(self.source, Rows):
            source = Rows(len(kept), self.source.at[kept])
        else:
            source = self.source.iloc[kept]
        return replace(self, source=source, extra={k: v[rows] for k, v in self.extra.items()})

    def with_columns(self, columns: Mapping[str, Array], units: Mapping[str, str]) -> "Table":
        """More columns: name → numbers, (N,), and name → unit in brackets where there is one."""
        return replace(
            self,
            names=(*self.names, *columns),
            units=(*self.units, *(units.get(n, "") for n in columns)),
            extra=dict(self.extra) | dict(columns),
        )

    @property
    def brackets(self) -> dict[str, str]:
        """Column → unit in brackets behind its name, empty where there is none."""
        return dict(zip(self.names, self.units, strict=True))

    @property
    def interval(self) -> float | None:
        """Time between two rows [s] that a title above the header states, None without."""
        return self.source.interval if isinstance(self.source, Layout) else None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was left out as no row of the table."""
        return self.source.skipped.finding(self.where) if isinstance(self.source, Layout) else ()

    def __len__(self) -> int:
        if isinstance(self.source, Rows):
            return self.source.count
        return len(self.source.rows) if isinstance(self.source, Layout) else len(self.source)

    def place(self, row: int) -> str:
        """Where row number ``row`` (from 0) stands in the file, for a message."""
        if isinstance(self.source, Layout):
            return f"{self.where}, line {self.source.lines[row]}"
        if isinstance(self.source, Rows):
            return f"{self.where}, {self.source.at[row]:.6g} s after its start"
        return f"{self.where}, row {row + 1}"

    def line(self, row: int) -> tuple[int, str]:
        """Number in the file and text of row number ``row``; the text is empty but for a text."""
        if isinstance(self.source, Layout):
            return self.source.lines[row], self.source.rows[row]
        return row + 1, ""

    def columns(self, names: Sequence[str]) -> Array:
        """The named columns as numbers, shape (N, n); a missing cell is NaN.

        Raises:
            DataError: a cell is no number, or is infinite; line, column and text are named.
        """
        fresh = [n for n in dict.fromkeys(names) if n not in self.extra and n not in self._numbers]
        index = [self.names.index(n) for n in fresh]
        if index:
            block = self._text(index) if isinstance(self.source, Layout) else self._frame(index)
            self._numbers.update(zip(fresh, block.T, strict=True))
        values = np.empty((len(self), len(names)))
        for k, name in enumerate(names):
            values[:, k] = self.extra[name] if name in self.extra else self._numbers[name]
        with np.errstate(invalid="ignore"):
            beyond = np.abs(values) > LARGEST
        if beyond.any():
            row, column = np.argwhere(beyond)[0]
            value = values[row, column]
            what = "infinity" if np.isinf(value) else f"{value:g}"
            raise DataError(
                f"{self.place(int(row))}, column {names[column]}: {what} is not a valid "
                "number; correct or delete that line"
            )
        return values

    def read(self, name: str) -> Array | None:
        """A column as numbers, or as seconds where it holds dates; None for other text, (N,)."""
        if name not in self._read:
            try:
                dates = self.dates(name)
                self._read[name] = dates.elapsed if dates else self.columns((name,))[:, 0]
            except DataError:
                self._read[name] = None
        return self._read[name]

    def signal(self, name: str) -> Array | None:
        """A column that can be a signal as ``read`` has it; None for dates and text.

        Numbers that a few bad cells spoil can be one: what is chosen is refused with the first.
        """
        values = self.read(name)
        if values is not None:
            return None if self.dates(name) is not None else values
        cells = [number_of(text) for text in self.texts(name)]
        return np.array(cells) if 2 * np.count_nonzero(np.isfinite(cells)) > len(cells) else None

    def texts(self, name: str) -> list[str]:
        return list(self._cells(name, len(self)))

    def _cells(self, name: str, rows: int) -> Iterator[str]:
        """The cells of a column in the first rows; none of a column that never was text."""
        if name in self.extra or isinstance(self.source, Rows):
            return iter(())
        column = self.names.index(name)
        if isinstance(self.source, Layout):
            lines, sep = self.source.rows, self.source.delimiter
            return (split_line(lines[k], sep)[column].strip('"') for k in range(rows))
        return map(str, self.source.iloc[:rows, column])

    def dates(self, name: str) -> Dates | None:
        """A column of dates or times of day, with the other one of the two where there are both.

        None when it holds numbers; an empty cell is NaN.

        Raises:
            DataError: the first cell reads as a date but another one does not.
        """
        if name not in self._dates:
            self._dates[name] = self._read_dates(name)
        return self._dates[name]

    def is_date(self, name: str) -> bool:
        """Whether a column begins with a date or a time of day, or holds one for the other."""
        return date_format(self._first(name)) is not None or len(self.date_and_clock(name)) > 1

    def is_words(self, name: str) -> bool:
        """Whether a column begins with a word that is neither a number, a date nor a state."""
        first = self._first(name)
        known = first.lower() in STATES or date_format(first) is not None
        return first[:1].isalpha() and not known

    def date_and_clock(self, name: str) -> tuple[str, ...]:
        """The columns of one clock: a date and the time of day nearest to it, else the column."""
        halves = {test: test(self._first(name)) for test in (only_day, only_time)}
        if not any(halves.values()):
            return (name,)
        wanted = only_time if halves[only_day] else only_day
        at = self.names.index(name)
        others = [n for n in self.names if n != name and wanted(self._first(n))]
        other = min(others, key=lambda n: abs(self.names.index(n) - at), default=None)
        if other is None:
            return (name,)
        return (name, other) if halves[only_day] else (other, name)

    def _first(self, name: str) -> str:
        """The first cell of a column that is filled."""
        cells = self._cells(name, min(len(self), FIRST_CELL))
        return next((c for c in cells if c.lower() not in MISSING), "")

    def _read_dates(self, name: str) -> Dates | None:
        if not self.is_date(name):
            return None
        parts = list(zip(*map(self.texts, self.date_and_clock(name)), strict=True))
        filled = [k for k, p in enumerate(parts) if not any(c.lower() in MISSING for c in p)]
        cells = [" ".join(parts[k]) for k in filled]
        parsed = seconds_of(cells, self.date_order)
        if isinstance(parsed, int):
            how = f"written like the first one, {cells[0]}"
            if self.date_order is not None:
                how = f"in the order {ORDERS[self.date_order]}"
            raise DataError(
                f"{self.place(filled[parsed])}, column {name}: {cells[parsed]!r} is not a date "
                f"{how}; correct or delete that line"
            )
        if parsed is None:
            return None
        elapsed = np.full(len(parts), np.nan)
        elapsed[filled] = parsed.elapsed
        return parsed._replace(elapsed=elapsed)

    def _text(self, index: list[int]) -> Array:
        layout = self.source
        assert isinstance(layout, Layout)
        plain = layout.decimal == "." and not layout.rows.has('"')
        numbers = layout.rows.numbers(layout.delimiter, index) if plain else None
        return self._odd_text(layout, index) if numbers is None else numbers

    def _odd_text(self, layout: Layout, index: list[int]) -> Array:
        """Cells that are missing, quoted or written with a comma, and very long logs."""
        import pandas as pd

        order = sorted(set(index))
        # pandas returns the columns in file order, whatever order is asked for.
        options: dict[str, Any] = {
            "sep": r"\s+" if layout.delimiter == " " else layout.delimiter,
            "decimal": layout.decimal,
            "header": None,
            "index_col": False,
            "usecols": order,
            "skipinitialspace": True,
            "engine": "c",
        }
        try:
            frame = pd.read_csv(
                io.BytesIO(layout.rows.text),
                dtype=np.float64,
                na_values=list(MISSING),
                **options,
            )
        except (ValueError, OverflowError, pd.errors.ParserError):
            return self._with_states(index)
        if len(frame) != len(layout.rows):  # a quote swallowed line ends
            raise DataError(f"{self.where}: a quotation mark is never closed; delete it")
        return np.ascontiguousarray(frame[index].to_numpy(dtype=np.float64))

    def _with_states(self, index: list[int]) -> Array:
        """The columns where one of them holds the words of a switch, such as ON and OFF."""
        layout = self.source
        assert isinstance(layout, Layout)
        cells = [split_line(row, layout.delimiter) for row in layout.rows]
        out = np.full((len(cells), len(index)), np.nan)
        bad: list[tuple[int, int]] = []
        for j, column in enumerate(index):
            texts = [row[column].strip('"') for row in cells]
            states = _states(texts)
            if states is not None:
                out[:, j] = states
                continue
            numbers = [t.replace(",", ".") if layout.decimal == "," else t for t in texts]
            known = [_is_number(n) for n in numbers]
            out[known, j] = [float(n) for n, is_one in zip(numbers, known, strict=True) if is_one]
            bad += [
                (i, column)
                for i, (text, is_one) in enumerate(zip(texts, known, strict=True))
                if not is_one and text.lower() not in MISSING
            ]
        for row, column in sorted(bad)[:1]:
            raise DataError(self._not_a_number(row, column, cells[row][column], layout.decimal))
        return out

    def switches(self, names: Sequence[str]) -> dict[str, str]:
        """The columns of these that hold a switch's words -> the words, as ``OFF = 0, ON = 1``."""
        words_of_column: dict[str, str] = {}
        for name in (n for n in names if n not in self.extra):
            column = self.names.index(name)
            if isinstance(self.source, Layout):
                if _is_number(next(self._cells(name, 1))):
                    continue
            elif isinstance(self.source, Rows) or not _is_text(self.source.iloc[:, column]):
                continue
            texts = self.texts(name)
            if _states(texts) is not None:
                stated = {t: STATES[t.lower()] for t in texts if t.lower() in STATES}
                words = sorted(stated.items(), key=lambda pair: pair[1])
                words_of_column[name] = ", ".join(f"{word} = {value:g}" for word, value in words)
        return words_of_column

    def _not_a_number(self, row: int, column: int, text: str, decimal: str) -> str:
        """What a cell holds that is no number, and what to do."""
        hint = "correct or delete that line"
        if re.fullmatch(r"[+-]?\d+,\d+", text):
            hint = "it looks like a decimal comma; give the decimal option"
        elif re.fullmatch(r"[+-]?\d{1,3}([., ']\d{3})+([.,]\d+)?", text):
            hint = f"omit the decimal option {decimal!r}, which it contradicts"
        elif row == 0 and re.fullmatch(r"\[?[A-Za-zµ°%][\w/^·* .-]{0,9}\]?", text):
            hint = "write numbers below the header (units go into the column names: u_V)"
        shown = text if len(text) <= 40 else text[:37] + "…"
        name = self.names[column]
        return f"{self.place(row)}, column {name}: {shown!r} is not a number; {hint}"

    def _frame(self, index: list[int]) -> Array:
        import pandas as pd

        frame = self.source
        assert isinstance(frame, pd.DataFrame)
        parts = []
        for i in index:
            column = frame.iloc[:, i]
            texts = [str(c) for c in column] if _is_text(column) else []
            states = _states(texts) if texts else None
            if states is not None:
                parts.append(states)
                continue
            numbers = pd.to_numeric(column, errors="coerce")
            if pd.api.types.is_datetime64_any_dtype(column) or len(numbers) != len(column):
                numbers = pd.Series(np.full(len(column), np.nan))
            lost = np.flatnonzero((numbers.isna() & column.notna()).to_numpy())
            if len(lost):
                text = str(column.iloc[lost[0]])[:40]
                raise DataError(
                    f"{self.place(int(lost[0]))}, column {self.names[i]}: {text!r} is not a "
                    "number; correct that row"
                )
            parts.append(numbers.to_numpy(dtype=np.float64, na_value=np.nan))
        return np.column_stack(parts)


def read_table(data: bytes, where: str, options: ReadOptions = STRICT) -> Table:
    """The table in the bytes of a CSV or Parquet file.

    Args:
        where: its name, for messages and to recognise Parquet by ``.parquet`` or ``.pq``.
        options: ``delimiter``, ``decimal``, ``encoding``, ``strict`` and the order of dates count.
    """
    if not data:
        raise DataError(f"{where} is empty; a log needs a header row and rows of numbers")
    frame = _frame_of(data, where)
    if frame is not None:
        return frame_table(frame, where, options)
    return _table(lay_out(data, where, options), where, options)


def frame_table(frame: "pd.DataFrame", where: str, options: ReadOptions) -> Table:
    """The table of a frame; an index with a name, or one of times, is a column."""
    import pandas as pd

    if isinstance(frame.index, pd.DatetimeIndex | pd.TimedeltaIndex) and not frame.index.name:
        frame.index.name = "time"
    if any(name is not None for name in frame.index.names):
        taken = [f"{n} (index)" if n in frame.columns else n for n in frame.index.names]
        frame = frame.reset_index(names=taken)
    if not len(frame.columns) or not len(frame):
        raise DataError(f"{where} holds no rows of numbers; record the log again")
    return _table(frame, where, options)


def _table(source: "Layout | pd.DataFrame", where: str, options: ReadOptions) -> Table:
    raw: Sequence[str]
    notes: tuple[str, ...] = source.notes if isinstance(source, Layout) else ()
    raw = source.names if isinstance(source, Layout) else [str(c).strip() for c in source.columns]
    raw = tuple(map(name_of, raw))
    if "" in raw:
        at = raw.index("") + 1
        if at == 1 and len(raw) > 2:  # pandas' unnamed index column
            raw = ["(no name)", *raw[1:]]
        else:
            raise DataError(f"{where}: column {at} has no name in the header; give it one")
    if len(raw) < 2:
        raise DataError(
            f"{where} has only the column {raw[0][:40]}; a log needs an input and an output column"
            " (if it has them, give the delimiter)"
        )
    names, units = names_and_units(raw)
    apart = distinct(names)
    if apart != names:
        said = ", ".join(n for n, was in zip(apart, names, strict=True) if n != was)
        notes += (f"{where}: columns share a name; the later ones are called {said}.",)
        names = apart
    if isinstance(source, Layout) and any(source.units):
        units = tuple(u or below for u, below in zip(units, source.units, strict=True))
        stated = ", ".join(f"{n} in {u}" for n, u in zip(names, source.units, strict=True) if u)
        notes += (f"{where}: units from a line next to the header: {stated}.",)
    if isinstance(source, Layout) and any(source.in_cells):
        units = tuple(in_cell or u for in_cell, u in zip(source.in_cells, units, strict=True))
        stated = ", ".join(f"{n} in {u}" for n, u in zip(names, source.in_cells, strict=True) if u)
        notes += (f"{where}: units from behind the numbers: {stated}.",)
    return Table(where, names, units, notes, source, date_order=options.date_order)


def _frame_of(data: bytes, where: str) -> "pd.DataFrame | None":
    """The columns of a file that is no text table, None for one that is."""
    parquet = data.startswith(b"PAR1") or where.lower().endswith((".parquet", ".pq"))
    columns = None if parquet else container(data, where)
    if columns is None and not parquet:
        return None
    import pandas as pd

    if columns is not None:
        return pd.DataFrame(columns)
    try:
        return pd.read_parquet(io.BytesIO(data))
    except Exception:  # pyarrow's errors share no base class
        raise DataError(f"{where} is not a Parquet file, or is damaged; write it again") from None


def _is_text(column: "pd.Series[Any]") -> bool:
    import pandas as pd

    return bool(pd.api.types.is_string_dtype(column) or pd.api.types.is_object_dtype(column))


def _states(texts: Sequence[str]) -> Array | None:
    """The numbers of a column of a switch's words (0 and 1 may stand among them), or None."""
    lower = [t.strip().lower() for t in texts]
    values = {t: STATES[t] for t in set(lower) if t in STATES}
    if not values:
        return None
    values |= {t: float(t) for t in set(lower) if t in ("0", "1")}
    values |= {t: float("nan") for t in set(lower) if t in MISSING}
    if not set(lower) <= set(values):
        return None
    return np.array([values[t] for t in lower], dtype=np.float64)


def number_of(text: str) -> float:
    """The number in a cell; NaN where it is none."""
    try:
        return float("nan" if "_" in text else text.replace(",", "."))
    except ValueError:
        return math.nan


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text
