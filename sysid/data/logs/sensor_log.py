"""Logs of sensors: columns with gaps, at the instants at which they were written.

A log for a fit is brought onto an even grid; here nothing is filled in: a sensor that read nothing
at a row has an empty cell there, and the rows keep their own times.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sysid.data.column_words import meaning
from sysid.data.decision import Decision
from sysid.data.finding import Finding
from sysid.data.io import chosen
from sysid.data.logs.log_table import read_log_table
from sysid.data.reading.columns import NO_INPUT
from sysid.data.reading.decisions import time_words
from sysid.data.reading.pose import pose_in_si
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.row_times import row_times
from sysid.data.reading.table import Table
from sysid.data.record import Array
from sysid.data.unit_words import ending
from sysid.data.units import conversion
from sysid.data.usable_rows import with_times
from sysid.errors import DataError, UsageError


@dataclass(frozen=True)
class Wanted:
    """A measurement that a log may hold.

    Attributes:
        name: as the workbench calls it, e.g. ``gyro_z``.
        unit: it is to be in; empty where any will do.
        quantity, side: what a column of another name must say to be taken for it, e.g. ``speed``
            and ``left``; empty where only its own name counts.
    """

    name: str
    unit: str
    quantity: str = ""
    side: str = ""


@dataclass(frozen=True, eq=False)
class SensorLog:
    """What sensors read over time.

    Attributes:
        t: instants from the first row on, (N,) [s], rising.
        measurements: name → values in SI units, (N,); NaN where nothing was read.
        pose: true x, y [m], ψ [rad] where the log holds a pose, (N, 3).
        read_as: what was decided when it was read, and how to decide otherwise.
    """

    name: str
    t: Array
    measurements: Mapping[str, Array]
    pose: Array | None
    findings: tuple[Finding, ...] = field(default=())
    read_as: tuple[Decision, ...] = ()


def read_sensor_log(
    path: str | Path,
    wanted: Sequence[Wanted],
    columns: Mapping[str, str] | None = None,
    options: ReadOptions | None = None,
) -> SensorLog:
    """Read the sensors that a log holds.

    Args:
        columns: measurement → column, where the names differ; ``-column`` where its sign does.
        options: ``time``, ``ts``, ``units``, ``delimiter`` and ``decimal`` count here.
    """
    path, options = Path(path), options or ReadOptions()
    table, of_file, _ = read_log_table(path, options, even=False)
    signs = {n: -1.0 if c.startswith("-") else 1.0 for n, c in (columns or {}).items()}
    named = {n: c.removeprefix("-") for n, c in (columns or {}).items()}
    places = _places(table, wanted, named, options.units)
    if not places:
        names = ", ".join(w.name for w in wanted)
        raise DataError(
            f"{table.where} holds none of the measurements {names}; name the columns, e.g. "
            f"gyro_z={table.names[-1]}"
        )
    known = {w.name: w for w in wanted}
    columns_used = tuple(dict.fromkeys(places.values()))
    as_outputs = replace(options, inputs=(NO_INPUT,), outputs=columns_used)
    _, choice, pose_units = chosen(table, as_outputs)
    table, without_time = with_times(table, choice.clock, options.strict)
    measurements = {
        n: signs.get(n, 1.0) * _in_si(table, known[n], c, options.units) for n, c in places.items()
    }
    clock = row_times(table, choice.clock, options.units, options.ts)
    t = clock.t - clock.t[0]
    falls = np.flatnonzero(np.diff(t) <= 0)
    if len(falls):
        raise DataError(
            f"{table.place(int(falls[0]) + 1)}: the time does not increase; sort the rows"
        )
    pose: Array | None = None
    findings: tuple[Finding, ...] = ()
    if choice.pose:
        block = table.columns((*choice.outputs, *choice.pose))
        block, findings = pose_in_si(block, choice, pose_units, table.where)
        pose = block[:, -3:]
    taken = ", ".join(
        f"{n} from {c} [{_unit(table, known[n], c, options.units) or known[n].unit or 'no unit'}]"
        for n, c in places.items()
    )
    read_as = (
        Decision("time", time_words(table, choice, clock.t), ("time", "units")),
        Decision("sensors", taken, ("sensor", "units")),
    )
    said = (*of_file, *without_time, *clock.findings, *findings)
    return SensorLog(path.name, t, measurements, pose, said, read_as)


def _places(
    table: Table, wanted: Sequence[Wanted], named: Mapping[str, str], units: Mapping[str, str]
) -> dict[str, str]:
    """Measurement → column: as named, else of the same name, else by what a name says."""
    lower = {n.lower(): n for n in table.names}
    for name, column in named.items():
        if column.lower() not in lower:
            raise UsageError(
                f"{table.where} has no column {column!r} for {name}; its columns are "
                f"{', '.join(table.names[:20])}"
            )
        if name not in {w.name for w in wanted}:
            known = ", ".join(w.name for w in wanted)
            raise UsageError(f"{name!r} is not a known measurement; known are {known}")
    columns = {name: lower[column.lower()] for name, column in named.items()}
    for w in wanted:
        if w.name not in columns and w.name in lower:
            columns[w.name] = lower[w.name]
    meant = {n: meaning(n) for n in table.names if n not in columns.values()}
    for w in wanted:
        if w.name in columns or not w.quantity:
            continue
        like = [
            n
            for n, m in meant.items()
            if (m.quantity, m.side) == (w.quantity, w.side) and _fits(table, w, n, units)
        ]
        if len(like) == 1:
            columns[w.name] = like[0]
    return columns


def _unit(table: Table, wanted: Wanted, column: str, units: Mapping[str, str]) -> str:
    """The unit that a column says it is in, by option, in brackets or in its name."""
    by_option = {n.lower(): u for n, u in units.items()}
    stated = by_option.get(column.lower()) or by_option.get(wanted.name)
    stated = stated or table.units[table.names.index(column)]
    return stated or ("" if column.lower() == wanted.name else ending(column)[1])


def _fits(table: Table, wanted: Wanted, column: str, units: Mapping[str, str]) -> bool:
    """Whether a column can be the measurement by its unit."""
    unit = _unit(table, wanted, column, units)
    return not unit or conversion(unit, column).unit == wanted.unit


def _in_si(table: Table, wanted: Wanted, column: str, units: Mapping[str, str]) -> Array:
    """A column in the unit of its reading."""
    unit = _unit(table, wanted, column, units)
    values = table.columns((column,))[:, 0]
    if not unit or not wanted.unit:
        return values
    known = conversion(unit, column)
    if known.unit != wanted.unit:
        raise UsageError(
            f"{table.where}: {column} is in {unit}, but {wanted.name} needs {wanted.unit}; give "
            f"its unit, e.g. {column}={wanted.unit}"
        )
    return values * known.scale
