"""Files of the power bench: columns of voltage, current, PWM and response.

A file with the battery's voltage and current describes the battery, one with PWM and the motor's
voltage, speed or current the bridge, one with all of them both.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.data.column_words import SUPPLIES, meaning, words
from sysid.data.finding import Finding, Severity
from sysid.data.logs.log_table import read_log_table
from sysid.data.reading.columns import NO_INPUT, choose_columns
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.row_times import row_times
from sysid.data.reading.table import Table
from sysid.data.record import PWM_FULL_SCALE, Array
from sysid.data.unit_words import ending
from sysid.data.units import conversion
from sysid.errors import DataError, UsageError, argument

_VOLTAGE = frozenset(("voltage", "volt", "volts", "spannung", "v", "u", "tension"))
_CURRENT = frozenset(("current", "strom", "i", "amps", "amp", "courant"))
_COMMAND = frozenset(("pwm", "duty", "dutycycle", "throttle", "cmd", "command", "drive"))
_SPEED = frozenset(("omega", "w", "rpm", "speed", "drehzahl", "vel", "velocity", "tacho"))
_MOTOR = frozenset(("motor", "mot", "out", "output", "bridge", "terminal", "leads", "armature"))
_QUANTITY_UNITS = {"voltage": "V", "current": "A", "speed": "rad/s"}
_PERCENT = frozenset(("%", "percent", "prozent"))
LARGEST_DUTY = 1.0 + 1e-9
"""A command that stays within ± 1 is a share of full drive."""
PULSES = 1000.0
"""A PWM that goes beyond this is a pulse width of ± 20000 µs; what lies between a duty and that is
255, 1023 or 100, which only the user knows."""


@dataclass(frozen=True, eq=False)
class PowerLog:
    """What one file holds, in SI units and shares of full drive.

    Attributes:
        t: instants [s], (N,); None for a table of steady measurements.
        voltage, current: of the battery [V, A], (N,), or None.
        drives: side → share of full drive, (N,); ``""`` where there is one motor.
        answers: side → (quantity, values (N,)): ``voltage`` [V], ``speed`` [rad/s] or ``current``
            [A] of the motor.
    """

    name: str
    t: Array | None
    voltage: Array | None
    current: Array | None
    drives: Mapping[str, Array]
    answers: Mapping[str, tuple[str, Array]]
    findings: tuple[Finding, ...]


ANY_FILE = ReadOptions(strict=True)
"""Nothing is said of a bag."""


@dataclass(frozen=True)
class _Column:
    name: str
    quantity: str
    side: str
    of_motor: bool
    of_supply: bool


def read_power_log(
    path: str | Path,
    units: Mapping[str, str] | None = None,
    pwm_max: float | None = None,
    bags: ReadOptions = ANY_FILE,
) -> PowerLog:
    """The measurements of a file of the power bench.

    Args:
        path: CSV, Parquet or bag; a log over time, or a table of steady measurements.
        units: column → its unit in the file.
        pwm_max: command of full drive; None for duty (± 1), per cent by name, or ± 20000 µs.
        bags: what is which column of a bag, its stamps and its latencies.
    """
    path, units = Path(path), units or {}
    table = read_log_table(path, bags)[0]
    unknown = [n for n in units if n.lower() not in [c.lower() for c in table.names]]
    if unknown:
        listed = ", ".join(table.names[:20])
        raise UsageError(f"`units` names {unknown[0]!r}, which is not a column: they are {listed}")
    columns = [c for c in (_column(table, n, units) for n in table.names) if c is not None]
    driven = any(c.quantity == "command" for c in columns)
    battery = {q: _battery_column(columns, q, driven, table.where) for q in ("voltage", "current")}
    t, said = _times(table, [c.name for c in columns], units)
    by_quantity = {q: None if c is None else _values(table, c, units) for q, c in battery.items()}
    drives, answers = _bridge(table, columns, set(battery.values()), units, pwm_max)
    if not answers and (by_quantity["voltage"] is None or by_quantity["current"] is None):
        raise DataError(
            f"{table.where} has neither the columns of a battery (voltage_V and current_A) nor of "
            "a bridge (pwm and motor_voltage_V, or the motor's speed or current); its columns are "
            f"{', '.join(table.names[:20])}"
        )
    return PowerLog(
        table.where, t, by_quantity["voltage"], by_quantity["current"], drives, answers, said
    )


def _column(table: Table, name: str, units: Mapping[str, str]) -> _Column | None:
    base = ending(name)[0]
    said = {w.lower() for w in words(base)}
    unit = _unit(table, name, units)
    quantity = ""
    for named, these in (
        ("command", _COMMAND), ("speed", _SPEED), ("current", _CURRENT), ("voltage", _VOLTAGE),
    ):  # fmt: skip
        if these & said:
            quantity = named
            break
    if unit and unit not in _PERCENT:
        meant = conversion(unit, name).unit
        by_unit = {u: q for q, u in _QUANTITY_UNITS.items()}.get(meant)
        if by_unit is not None:
            quantity = by_unit
        elif quantity != "command":
            return None
    if not quantity:
        return None
    side = meaning(name).side
    supply = bool(SUPPLIES & said) or any(w.startswith(("batter", "akku")) for w in said)
    supply = supply or base.lower() in ("vbat", "vbatt", "ibat", "ibatt")
    return _Column(name, quantity, side, bool(_MOTOR & said) or bool(side), supply)


def _battery_column(
    columns: list[_Column], quantity: str, driven: bool, where: str
) -> _Column | None:
    """The battery's column of a quantity: named so, or the only one that is not the motor's."""
    these = [c for c in columns if c.quantity == quantity]
    named = [c for c in these if c.of_supply]
    if not named and not driven:
        named = [c for c in these if not c.of_motor]
    if len(named) > 1:
        names = ", ".join(c.name for c in named)
        raise DataError(f"{where} has several columns of {quantity} ({names}): keep the battery's")
    return named[0] if named else None


def _bridge(
    table: Table,
    columns: list[_Column],
    taken: set[_Column | None],
    units: Mapping[str, str],
    pwm_max: float | None,
) -> tuple[dict[str, Array], dict[str, tuple[str, Array]]]:
    """Commands and what answers them, by side."""
    drives: dict[str, Array] = {}
    answers: dict[str, tuple[str, Array]] = {}
    for command in (c for c in columns if c.quantity == "command"):
        if command.side in drives:
            raise DataError(f"{table.where} has several commands of one motor: keep one")
        for quantity in _QUANTITY_ORDER:
            these = [
                c
                for c in columns
                if c.quantity == quantity and c.side == command.side and c not in taken
            ]
            if len(these) > 1:
                names = ", ".join(c.name for c in these)
                raise DataError(f"{table.where} has several columns of {quantity} ({names})")
            if these:
                drives[command.side] = _drive(table, command, units, pwm_max)
                answers[command.side] = quantity, _values(table, these[0], units)
                break
    return drives, answers


_QUANTITY_ORDER = ("voltage", "speed", "current")
"""Best quantity first: the bridge's own voltage excludes the motor's friction."""


def _drive(
    table: Table, command: _Column, units: Mapping[str, str], pwm_max: float | None
) -> Array:
    raw = table.columns((command.name,))[:, 0]
    largest = float(np.nanmax(np.abs(raw))) if np.any(np.isfinite(raw)) else 0.0
    unit = _unit(table, command.name, units)
    if pwm_max is not None:
        if not (math.isfinite(pwm_max) and pwm_max > 0.0):
            raise UsageError(f"`pwm_max` must be a positive number, such as 255, got {pwm_max:g}")
        full = pwm_max
    elif unit in _PERCENT or _PERCENT & set(words(command.name)):
        full = 100.0
    elif largest <= LARGEST_DUTY:
        full = 1.0
    elif largest > PULSES:
        full = PWM_FULL_SCALE
    else:
        raise DataError(
            f"{table.where}: {command.name} goes to {largest:g}, and full drive is unknown; "
            f"give {argument(pwm_max=255.0)}"
        )
    if largest > full * (1.0 + 1e-6):
        raise DataError(
            f"{table.where}: {command.name} goes to {largest:g}, beyond the full drive of "
            f"{full:g}; give `pwm_max`"
        )
    return raw / full


def _values(table: Table, column: _Column, units: Mapping[str, str]) -> Array:
    unit = _unit(table, column.name, units)
    scale = conversion(unit, column.name).scale if unit else 1.0
    return table.columns((column.name,))[:, 0] * scale


def _unit(table: Table, name: str, units: Mapping[str, str]) -> str:
    given = next((u for n, u in units.items() if n.lower() == name.lower()), "")
    bracket = table.units[table.names.index(name)]
    unit = ending(name)[1] or ("rpm" if "rpm" in words(name) else "")
    return given or bracket or ("" if unit == "us" else unit)


def _times(
    table: Table, names: list[str], units: Mapping[str, str]
) -> tuple[Array | None, tuple[Finding, ...]]:
    """Instants of the rows from the first on, or None for a table without a time."""
    if not names:
        return None, ()
    choice = choose_columns(table, (NO_INPUT,), tuple(names))
    if choice.clock is None:
        return None, ()
    clock = row_times(table, choice.clock, units, None)
    if any(f.code == "sample-time" and f.severity > Severity.NOTE for f in clock.findings):
        return None, ()
    t = clock.t - clock.t[0]
    if np.any(np.diff(t) < 0.0):
        row = int(np.flatnonzero(np.diff(t) < 0.0)[0]) + 1
        raise DataError(f"{table.place(row)}: the time falls: sort the rows")
    return t, clock.findings
