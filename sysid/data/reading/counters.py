"""Unwrapping of counters and angles, and speed from position.

A counter of n bits goes from its last value to its first one. Between two rows the true step is
the one that is whole periods away from the step read and smaller than half a period:
Δ = d − M·round(d/M). (The rule is that of every phase unwrapping, e.g. Itoh 1982.)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from sysid.data.column_words import MEASUREMENTS, words
from sysid.data.finding import Finding, Severity
from sysid.data.record import Array
from sysid.data.units import UNITS, Conversion
from sysid.errors import DataError, UsageError, argument

EVERY = ""
"""Key of a period that holds for every output."""

BITS = (8, 10, 12, 14, 16, 24, 32)
"""Widths of counters in use: registers of 8 to 32 bits, absolute encoders of 10 to 14."""

FASTEST = 0.45
"""Largest step between rows as a share of the period: near one half its direction is a guess."""

SMOOTH = 3.0
"""A wrap is one only where the speed goes on: undone, it may change by so many times what it
changes by elsewhere (99.9 % quantile). A square wave between the two ends fails this."""

TRAVEL = 6.0
"""A position goes further than so many of its larger steps (99 % quantile); white noise around the
two ends of a switched signal, unwrapped, spans two of them."""

MIN_DISTINCT_VALUES = 20
"""A signal of fewer different values is switched, not counted."""

TURNS = (2.0 * pi, 360.0, 6400.0)
"""A turn in radians, degrees and mil, for an angle whose unit is none that we know."""

FULL_TURN = 0.9
"""Such an angle wraps at a turn only if it fills so much of one."""

KNOWN_UNITS = frozenset(unit for unit, _ in UNITS.values())

RESET = 20.0
"""A reset is a jump to zero larger than so many times the usual largest step."""


@dataclass(frozen=True)
class Counted:
    """A column without its jumps.

    Attributes:
        values: the column, (N,).
        period: where it wraps, in its own unit; 0 where it does not.
        wraps: number of wraps undone.
        resets: rows at which it started again from zero.
    """

    values: Array
    period: float = 0.0
    wraps: int = 0
    resets: tuple[int, ...] = ()


def counted(y: Array, periods: Sequence[float], full: bool = False) -> Counted:
    """A column with the wraps and resets that it shows undone.

    Args:
        y: measurements as the file has them, (N,).
        periods: periods besides those of registers that its unit admits.
        full: of these only one that the measurements fill.
    """
    whole = bool(np.all(y == np.rint(y)))
    low, high = float(np.min(y)), float(np.max(y))
    if len(y) < MIN_DISTINCT_VALUES or len(np.unique(y)) < MIN_DISTINCT_VALUES:
        return Counted(y)
    admitted = [m for m in periods if high - low <= 1.001 * m]
    if full:
        admitted = [m for m in admitted if high - low >= FULL_TURN * m]
    if whole:
        for m in (2.0**bits for bits in BITS):
            if (low >= 0.0 and high < m) or (low >= -m / 2.0 and high < m / 2.0):
                admitted.append(m)
    for m in admitted:
        n = _wraps(y, m)
        if n:
            return Counted(np.unwrap(y, period=m), m, n)
    return _without_resets(y) if whole else Counted(y)


def _wraps(y: Array, period: float) -> int:
    """Number of wraps, 0 where the jumps are none that a wrapping counter makes."""
    d = np.diff(y)
    jumps = np.flatnonzero(np.abs(d) > 0.5 * period)
    if not len(jumps) or len(jumps) > 0.5 * len(d):
        return 0
    step = np.diff(np.unwrap(y, period=period))
    if np.max(np.abs(step)) > FASTEST * period:
        return 0
    if np.ptp(np.unwrap(y, period=period)) < TRAVEL * float(np.quantile(np.abs(step), 0.99)):
        return 0
    change = np.abs(np.diff(step))
    at = np.zeros(len(change) + 1, dtype=bool)
    at[jumps] = True
    elsewhere = change[~(at[:-1] | at[1:])]
    usual = float(np.quantile(elsewhere, 0.999)) if len(elsewhere) else 0.0
    grain = float(np.min(np.abs(step[step != 0.0]), initial=np.inf))
    before = np.append(np.inf, change)[jumps]
    after = np.append(change, np.inf)[jumps]
    goes_on = np.minimum(before, after) <= SMOOTH * usual + 2.0 * min(grain, 1.0)
    return len(jumps) if goes_on.mean() > 0.95 else 0


def suspected(y: Array) -> float:
    """About where a whole-numbered column of a period nobody uses starts over; 0 where it doesn't.

    The speed goes on where it does, so the period is the jump without a step like the one before.
    """
    if np.any(y != np.rint(y)) or len(np.unique(y)) < MIN_DISTINCT_VALUES:
        return 0.0
    d = np.diff(y)
    jumps = np.flatnonzero(np.abs(d) > 0.5 * np.ptp(y))
    jumps = jumps[jumps > 0]
    if len(jumps) < 2:
        return 0.0
    period = float(np.rint(np.median(np.abs(d[jumps] - d[jumps - 1]))))
    period = max(period, float(np.ptp(y)) + 1.0)
    return period if np.ptp(y) <= 1.05 * period and _wraps(y, period) else 0.0


def _full_turn(y: Array) -> float:
    """The turn whose ends a column goes over, whatever its unit says; 0 where it does not."""
    filled = [m for m in TURNS if FULL_TURN * m <= np.ptp(y) <= 1.001 * m]
    return next((m for m in filled if len(np.unique(y)) >= MIN_DISTINCT_VALUES and _wraps(y, m)), 0)


def _without_resets(y: Array) -> Counted:
    """A whole-numbered position that falls to zero at once and goes on counting from there."""
    d = np.diff(y)
    usual = float(np.quantile(np.abs(d), 0.995))
    rows = []
    for i in np.flatnonzero(np.abs(d) > RESET * max(usual, 1.0)).tolist():
        speed, onward = np.diff(y[max(i - 5, 0) : i + 1]), np.diff(y[i + 1 : i + 7])
        if not len(speed) or not len(onward) or abs(y[i + 1]) > max(usual, 1.0):
            continue
        before, after = float(np.mean(speed)), float(np.mean(onward))
        if abs(after - before) <= 0.5 * max(abs(before), 1.0):
            rows.append(i)
    # a speed that is switched off falls to zero as well: a position moves by small steps only
    if not rows or usual == 0.0 or np.ptp(y) < 50.0 * usual:
        return Counted(y)
    if np.count_nonzero(np.abs(d) > RESET * max(usual, 1.0)) != len(rows):
        return Counted(y)
    mended = y.copy()
    for i in rows:
        mended[i + 1 :] += mended[i] + (d[i - 1] if i else 0.0) - mended[i + 1]
    return Counted(mended, resets=tuple(i + 1 for i in rows))


def without_jumps(
    values: Array,
    names: Sequence[str],
    outputs: Mapping[str, Conversion],
    headings: Sequence[str],
    periods: Mapping[str, float],
    where: str,
    speed_of: Sequence[str] = (),
) -> tuple[Array, tuple[Finding, ...]]:
    """Outputs that count or turn, and headings, with wraps and resets undone, and what was done.

    Args:
        values: (N, n), as the file has them.
        outputs: output → its unit.
        headings: columns of the pose that are angles.
        periods: column (or ``EVERY``) → period [file unit], 0 to leave it; wins over what is seen.
        speed_of: outputs whose speed is asked for; for another counter it is proposed.
    """
    turns = _turns(outputs)
    turns |= dict.fromkeys(headings, (2.0 * pi, 360.0))
    for name in periods:
        if name != EVERY and name not in turns:
            raise UsageError(
                f"`unwrap` names {name!r}, which is not an output of {where}; the outputs are "
                f"{', '.join(turns)}"
            )
    out = values.copy()
    findings: list[Finding] = []
    for k, name in enumerate(names):
        if name not in turns or not np.all(np.isfinite(values[:, k])):
            continue
        period = periods.get(name, periods.get(EVERY))
        if period == 0.0:
            continue
        if period is None:
            turn = turns[name]
            column = counted(
                values[:, k], TURNS if turn is None else turn, turn is None or turn is TURNS
            )
            if turn is None and name not in speed_of:
                findings += _running_count(column.values, column.wraps, name, where)
            if not (column.wraps or column.resets):
                period = suspected(values[:, k]) or _full_turn(values[:, k])
                findings += _doubted(period, name, where)
        else:
            column = _forced(values[:, k], period, name, where, name in periods)
        out[:, k] = column.values
        findings += _unwrap_finding(column, name, where, period is not None)
    if periods.get(EVERY) and not findings:
        raise DataError(
            f"{where}: no output starts over every {periods[EVERY]:g}; give the period in the "
            "file's own unit, or omit it to have it detected"
        )
    return out, tuple(findings)


def _turns(outputs: Mapping[str, Conversion]) -> dict[str, tuple[float, ...] | None]:
    """What is a turn in the unit of each, none where it is no angle; None without a unit."""
    turns: dict[str, tuple[float, ...] | None] = {}
    for name, unit in outputs.items():
        label = None if not unit.unit else () if unit.unit in KNOWN_UNITS else TURNS
        turns[name] = (2.0 * pi / unit.scale,) if unit.unit == "rad" else label
    return turns


def _running_count(y: Array, wraps: int, name: str, where: str) -> list[Finding]:
    """What to do with an output that is a number of counts which goes on and on.

    Its name or a register's wraps say so: a slow measurement in whole numbers looks alike.
    """
    if np.any(y != np.rint(y)) or len(np.unique(y)) < MIN_DISTINCT_VALUES:
        return []
    named_count = bool({*words(name)} & set(MEASUREMENTS[-1]))
    step = np.abs(np.diff(y))
    if not (named_count or wraps) or np.ptp(y) < TRAVEL * float(np.quantile(step, 0.99)):
        return []
    text = (
        f"{where}: {name} counts in whole numbers like an encoder: it is a position without a "
        "unit, and most models describe a speed."
    )
    unit = {name: "counts=N/rev"}
    advice = (
        f"Fit its speed with {argument(speed_of=name, units=unit)}, N the counts of one "
        f"turn (or {argument(outputs=name, units=unit)} for the position)."
    )
    return [Finding("running-count", Severity.WARNING, text, advice, name, where)]


def _doubted(period: float, name: str, where: str) -> list[Finding]:
    if not period:
        return []
    text = (
        f"{where}: {name} jumps by about {period:g} and continues at the same speed, like a "
        "counter that starts over; it was not unwrapped."
    )
    there = argument(unwrap={name: float(f"{period:g}")})
    advice = f"Give its period, {there}, or keep the jumps, {argument(unwrap={name: None})}."
    return [Finding("counter", Severity.WARNING, text, advice, name, where)]


def _forced(y: Array, period: float, name: str, where: str, named: bool) -> Counted:
    if np.ptp(y) > 1.001 * period:
        if not named:  # the period holds for every output, and this one is no such counter
            return Counted(y)
        raise DataError(
            f"{where}: {name} runs from {np.min(y):g} to {np.max(y):g}, but a counter of period "
            f"{period:g} cannot; give the period in the file's own unit"
        )
    n = int(np.count_nonzero(np.abs(np.diff(y)) > 0.5 * period))
    return Counted(np.unwrap(y, period=period), period, n)


def _real(name: str) -> str:
    return f"If these jumps are real, give {argument(unwrap={name: None})}."


def _unwrap_finding(column: Counted, name: str, where: str, given: bool) -> list[Finding]:
    if column.wraps:
        times = "once" if column.wraps == 1 else f"{column.wraps} times"
        text = f"{where}: {name} starts over every {column.period:.6g}, {times}; it was unwrapped."
        advice = "" if given else _real(name)
    elif column.resets:
        times = "once" if len(column.resets) == 1 else f"{len(column.resets)} times"
        text = (
            f"{where}: {name} was reset to zero {times} while it moved, first in row "
            f"{column.resets[0] + 1}; it was continued from its last value."
        )
        advice = _real(name)
    else:
        return []
    severity = Severity.NOTE if given else Severity.WARNING
    return [Finding("counter", severity, text, advice, name, where)]


def as_speeds(
    t: Array,
    values: Array,
    names: Sequence[str],
    outputs: Mapping[str, Conversion],
    speed_of: Sequence[str],
    where: str,
) -> tuple[Array, dict[str, Conversion], tuple[Finding, ...]]:
    """Outputs ``speed_of`` replaced by their speeds: columns, outputs with units, what was done.

    Args:
        t: instants of the rows [s], (N,).
        values: (N, n), without jumps.
        outputs: output → its unit.
    """
    for name in speed_of:
        if name not in outputs:
            raise UsageError(
                f"`speed_of` names {name!r}, which is not an output of {where}; the outputs are "
                f"{', '.join(outputs)}"
            )
    out = values.copy()
    units: dict[str, Conversion] = {}
    findings: list[Finding] = []
    for name, unit in outputs.items():
        if name not in speed_of:
            units[name] = unit
            continue
        k = list(names).index(name)
        out[:, k] = speeds(t, values[:, k])
        counted = unit.file_unit.partition("=")[0] or unit.unit or "counts"
        rate = Conversion(f"{unit.unit or 'counts'}/s", unit.scale, f"{counted}/s")
        units[f"{name}_speed"] = rate
        step = grain(values[:, k]) * unit.scale / float(np.median(np.diff(t)))
        text = (
            f"{where}: {name}_speed is the mean speed between two measurements of {name}, half "
            f"a sample late; one step of {name} in a sample is {step:.3g} {rate.unit}."
        )
        findings.append(Finding("counter", Severity.NOTE, text, channel=name, record=where))
    return out, units, tuple(findings)


def speeds(t: Array, y: Array) -> Array:
    """Mean speed between a row and the one before it, (y_k − y_{k−1})/(t_k − t_{k−1}), (N,).

    The first row takes the second one's; so does a row at which the time starts again. The mean
    speed of an interval lags the speed at its end by half of it: that is in the sampling, and a
    model of the log has it in its delay.
    """
    step = np.diff(t)
    rate = np.divide(np.diff(y), step, out=np.zeros(len(step)), where=step > 0.0)
    for i in np.flatnonzero(step <= 0.0).tolist():
        rate[i] = rate[i + 1] if i + 1 < len(rate) else rate[i - 1]
    return np.concatenate([rate[:1], rate])


def grain(y: Array) -> float:
    """Smallest step of a position between two rows, 0 where it never moves."""
    step: NDArray[np.float64] = np.abs(np.diff(y))
    smallest = float(np.min(step[step > 1e-9 * max(float(np.ptp(y)), 1e-300)], initial=np.inf))
    return smallest if np.isfinite(smallest) else 0.0
