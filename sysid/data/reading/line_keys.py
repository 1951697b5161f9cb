"""Lines ``name=value`` of a device's console, and the interval stated in a title block."""

import re
from collections import Counter
from collections.abc import Sequence

from sysid.data.reading.dates import date_format

Line = tuple[int, str]
"""Number of a line in the file, counted from 1, and its text."""

MOST = 0.5
"""More than this share of the lines must name the same values: the others are the device's other
messages, of which a start-up writes a few."""

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_PAIR = re.compile(r"(?P<name>[A-Za-z_][\w.]*)\s*=\s*(?P<value>[^\s,;|=]+)")
_VALUE = re.compile(rf"(?P<number>{_NUMBER})(?P<unit>[A-Za-zµ°%][\w/µ°%]*)?")
_COLOUR = re.compile(r"\x1b\[[\d;]*m")
_SINCE_START = re.compile(r"[EWIDV] \((?P<ms>\d+)\) ")
"""What Espressif's console writes before a message: its level and the milliseconds since start."""
_INTERVAL = re.compile(
    r"\W*(?:(?:sampling|sample|scan|logging|log|mess|abtast)[ _-]?)?"
    r"(?P<what>interval|intervall|period|time|zeit|rate|frequency|frequenz)"
    rf"\W*?[\s:=,;\"(\[]+(?P<number>{_NUMBER})[\s,;\"]*(?P<unit>[A-Za-zµμ]+)[\s,;\")\]]*",
    re.I,
)
_DELTA = re.compile(rf"\W*Delta_X\W*[\s:=,;]+(?P<number>{_NUMBER})(?:[\s,;]+(?P=number))*[\s,;]*")
"""LabVIEW's distance between the rows of every channel, in seconds, equal for all of them."""
_SECONDS = {
    **{"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "µs": 1e-6},
    **{"ns": 1e-9, "min": 60.0, "h": 3600.0},
}
_HERTZ = {"hz": 1.0, "khz": 1e3, "mhz": 1e6}


def without_keys(lines: Sequence[Line]) -> tuple[list[Line], tuple[str, ...]]:
    """Lines such as ``I (1500) fan: duty=248 rpm=1200`` as a header and rows.

    The names that most lines have are the columns; the milliseconds since start in front of them,
    or a date, is the time. Lines without these names are messages of another kind.

    Returns:
        the lines, as they are where they say no values this way, and what was done, as parts of
        sentences.
    """
    if not any("=" in text for _, text in lines[:200]):
        return list(lines), ()
    read = [(i, _COLOUR.sub("", text)) for i, text in lines]
    pairs = [[(m["name"], m["value"]) for m in _PAIR.finditer(text)] for _, text in read]
    kinds = Counter(
        tuple(name for name, _ in pairs_of_line)
        for pairs_of_line in pairs
        if len(pairs_of_line) > 1
    )
    if not kinds:
        return list(lines), ()
    names, count = kinds.most_common(1)[0]
    if count <= MOST * len(lines) or len(set(names)) < len(names):
        return list(lines), ()
    rows = [
        (i, text, pairs_of_line)
        for (i, text), pairs_of_line in zip(read, pairs, strict=True)
        if tuple(name for name, _ in pairs_of_line) == names
    ]
    units = {n: _unit([dict(pairs_of_line)[n] for _, _, pairs_of_line in rows]) for n in names}
    clock, times = _clock([text for _, text, _ in rows])
    header = [*clock, *(f"{n} [{units[n]}]" if units[n] else n for n in names)]
    table = [(0, ";".join(header))]
    for (i, _, pairs_of_line), time in zip(rows, times, strict=True):
        cells = [v[: len(v) - len(units[n])] if units[n] else v for n, v in pairs_of_line]
        table.append((i, ";".join([*time, *cells])))
    notes: tuple[str, ...] = (
        f"the names before the signs = are the columns ({', '.join(names)})"
        + (f"; the time in front of them is column {clock[0]}" if clock else ""),
    )
    lost = len(lines) - len(rows)
    if lost:
        notes += (
            f"{lost} line{'' if lost == 1 else 's'} without them "
            f"{'was' if lost == 1 else 'were'} left out",
        )
    return table, notes


def interval_of(title: str) -> float | None:
    """The time between two rows [s] that a line above the header states with its unit, or None.

    ``"Interval","20 ms"``, ``Sample rate: 50 Hz``, LabVIEW's ``Delta_X``, which is in seconds; any
    other bare number is in no unit that one may guess.
    """
    delta = _DELTA.fullmatch(title.strip())
    if delta is not None and float(delta["number"]) > 0.0:
        return float(delta["number"])
    match = _INTERVAL.fullmatch(title.strip())
    if match is None:
        return None
    unit, number = match["unit"].lower().replace("μ", "µ"), float(match["number"])
    often = match["what"].lower() in ("rate", "frequency", "frequenz")
    if not number > 0.0:
        return None
    if often:
        return 1.0 / (number * _HERTZ[unit]) if unit in _HERTZ else None
    return number * _SECONDS[unit] if unit in _SECONDS else None


def _unit(values: Sequence[str]) -> str:
    """The unit glued to every value of a name, empty where there is none."""
    matches = [_VALUE.fullmatch(v) for v in values]
    units = {(m["unit"] or "") if m else "" for m in matches}
    return units.pop() if len(units) == 1 else ""


def _clock(texts: Sequence[str]) -> tuple[list[str], list[list[str]]]:
    """The time column that stands in front of every line, none where there is none."""
    since = [_SINCE_START.match(text) for text in texts]
    if all(since):
        return ["time [ms]"], [[m["ms"]] for m in since if m]
    for cells in (2, 1):  # a date and a time of day, or a stamp in one piece
        stamps = [" ".join(text.lstrip("[ ").split()[:cells]).rstrip("]:,") for text in texts]
        if "=" not in stamps[0] and date_format(stamps[0]):
            return ["timestamp"], [[s] for s in stamps]
    return [], [[] for _ in texts]
