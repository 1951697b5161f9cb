"""All files of a motor bench: tables of steady states, pulse times, logs of drives, values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sysid.data.finding import notes as as_notes
from sysid.data.io import read_file
from sysid.data.reading.counters import grain
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.table import Table
from sysid.data.record import Record
from sysid.errors import DataError
from sysid.testbench.motor.drive import DriveLog
from sysid.testbench.motor.events import from_counter, from_times, groups_of, require_steady
from sysid.testbench.motor.experiments import CONSTANTS, Kind, KnownValue, SteadyTest, smallest_step
from sysid.testbench.motor.tables import (
    Column,
    columns_of,
    known_value,
    known_values,
    read_bench_table,
    steady_test,
)

Given = Mapping[str, float | tuple[float, float | None]]
"""Constants known without a file: a value, or value and standard error."""

LEAST_ROWS = 50
"""Rows of a drive: fewer do not determine six constants and a noise level per column."""


@dataclass(frozen=True)
class BenchFiles:
    """What the files of a bench hold."""

    tests: tuple[SteadyTest, ...]
    drives: tuple[DriveLog, ...]
    known: Mapping[str, KnownValue]
    notes: tuple[str, ...]


def read_bench_files(
    files: Sequence[Path], units: Mapping[str, str], pulses_per_turn: float, given: Given
) -> BenchFiles:
    """Read the files of a motor bench, each as what its columns say that it is.

    Args:
        pulses_per_turn: of the sensor behind a column of event times.
        given: constants known without a file; they count before those of a file.
    """
    tests: list[SteadyTest] = []
    drives: list[DriveLog] = []
    known: dict[str, KnownValue] = {}
    notes: list[str] = []
    for path in files:
        table = read_bench_table(path)
        columns = columns_of(table, {n: u for n, u in units.items() if n in table.names})
        roles = {c.role for c in columns}
        notes += [
            f"{table.where}: {c.name} is taken as the speed of the output shaft; if it was "
            "measured at the motor's own shaft, divide it by the gear."
            for c in columns
            if c.role == "speed" and c.motor_side
        ]
        if columns and roles <= {*CONSTANTS, "gear"}:
            known |= {v.name: v for v in known_values(table, columns)}
        elif "event" in roles:
            tests.append(_event_test(table, columns, pulses_per_turn))
            notes.append(
                f"{table.where}: one turn of the output shaft is taken as {pulses_per_turn:g} of "
                "its events (`pulses_per_turn`)."
            )
        elif "time" in roles:
            drive_logs, said = _drives(path, columns, units)
            drives += drive_logs
            notes += said
        else:
            test, remark = steady_test(table, columns)
            tests += [test] if test is not None else []
            notes += [remark] if remark else []
    for name, value in given.items():
        number, error = value if isinstance(value, tuple) else (value, None)
        known[name] = known_value(name, number, "a value that was given", error)
    twice = [t.name for t in tests]
    doubled = next((n for n in twice if twice.count(n) > 1), "")
    if doubled:
        raise DataError(f"two files are called {doubled}; rename one, results name them")
    return BenchFiles(tuple(tests), tuple(drives), known, tuple(notes))


def _event_test(table: Table, columns: Sequence[Column], pulses_per_turn: float) -> SteadyTest:
    """Steady speeds from event times, one for each stretch of equal voltage (and load)."""
    by_role = {c.role: c for c in columns}
    if "voltage" not in by_role:
        raise DataError(
            f"{table.where} has times of events but no column of voltage; add voltage_V, the "
            "voltage at each event"
        )
    if "speed" in by_role or "angle" in by_role:
        other = by_role.get("speed") or by_role["angle"]
        raise DataError(f"{table.where} has times of events and {other.name}; keep one of them")
    read = [c for c in columns if c.role in ("voltage", "event", "current", "torque")]
    numbers = table.columns([c.name for c in read])
    values = {c.role: numbers[:, k] * c.scale for k, c in enumerate(read)}
    if not np.all(np.isfinite(values["voltage"]) & np.isfinite(values["event"])):
        raise DataError(f"{table.where}: a voltage or a time is missing; fill or delete that row")
    keys = [values["voltage"], *([values["torque"]] if "torque" in values else [])]
    rows = groups_of(*keys)
    speeds, floor = [], 0.0
    for where in rows:
        events = from_times(values["event"][where], pulses_per_turn, table.where)
        voltage = float(values["voltage"][where][0])
        require_steady(events, table.where, voltage)
        speed, error = events.steady_speed()
        speeds.append(speed * np.sign(voltage))
        floor = max(floor, error * np.sqrt(12.0))
    measurements = {"speed": np.array(speeds)}
    for role in ("current", "torque"):
        if role in values:
            measurements[role] = np.array([float(np.nanmean(values[role][w])) for w in rows])
    steps = {"speed": floor}
    if "current" in values:
        steps["current"] = smallest_step(values["current"])
    kind = Kind.EXTERNAL if "torque" in measurements else Kind.NO_LOAD
    side = "torque" in by_role and by_role["torque"].motor_side
    voltages = np.array([float(values["voltage"][w][0]) for w in rows])
    return SteadyTest(table.where, kind, voltages, measurements, steps, side)


def _drives(
    path: Path, columns: Sequence[Column], units: Mapping[str, str]
) -> tuple[list[DriveLog], list[str]]:
    """The drives of a log, and what there is to say about its measurement."""
    by_role = {c.role: c for c in columns}
    answer = by_role.get("speed") or by_role.get("angle")
    if "voltage" not in by_role or answer is None:
        lacks = "voltage (voltage_V)" if "voltage" not in by_role else "speed (speed_rpm, ticks)"
        raise DataError(f"{path.name} has a time, so it is the log of a drive, but no {lacks}")
    current = by_role.get("current")
    outputs = (answer.name, *([current.name] if current else []))
    load = by_role.get("torque")
    options = ReadOptions(
        inputs=(by_role["voltage"].name, *([load.name] if load else [])),
        outputs=outputs,
        time=by_role["time"].name,
        units={n: u for n, u in units.items() if n in (c.name for c in columns)},
        held="keep",  # a counter that rests is no slow sensor
    )
    log = read_file(path, options)
    drives = [_drive(r, answer, current is not None, load) for r in log.records]
    return drives, list(as_notes(log.findings))


def _drive(record: Record, answer: Column, has_current: bool, load: Column | None) -> DriveLog:
    if len(record) < LEAST_ROWS:
        raise DataError(
            f"{record.name} has {len(record)} rows; a drive needs at least {LEAST_ROWS}"
        )
    voltage = record.u[:, 0]
    if np.ptp(voltage) == 0.0:
        raise DataError(
            f"{record.name}: the voltage never changes; drive steps of the voltage, or give the "
            "steady states as a table"
        )
    y = record.y[:, 0]
    if np.ptp(y) == 0.0:
        raise DataError(f"{record.name}: {answer.name} never changes; the motor did not turn")
    torque = 0.0
    if load is not None:
        if np.ptp(record.u[:, 1]) > 0.0:
            raise DataError(f"{record.name}: the load changes during the drive; keep it constant")
        torque = float(record.u[0, 1])
    turns = answer.role == "angle"
    return DriveLog(
        record.name,
        record.t,
        voltage,
        record.y[:, 1] if has_current else None,
        None if turns else y,
        from_counter(record.t, y, grain(y)) if turns else None,
        torque,
        (record.input_names[0], record.output_names[0]),
        record.dt,
    )
