"""Files of the motor bench: which experiment a table holds, by its columns and their units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.data.column_words import REFERENCES, SUPPLIES, words
from sysid.data.files import contents
from sysid.data.reading.table import Table, read_table
from sysid.data.unit_words import ending, synonym
from sysid.data.units import UNITS, Conversion, conversion, from_name
from sysid.errors import DataError, UsageError, argument
from sysid.testbench.motor.experiments import (
    CONSTANTS,
    MEASUREMENTS,
    Kind,
    KnownValue,
    SteadyTest,
    rounding_error,
    smallest_step,
)

_ROLE_OF_UNIT = {"V": "voltage", "A": "current", "Nm": "torque", "rad/s": "speed", "rad": "angle"}

_ROLE_OF_WORD = {
    **dict.fromkeys(("voltage", "volt", "volts", "spannung", "v", "u"), "voltage"),
    **dict.fromkeys(("current", "amps", "strom", "i"), "current"),
    **dict.fromkeys(("torque", "load", "moment", "drehmoment", "cr", "cm"), "torque"),
    **dict.fromkeys(("speed", "drehzahl", "w", "omega"), "speed"),
    **dict.fromkeys(("ticks", "counts", "count", "encoder", "enc"), "angle"),
    **dict.fromkeys(("t", "time", "zeit", "timestamp"), "time"),
    **dict.fromkeys(("amp", "ampere", "milliamps", "milliamp", "milliampere"), "current"),
}

_EVENT = ("event", "events", "ereignis")
"""Words of the instants at which a sensor saw the shaft …"""

_SENSOR = ("pulse", "pulses", "impuls", "hall", "marker", "edge", "flanke", "tick")
"""… and words that mean it where a word of time stands beside them: ``pulse_time_us``."""

_OTHER = SUPPLIES | REFERENCES | {"pwm", "on", "enabled"}
"""Words of columns that a log may hold beside those of the motor: its supply, what it was to do."""

PROPORTIONAL = 0.2
"""Spread of V/i over its mean up to which a table of voltage and current is one of a blocked rotor.
Heat and brushes move the resistance by a tenth; of a motor that turns, V/i rises with the voltage:
by a third in the thesis's table."""


@dataclass(frozen=True)
class Column:
    """What a column of a bench file holds.

    Attributes:
        role: voltage, current, torque, speed, angle, time, event, or the name of a constant.
        scale: value in SI = scale × value in the file.
        motor_side: whether its name says that it is of the motor's shaft.
    """

    name: str
    role: str
    scale: float = 1.0
    motor_side: bool = False


def read_bench_table(path: Path) -> Table:
    """The table of a bench file."""
    try:
        return read_table(contents(path), path.name)
    except OSError as error:
        raise DataError(f"{path} cannot be read ({error.strerror}); name a CSV file") from None


def columns_of(table: Table, units: Mapping[str, str]) -> tuple[Column, ...]:
    """What the columns hold, unknown ones left out.

    Args:
        units: column → unit, where the file lacks it.
    """
    columns = []
    for name, bracket in zip(table.names, table.units, strict=True):
        column = _column(name, units.get(name) or bracket, table.where)
        if column is not None:
            columns.append(column)
    roles = [c.role for c in columns]
    twice = next((r for r in roles if roles.count(r) > 1), "")
    if twice:
        names = ", ".join(c.name for c in columns if c.role == twice)
        raise DataError(f"{table.where} has two columns of {twice} ({names}); keep one")
    return tuple(columns)


def _column(name: str, unit: str, where: str) -> Column | None:
    base, unit_given = ending(name)
    parts = words(base)
    constant = next((c for c in (*CONSTANTS, "gear") if name == c or name.startswith(f"{c}_")), "")
    if constant:
        return Column(name, constant)
    if _OTHER & set(parts):
        return None
    word = next((_ROLE_OF_WORD[w] for w in parts if w in _ROLE_OF_WORD), "")
    timed = word == "time"
    if timed or _is_event(parts, timed):
        tail = name.rpartition("_")[2]
        unit = unit or unit_given or (tail if tail in ("s", "ms", "us", "ns") else "s")
        scale = 1e-6 if unit in ("us", "µs") else conversion(unit).scale
        return Column(name, "event" if _is_event(parts, timed) else "time", scale)
    # a column may be called by its unit: amps, volts
    named = next((synonym(w) for w in parts if synonym(w) in ("V", "A", "mA")), "")
    known = _conversion(name, unit or unit_given or named)
    role = _ROLE_OF_UNIT.get(known.unit, word)
    if not role or role == "time":
        return None
    side = "motor" in parts
    if role == "angle" and not known.unit:
        raise DataError(
            f"{where}: {name} counts without the counts per turn; give "
            f"{argument(units={name: 'counts=N/rev'})}"
        )
    if not known.unit and role != "voltage":
        example = {"current": "mA", "torque": "Nm", "speed": "rpm"}[role]
        raise DataError(
            f"{where}: {name} has no unit; call it {name}_{example} or give "
            f"{argument(units={name: example})}"
        )
    return Column(name, role, known.scale, side)


def _is_event(parts: Sequence[str], timed: bool) -> bool:
    """Whether the words of a name mean instants of events, German compounds included."""
    for part in parts:
        stem = part.removesuffix("zeit").removesuffix("time")
        if stem in _EVENT or (stem in _SENSOR and (timed or stem != part)):
            return True
    return False


def _conversion(name: str, unit: str) -> Conversion:
    if unit:
        return conversion(unit, name)
    return conversion(name) if name in UNITS else from_name(name)


def known_values(table: Table, columns: Sequence[Column]) -> tuple[KnownValue, ...]:
    """The constants of a file that holds nothing but values, one row."""
    if len(table) != 1:
        raise DataError(
            f"{table.where} holds values and needs one row of numbers; it has {len(table)}"
        )
    numbers = table.columns([c.name for c in columns])[0]
    return tuple(
        known_value(c.role, float(v), table.where) for c, v in zip(columns, numbers, strict=True)
    )


def known_value(name: str, value: float, source: str, std_error: float | None = None) -> KnownValue:
    """A constant that is known without measurements.

    Args:
        name: as in ``CONSTANTS``, or ``gear``.
        value: in SI.
        std_error: None for that of rounding to the last digit; a gear counts teeth and has none.
    """
    if name not in CONSTANTS and name != "gear":
        raise UsageError(
            f"{source}: there is no constant {name!r}; give one of "
            f"{', '.join((*CONSTANTS, 'gear'))}"
        )
    if not (np.isfinite(value) and value > 0.0):
        raise DataError(f"{source}: {name} must be a positive number, got {value:g}")
    error = 0.0 if name == "gear" else rounding_error(value)
    return KnownValue(name, value, error if std_error is None else std_error, source)


def steady_test(table: Table, columns: Sequence[Column]) -> tuple[SteadyTest | None, str]:
    """The experiment that a table of steady states holds, and a remark; None without full rows.

    voltage and current: blocked rotor; with a speed: no load; with a torque and no speed: stall;
    with both: external load.
    """
    by_role = {c.role: c for c in columns}
    if "voltage" not in by_role:
        raise DataError(
            f"{table.where} has no column of voltage; an experiment needs voltage_V and "
            "current_A (blocked rotor), speed_rpm (no load), torque_Nm (stall) or both"
        )
    read = [c for c in columns if c.role in ("voltage", *MEASUREMENTS)]
    values = table.columns([c.name for c in read])
    columns_in_file = dict(zip((c.role for c in read), values.T, strict=True))
    if len(read) == 1:
        raise DataError(f"{table.where} has a voltage only; add current_A, speed_rpm or torque_Nm")
    needed = [r for r in ("voltage", "speed", "torque") if r in by_role]
    full = np.all([np.isfinite(columns_in_file[r]) for r in needed], axis=0)
    if not full.any():
        empty = [by_role[r].name for r in needed if not np.isfinite(columns_in_file[r]).any()]
        which = ", ".join(empty) or "every row"
        return None, f"{table.where} is not used, because {which} is empty."
    measurements = {r: columns_in_file[r][full] * by_role[r].scale for r in columns_in_file}
    steps = {
        r: smallest_step(columns_in_file[r][full]) * abs(by_role[r].scale) for r in columns_in_file
    }
    voltage = measurements.pop("voltage")
    side = "torque" in by_role and by_role["torque"].motor_side
    turns = bool(np.any(measurements.get("speed", np.zeros(1)) != 0.0))
    if "torque" in measurements:
        kind = Kind.EXTERNAL if turns else Kind.STALL
    else:
        kind = Kind.NO_LOAD if turns else Kind.BLOCKED
    if kind is Kind.STALL:
        measurements.pop("speed", None)
    made = SteadyTest(table.where, kind, voltage, measurements, steps, side)
    _check(made)
    lost = int(np.sum(~full))
    said = f"{table.where}: {lost} of {len(full)} incomplete rows were left out." if lost else ""
    return made, said


def _check(test: SteadyTest) -> None:
    for quantity in ("current", "speed", "torque"):
        product = test.of(quantity) * np.sign(test.voltage)
        wrong = np.flatnonzero(product < 0.0)
        if len(wrong):
            raise DataError(
                f"{test.name}: at {test.voltage[wrong[0]]:g} V the {quantity} has the other sign; "
                "give measurements of a driving motor, with the signs of its voltage"
            )
    if np.any(test.voltage == 0.0):
        raise DataError(f"{test.name}: a row has the voltage 0, which does not drive the motor")
    if test.kind is not Kind.BLOCKED:
        return
    current = test.of("current")
    if not np.all(current != 0.0):
        raise DataError(f"{test.name}: a blocked rotor draws current, but a row has none")
    ratio = test.voltage / current
    if np.ptp(ratio) > PROPORTIONAL * float(np.mean(ratio)):
        raise DataError(
            f"{test.name}: without speed and torque these are blocked-rotor currents, but voltage "
            f"over current goes from {ratio.min():.3g} to {ratio.max():.3g} Ω; the motor turned; "
            "add its speed_rpm"
        )
