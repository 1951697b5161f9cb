"""Dates and times of day in the formats of people, loggers and spreadsheets, in seconds."""

import datetime
import re
from collections.abc import Sequence

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
    "day first": re.compile(
        rf"(?P<d>\d{{1,2}})\.(?P<mo>\d{{1,2}})\.(?P<y>\d{{4}}|\d{{2}})(?:{_GAP}{_TIME})?"
    ),
    "slashes": re.compile(
        rf"(?P<mo>\d{{1,2}})[/-](?P<d>\d{{1,2}})[/-](?P<y>\d{{4}}|\d{{2}})(?:{_GAP}{_TIME})?"
    ),
    "time of day": re.compile(_TIME),
    "minutes": re.compile(r"(?P<m>\d{1,3}):(?P<s>\d{2})[.,](?P<f>\d{1,9})"),
}
"""Ways to write an instant. With slashes the month is taken for the first number unless one is
beyond 12; only a log over midnight would show the difference."""

NANO = 1_000_000_000


def date_format(cell: str) -> re.Pattern[str] | None:
    """The way the cell writes an instant, None where it is none."""
    text = cell.strip()
    if not re.search(r"\d[-/:._T ]\d", text):
        return None
    return next((f for f in FORMATS.values() if f.fullmatch(text)), None)


def seconds_of(cells: Sequence[str]) -> tuple[Array, float] | int | None:
    """Instants [s] since the first cell, and the first cell's own time [s] since 1970.

    Returns:
        None where the first cell is no date; the number of the first cell that is none while the
        first one is.
    """
    pattern = date_format(cells[0]) if len(cells) else None
    if pattern is None:
        return None
    swapped = pattern is FORMATS["slashes"] and _day_before_month(cells, pattern)
    nanoseconds: list[int] = []  # of Python: those of NumPy end in the year 2262
    days: dict[tuple[str, ...], int] = {}
    for k, cell in enumerate(cells):
        match = pattern.fullmatch(cell.strip())
        instant = None if match is None else _nanoseconds(match.groupdict(), swapped, days)
        if instant is None:
            return k
        nanoseconds.append(instant)
    elapsed = np.array([n - nanoseconds[0] for n in nanoseconds], dtype=np.float64) / NANO
    return elapsed, float(nanoseconds[0]) / NANO


def _nanoseconds(
    part: dict[str, str | None], swapped: bool, days: dict[tuple[str, ...], int]
) -> int | None:
    day = 0
    year, month, of_month = part.get("y"), part.get("mo"), part.get("d")
    if year and month and of_month:
        key = (year, month, of_month)
        if key not in days:
            number = _day_number(*(key if not swapped else (year, of_month, month)))
            if number is None:
                return None
            days[key] = number
        day = days[key]
    hour, minute, second = (int(part.get(k) or 0) for k in ("h", "m", "s"))
    half = (part.get("half") or "").lower()[:1]
    if half:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + (12 if half == "p" else 0)
    if "h" in part and (hour > 24 or minute > 59 or second > 60):
        return None
    whole = ((day * 24 + hour) * 60 + minute) * 60 + second - _zone(part.get("zone"))
    return whole * NANO + int((part.get("f") or "").ljust(9, "0"))


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


def _day_before_month(cells: Sequence[str], pattern: re.Pattern[str]) -> bool:
    matches = (pattern.fullmatch(c.strip()) for c in cells)
    return any(m is not None and int(m["mo"]) > 12 for m in matches)
