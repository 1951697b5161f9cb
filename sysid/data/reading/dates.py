"""Dates and times of day in the formats of people, loggers and spreadsheets, in seconds."""

import datetime
import re
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sysid.data.record import Array

_TIME = (
    r"(?P<h>\d{1,2}):(?P<m>\d{2})(?::(?P<s>\d{2})(?:[.,:](?P<f>\d{1,9}))?)?"
    r"(?:\s*(?P<half>[AaPp]\.?[Mm]\.?))?(?:\s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2}))?"
)
_COMPACT = r"(?P<h>\d{2})(?P<m>\d{2})(?P<s>\d{2})(?:[.,](?P<f>\d{1,9}))?(?P<half>)(?P<zone>Z?)"
_GAP = r"(?:[T ,;_]|\s-\s)\s*"
FORMATS: dict[str, re.Pattern[str]] = {
    "year first": re.compile(
        rf"(?P<y>\d{{4}})[-/.](?P<mo>\d{{1,2}})[-/.](?P<d>\d{{1,2}})(?:{_GAP}{_TIME})?"
    ),
    "compact": re.compile(rf"(?P<y>\d{{4}})(?P<mo>\d{{2}})(?P<d>\d{{2}})[T_ -]{_COMPACT}"),
    "eight digits": re.compile(rf"(?P<y>\d{{4}})(?P<mo>\d{{2}})(?P<d>\d{{2}}){_GAP}{_TIME}"),
    "day first": re.compile(
        rf"(?P<d>\d{{1,2}})\.(?P<mo>\d{{1,2}})\.(?P<y>\d{{4}}|\d{{2}})(?:{_GAP}{_TIME})?"
    ),
    "slashes": re.compile(
        rf"(?P<mo>\d{{1,2}})[/-](?P<d>\d{{1,2}})[/-](?P<y>\d{{4}}|\d{{2}})(?:{_GAP}{_TIME})?"
    ),
    "time of day": re.compile(_TIME),
    "minutes": re.compile(r"(?P<m>\d{1,3}):(?P<s>\d{2})[.,](?P<f>\d{1,9})"),
}
"""Ways to write an instant."""

_ELAPSED = re.compile(r"(?:(?P<h>\d{1,4}):)?(?P<m>\d{1,4}):(?P<s>\d{2})(?:[.,](?P<f>\d{1,9}))?")
"""Time since a start: ``75:30`` in minutes and seconds, ``31:15:30`` with hours."""

_PARTS = re.compile(r"\d[-/:_T ]\d|\d\.\d+\.\d")
"""What each of them holds, and hardly a number does: most cells are numbers."""

ORDERS = {"mdy": "month/day/year", "dmy": "day/month/year", "ymd": "year/month/day"}
"""What the numbers of a date with slashes can be; the first is taken where all agree."""

NANO = 1_000_000_000


class Dates(NamedTuple):
    """A column of dates.

    Attributes:
        elapsed: instants [s] since the first cell, (N,).
        first: the first cell's own time [s] since 1970.
        order: of ``ORDERS``, where another one would give other instants; else empty.
    """

    elapsed: Array
    first: float
    order: str = ""


def date_format(cell: str) -> re.Pattern[str] | None:
    """The way the cell writes an instant, None where it is none."""
    text = cell.strip()
    if not _PARTS.search(text):
        return None
    return next((f for f in FORMATS.values() if f.fullmatch(text)), None)


def only_day(cell: str) -> bool:
    """Whether the cell holds a date without a time of day, which may stand in another column."""
    pattern = date_format(f"{cell.strip()} 00:00")
    return pattern is not None and "y" in pattern.groupindex


def only_time(cell: str) -> bool:
    """Whether the cell holds a time of day without a date."""
    return date_format(cell) is FORMATS["time of day"]


def seconds_of(cells: Sequence[str], order: str | None = None) -> Dates | int | None:
    """The instants of a column of dates.

    Which number of a date with slashes is the day is decided over all cells: one beyond 12 is no
    month, and of the orders in which every cell is a date the one is taken in which the clock
    travels least, Σ|t_k+1 − t_k|. Days that follow each other would else be months apart. Times of
    day beyond 24 hours are times since a start (``_since_start``).

    Args:
        order: one of ``ORDERS`` by option, None to decide.

    Returns:
        None where the first cell is no date; the number of the first cell that is none while the
        first one is.
    """
    pattern = date_format(cells[0]) if len(cells) else None
    if pattern is None:
        return None
    days: list[tuple[str, str, str] | None] = []
    clocks: list[int] = []  # of Python: those of NumPy end in the year 2262
    for k, cell in enumerate(cells):
        match = pattern.fullmatch(cell.strip())
        part = {} if match is None else match.groupdict()
        clock = _clock_nanoseconds(part) if part else None
        if clock is None:
            since_start = _since_start(cells) if pattern is FORMATS["time of day"] else None
            return k if since_start is None else since_start
        days.append((part["mo"], part["d"], part["y"]) if part.get("y") else None)
        clocks.append(clock)
    orders = ["mdy"]
    if pattern is FORMATS["slashes"]:
        orders = [*ORDERS] if order is None else [order]
    read = {o: _instants(days, clocks, o) for o in orders}
    whole = {o: found for o, found in read.items() if isinstance(found, Dates)}
    if not whole:
        return max(found for found in read.values() if isinstance(found, int))
    best = min(whole, key=lambda o: float(np.abs(np.diff(whole[o].elapsed)).sum()))
    doubtful = any(not np.array_equal(d.elapsed, whole[best].elapsed) for d in whole.values())
    return whole[best]._replace(order=best if doubtful or order else "")


def _since_start(cells: Sequence[str]) -> Dates | None:
    """A column of times since a start, which never goes back; of two numbers these are minutes and
    seconds. None where a cell is none."""
    nanoseconds = []
    for cell in cells:
        match = _ELAPSED.fullmatch(cell.strip())
        if match is None or int(match["s"]) > 59 or (match["h"] and int(match["m"]) > 59):
            return None
        nanoseconds.append(_nanoseconds(match.groupdict()))
    if any(b < a for a, b in pairwise(nanoseconds)):
        return None
    elapsed = np.array([n - nanoseconds[0] for n in nanoseconds], dtype=np.float64) / NANO
    return Dates(elapsed, float(nanoseconds[0]) / NANO)


def _instants(
    days: Sequence[tuple[str, str, str] | None], clocks: Sequence[int], order: str
) -> Dates | int:
    """The instants with the numbers of each day in this order; the first cell that is no day."""
    numbers: dict[tuple[str, str, str] | None, int | None] = {None: 0}
    for key in {*days} - {None}:
        assert key is not None
        part = dict(zip(order, key, strict=True))
        numbers[key] = _day_number(part["y"], part["m"], part["d"])
    nanoseconds = []
    for k, (key, clock) in enumerate(zip(days, clocks, strict=True)):
        day = numbers[key]
        if day is None:
            return k
        nanoseconds.append(day * 86400 * NANO + clock)
    elapsed = np.array([n - nanoseconds[0] for n in nanoseconds], dtype=np.float64) / NANO
    return Dates(elapsed, float(nanoseconds[0]) / NANO)


def _clock_nanoseconds(part: dict[str, str | None]) -> int | None:
    hour, minute, second = (int(part.get(k) or 0) for k in ("h", "m", "s"))
    half = (part.get("half") or "").lower()[:1]
    if half:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + (12 if half == "p" else 0)
    if "h" in part and (hour > 24 or minute > 59 or second > 60):
        return None
    part = {**part, "h": str(hour)}
    return _nanoseconds(part) - _zone(part.get("zone")) * NANO


def _nanoseconds(part: dict[str, str | None]) -> int:
    """Of hours, minutes, seconds and a fraction."""
    hour, minute, second = (int(part.get(k) or 0) for k in ("h", "m", "s"))
    fraction = int((part.get("f") or "").ljust(9, "0"))
    return ((hour * 60 + minute) * 60 + second) * NANO + fraction


def _day_number(year: str, month: str, day: str) -> int | None:
    """Days since 1970-01-01; two digits of a year are of this century."""
    try:
        date = datetime.date(int(year) + (2000 if len(year) == 2 else 0), int(month), int(day))
    except ValueError:
        return None
    return date.toordinal() - datetime.date(1970, 1, 1).toordinal()


def _zone(text: str | None) -> int:
    """Seconds that a zone is ahead of UTC."""
    if not text or text in ("Z", "UTC"):
        return 0
    digits = text[1:].replace(":", "")
    return (1 if text[0] == "+" else -1) * (int(digits[:2]) * 3600 + int(digits[2:]) * 60)
