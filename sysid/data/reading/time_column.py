"""Find the time column of a log: by name, else a first column that increases steadily."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.column_words import meaning, words
from sysid.data.record import Array
from sysid.data.unit_words import word_set

if TYPE_CHECKING:
    from sysid.data.reading.table import Table

TIME_COLUMNS = (
    *("t", "time", "t_s", "time_s", "timestamp", "timestamp_s"),
    *(f"{stem}_{unit}" for unit in ("ms", "us", "ns") for stem in ("t", "time", "timestamp")),
)
"""Names of a time column, the first one preferred."""

COUNTERS = (
    *("sample", "samples", "index", "k", "n", "idx", "i", "row", "nr", "no", "seq", "count"),
    *("counter", "cnt", "lfd", "lfd nr", "zeile", "number", "nummer", "num", "satz", "datensatz"),
    *("record", "record no", "record nr", "frame", "frame no", "frame nr", "packet", "line"),
    *("sample no", "sample nr", "no name"),
)
"""Names, as words, of a column that counts rows."""

UNIT_WORDS: dict[str, float] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden"), 1.0),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "milli", "millisecond"), 1e-3),
    **dict.fromkeys(("milliseconds", "millisekunden"), 1e-3),
    **dict.fromkeys(("us", "µs", "usec", "usecs", "micros", "micro", "microsecond"), 1e-6),
    **dict.fromkeys(("microseconds", "mikrosekunden"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "mins", "minute", "minutes", "minuten"), 60.0),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours", "std", "stunden"), 3600.0),
    **dict.fromkeys(("d", "day", "days", "tag", "tage"), 86400.0),
}
"""Words for units of time, in a name, in brackets or given by option -> the unit [s]."""

_CLOCKS = word_set(
    "t time zeit timestamp stamp zeitstempel uhrzeit datum date datetime clock elapsed epoch "
    "temps tiempo tempo tid rosbagtimestamp utc gmt"
)
"""Words that name a time by themselves."""
_ALONE = word_set(
    "millis micros ms us usec msec sec secs seconds milliseconds microseconds nanoseconds nsec "
    "nsecs nanosec sekunden millisekunden nanos"
)
"""Units that are the name of a time column without another word."""
_BESIDE = word_set(
    "boot since start system sys local gps log abs rel unix relative absolute of day header "
    "field arduino esp und and mess test total run device host the in ros bag"
)
"""Words that may stand beside those in the name of a time column."""

MIN_ROWS = 10
"""Rows needed to take a column for the time by its values alone."""
STEADY = 0.8
"""Share of a clock's steps that lie within half of the usual one; most signals fail this."""
SAME_STEPS = 0.01
"""Share by which the steps of a clock that is called by its unit alone may differ."""
RISING = 0.9
"""Share of a clock's steps that go up: the others are roll-overs, restarts or doubled lines."""


@dataclass(frozen=True)
class TimeColumn:
    """The column with the time of every row.

    Attributes:
        fine: a second column that holds the fraction of a second in nanoseconds, or None.
        counts: whether it only counts rows.
        by_name: whether its name says so; else it was the only steady first column.
        over: the column of the recorder's own clock that this stamp of the sender goes before.
    """

    name: str
    fine: str | None = None
    counts: bool = False
    by_name: bool = True
    over: str | None = None

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns that make the time."""
        return (self.name, self.fine) if self.fine else (self.name,)


Numbers = Callable[[str], Array | None]
"""Column name -> its numbers, None where it holds none."""


def unit_of(text: str) -> float | None:
    """The unit of time [s] that a word or bracket names, None where it names none."""
    return UNIT_WORDS.get(text.strip().strip("[]()").strip().lower().replace("μ", "µ"))


def unit_in_name(name: str) -> float | None:
    """The unit of time [s] in a column's name: ``millis``, ``t_ms``, ``TimeUS``."""
    named = words(name)
    for word in reversed(named):
        if word in UNIT_WORDS and (len(named) > 1 or word in _ALONE):
            return UNIT_WORDS[word]
    glued = re.fullmatch(r"(?:t|time)(ms|us|ns|s)", name.strip().lower())
    return UNIT_WORDS[glued[1]] if glued else None


def is_counter(name: str) -> bool:
    """Whether a name says that the column counts rows."""
    named = [word for word in words(name) if word not in ("field", "header")]
    return " ".join(named) in COUNTERS or name.strip() in ("#", "(no name)")


def counts_rows(name: str, table: "Table | None") -> bool:
    """Whether a column counts rows: its name says so, and nearly all its steps are the same."""
    if not is_counter(name):
        return False
    column = None if table is None else table.read(name)
    if column is None or len(column) < 2 or not np.all(np.isfinite(column)):
        return table is None
    d = np.diff(column)
    usual = float(np.median(d))
    return usual != 0.0 and float(np.mean(d == usual)) >= RISING


def is_time(name: str) -> bool:
    """Whether a name says that the column is the time."""
    named = set(words(name))
    if re.fullmatch(r"(?:t|time)(ms|us|ns|s)|x[ _](value|wert)", name.strip().lower()):
        return True
    if not named <= _CLOCKS | _ALONE | _BESIDE | set(UNIT_WORDS):
        return False
    return bool(named & _CLOCKS) or (bool(named & _ALONE) and named <= _ALONE | _BESIDE)


def find_time(
    names: Sequence[str],
    table: "Table | None",
    skip: Sequence[str] = (),
    by_steps: bool = True,
) -> TimeColumn | None:
    """The time column among ``names``, None where there is none.

    By name first; where several names say so, one that rises goes before one that stands still
    (a date beside ``millis``). Then the first column, if it rises in steady steps and its name
    does not make it a signal. A column that only counts comes last.

    Args:
        names: the columns, in the order of the file.
        table: of these columns; None to go by names alone.
        by_steps: whether a first column may be the time by its steps alone; not where the
            sample time is known, and a column that stands still then states nothing either.
    """
    free = [n for n in names if n not in skip]
    named = [n for n in free if is_time(n)]
    if table is not None:
        dates = {n: table.read(n) for n in free if n not in named and table.is_date(n)}
        # None: is said as it is read
        named += [n for n, c in dates.items() if c is None or _rises(c)]
    order = TIME_COLUMNS
    named.sort(key=lambda n: order.index(n.lower()) if n.lower() in order else len(order))
    if table is not None and (len(named) > 1 or named == ["T"]):
        # stable: among those that rise the clearest name stays first; T is mostly a temperature
        named.sort(key=lambda n: (not _rises(table.read(n)), n == "T"))
        named = [n for n in named if n != "T" or _rises(table.read(n))]
    if table is not None and not by_steps:
        # what stands still is of no use, and the sample time is known
        named = [n for n in named if _rises(table.read(n))]
    sender = None if table is None or not named else _of_sender(named, table)
    if sender is not None:
        return sender
    if named:
        return _with_fraction(named, table) or TimeColumn(named[0])
    counters = [n for n in free if is_counter(n) and tells_time(table, n)]
    if table is None:
        counters = [n for n in counters if n in COUNTERS[:5]]
    first = next((n for n in names if n not in counters), None)
    if by_steps and table is not None and first is not None and first in free:
        column = table.read(first) if meaning(first).quantity == "other" else None
        whole = column is not None and bool(np.all(np.diff(column) == 1.0))
        counted = whole and column is not None and column[:1].tolist() in ([0.0], [1.0])
        clock = counted or not _position(first) or (first.lower() in UNIT_WORDS and _even(column))
        if column is not None and is_steady(column) and clock:
            return TimeColumn(first, counts=whole, by_name=False)
    return TimeColumn(counters[0], counts=True) if counters else None


def tells_time(table: "Table | None", name: str) -> bool:
    """Whether a column rises as a time or a counter does; by its name alone without a table."""
    return table is None or _rises(table.read(name))


def is_clock(table: "Table | None", name: str) -> bool:
    """Whether a column is the time of the rows by its name, or a date, and so is no signal."""
    if table is not None and table.is_date(name):
        return True
    return is_time(name) and tells_time(table, name)


def _with_fraction(named: Sequence[str], table: "Table | None") -> TimeColumn | None:
    """Whole seconds and nanoseconds in two columns, as ROS writes its stamps."""
    if table is None or _strictly(table.read(named[0])):
        return None
    seconds = [n for n in named if words(n)[-1:] in (("sec",), ("secs",))]
    fractions = [n for n in named if words(n)[-1:] in (("nsec",), ("nsecs",), ("nanosec",))]
    for whole in seconds:
        for fine in fractions:
            if words(whole)[:-1] == words(fine)[:-1]:
                return TimeColumn(whole, fine)
    return None


def _of_sender(named: Sequence[str], table: "Table") -> TimeColumn | None:
    """The stamp in a message's header where the clearest time is when the recorder received it.

    It is the moment of the measurement, without the jitter of the way; taken where it is complete
    and rises in every row.
    """
    if {"header", "stamp"} <= set(words(named[0])):
        return None
    for name in (n for n in named if {"header", "stamp"} <= set(words(n))):
        rest = [n for n in named if words(n)[:-1] == words(name)[:-1] and n != name]
        fine = next((n for n in rest if words(n)[-1] in ("nsec", "nsecs", "nanosec")), None)
        column, more = table.read(name), None if fine is None else table.read(fine)
        if column is not None and more is not None and words(name)[-1] in ("sec", "secs"):
            if _strictly((column - column[0]) + 1e-9 * more):
                return TimeColumn(name, fine, over=named[0])
        elif _strictly(column):
            return TimeColumn(name, over=named[0])
    return None


def _position(name: str) -> bool:
    """Whether a name is that of a position, which may rise as steadily as a clock."""
    return set(words(name)) <= {"enc", "encoder", "l", "r", "x", "y", "psi", "yaw", "dist", "s"}


def _even(column: Array | None) -> bool:
    """Whether all steps of a column are alike, as those of no way that is travelled."""
    if column is None or len(column) < MIN_ROWS:
        return False
    steps = np.diff(column)
    return bool(np.ptp(steps) <= SAME_STEPS * abs(float(np.median(steps))))


def _strictly(column: Array | None) -> bool:
    return column is not None and len(column) > 1 and bool(np.all(np.diff(column) > 0))


def _rises(column: Array | None) -> bool:
    if column is None or len(column) < 2 or not np.all(np.isfinite(column)):
        return False
    return float(np.mean(np.diff(column) > 0)) >= RISING


def is_steady(column: Array) -> bool:
    """Whether a column rises in steps that are mostly alike."""
    if len(column) < MIN_ROWS or not _rises(column):
        return False
    d = np.diff(column)
    usual = float(np.median(d))
    return float(np.mean(np.abs(d / usual - 1.0) <= 0.5)) >= STEADY
