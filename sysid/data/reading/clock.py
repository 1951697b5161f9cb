"""Instants of the rows [s]: unit of the time column, roll-overs, repeated rows."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.finding import Finding, Severity
from sysid.data.reading.time_column import STEADY, TimeColumn, unit_in_name, unit_of
from sysid.data.record import Array
from sysid.errors import DataError, UsageError, argument

Place = Callable[[int], str]

UNIT_NAMES = {1.0: "s", 1e-3: "ms", 1e-6: "us", 1e-9: "ns", 60.0: "min", 3600.0: "h", 86400.0: "d"}
"""Unit of time [s] -> its name as an option takes it."""

UNLIKELY_STEP = 10.0
"""A step of a clock without a unit that is at least so large is no step in seconds: motors and
robots are logged faster, and whole seconds that far apart are far more often milliseconds."""

SLOW_STEPS = frozenset((15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0))
"""Steps that people choose in seconds for slow plants; all alike, they are taken for seconds."""

EPOCHS = (
    (1.0, 0.9e9, 4.2e9),
    (1e-3, 0.9e12, 4.2e12),
    (1e-6, 0.9e15, 4.2e15),
    (1e-9, 0.9e18, 4.2e18),
)
"""Unit [s], and the range of numbers that then mean the years 1998 to 2103."""

SLOWEST = 900.0
"""Longest step [s] with which a number in an epoch's range is believed to be one."""

EXCEL_DAYS = (2e4, 8e4)
"""Range of a spreadsheet's day numbers for the years 1954 to 2119."""

MODULI = (
    *(m * s for s in (1.0, 1e-3, 1e-6) for m in (2.0**16, 2.0**32, 2.0**31, 2.0**24)),
    *(86400.0, 3600.0),
)
"""Where clocks start over: uint16, uint32, positive int32 and 24 bits of counts, then of clocks
already divided to milliseconds or seconds; and a day, an hour."""

FIRST_WHOLE = 1e8
"""Instants [s] beyond three years are no time since a start: the first one is subtracted."""


@dataclass(frozen=True)
class Clock:
    """The instants of all rows.

    Attributes:
        t: instants [s], shape (N,).
        origin: what was subtracted from the stamps [s] (of an epoch, a date); 0 for none.
    """

    t: Array
    origin: float
    findings: tuple[Finding, ...]


def stated_unit(column: TimeColumn, bracket: str, given: str | None) -> float | None:
    """The unit [s] of a time column by option, bracket or name; None where none is stated."""
    if given is not None:
        unit = unit_of(given)
        if unit is None:
            raise UsageError(
                f"{argument(units={column.name: given})} is not a unit of time; {column.name} is "
                f"the time column; choose one of {', '.join(UNIT_NAMES.values())}"
            )
        return unit
    return unit_of(bracket) or unit_in_name(column.name)


def instants(raw: Array, column: TimeColumn, unit: float | None, where: str, place: Place) -> Clock:
    """Instants [s] from the numbers of a time column.

    Args:
        raw: the numbers, shape (N,).
        column: the column and how it was found.
        unit: its unit [s] where it is stated, else None: it is then guessed from its steps.
        place: row → "file, line n".
    """
    missing = np.flatnonzero(np.isnan(raw))
    if len(missing):
        raise DataError(
            f"{place(int(missing[0]))}, column {column.name}: the time is missing; "
            "correct or delete that line"
        )
    t, findings = unrolled(raw, column.name, where, place)
    if unit is None:
        unit, doubt = guessed_unit(t, column, where)
        findings = (*findings, *doubt)
    seconds = t * unit
    origin = float(seconds[0]) if abs(seconds[0]) > FIRST_WHOLE else 0.0
    if origin:
        # such numbers of seconds resolve no more than a quarter of a microsecond
        seconds = np.round((t - t[0]) * unit, 6) if unit == 1.0 else (t - t[0]) * unit
    return Clock(seconds, origin, findings)


def unrolled(raw: Array, name: str, where: str, place: Place) -> tuple[Array, tuple[Finding, ...]]:
    """The counts of a clock as if its counter never started over.

    A step back is a roll-over where adding one modulus M makes it an ordinary step: half a step
    to five of them or the longest pause seen. It is undone only if one M explains every step back,
    holds every count, and leaves a steady clock: rows in disorder step back as well.
    """
    d = np.diff(raw)
    back = np.flatnonzero(d < 0)
    ahead = d[d > 0]
    if not len(back) or not len(ahead):
        return raw, ()
    typical = float(np.median(ahead))
    # a damaged stamp leaps and falls, or falls and leaps
    beside = np.r_[back[back > 0] - 1, back[back < len(d) - 1] + 1]
    longest = float(np.max(np.delete(d, beside), initial=0.0))
    for modulus in MODULI:
        mended = d[back] + modulus
        steps = np.where(d < 0, d + modulus, d)
        usual = float(np.median(steps))
        steady = usual > 0 and float(np.mean(np.abs(steps / usual - 1.0) <= 0.5)) >= STEADY
        fits = (mended >= 0.5 * typical) & (mended <= max(5.5 * typical, longest))
        if np.ptp(raw) <= modulus and steady and np.all(fits):
            turns = np.zeros(len(raw))
            turns[back + 1] = 1.0
            times = "once" if len(back) == 1 else f"{len(back)} times"
            text = (
                f"{where}: the clock {name} starts over at {modulus:.10g} {times} (first in "
                f"{place(int(back[0]) + 1).removeprefix(where + ', ')}); the roll-over was removed."
            )
            note = Finding("rollover", Severity.NOTE, text, record=where)
            return raw + modulus * np.cumsum(turns), (note,)
    return raw, ()


def guessed_unit(t: Array, column: TimeColumn, where: str) -> tuple[float, tuple[Finding, ...]]:
    """The unit [s] of a time column without one, guessed from its steps, and a note about it.

    Numbers in the range of an epoch (since 1970) show it by their size. Else steps below 10 are
    seconds, larger ones the unit in which they are between 1 ms and 1 s.
    """
    d = np.diff(t)
    ahead = d[d > 0]
    step = float(np.median(ahead)) if len(ahead) else 1.0
    for unit, low, high in EPOCHS:
        if low <= abs(t[0]) <= high and step * unit <= SLOWEST:
            return unit, _guess(column, unit, step, where, "since 1970") if unit != 1.0 else ()
    if EXCEL_DAYS[0] <= t[0] <= EXCEL_DAYS[1] and step < 0.05 and np.any(t != np.rint(t)):
        return 86400.0, _guess(column, 86400.0, step, where, "as a spreadsheet counts them")
    even = bool(len(d)) and bool(np.all(d == step))
    if step < UNLIKELY_STEP or (even and step in SLOW_STEPS):
        doubt = not column.by_name or (step >= UNLIKELY_STEP)
        return 1.0, _guess(column, 1.0, step, where, "by its steps") if doubt else ()
    unit = 1e-3 if step < 1e3 else 1e-6 if step < 1e6 else 1e-9
    return unit, _guess(column, unit, step, where, "by its steps")


def _guess(
    column: TimeColumn, unit: float, step: float, where: str, how: str
) -> tuple[Finding, ...]:
    name, unit_name = column.name, UNIT_NAMES[unit]
    alternative = "s" if unit_name != "s" else "ms"
    sure = how == "since 1970"
    taken = "was read in" if column.by_name else "was taken as the time, in"
    return (
        Finding(
            "time-unit",
            Severity.NOTE if sure else Severity.WARNING,
            f"{where}: column {name} rises by {step:.6g} a row and {taken} {unit_name} ({how}): a "
            f"sample every {step * unit:.4g} s.",
            f"If that is wrong, give {argument(units={name: alternative})}"
            + ("" if column.by_name else ", or `ts=SECONDS` if it is not the time")
            + ".",
            record=where,
        ),
    )


def doubled_rows(t: Array, values: Array) -> NDArray[np.bool_]:
    """Rows that repeat the row before them, stamp and all: lines that were written twice.

    Where a third of the rows or more stand at the stamp before them the clock is too coarse, and
    none is called doubled.
    """
    still = np.append(False, np.diff(t) == 0)
    same = still.copy()
    same[1:] &= np.all((values[1:] == values[:-1]) | np.isnan(values[1:] + values[:-1]), axis=1)
    if np.count_nonzero(still) * 3 >= len(t):
        return np.zeros(len(t), dtype=bool)
    return same
