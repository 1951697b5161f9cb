"""Logs for the fit of a vehicle: every row as logged, with or without inputs."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from sysid.data.column_words import SPEED_UNITS as SPEEDS
from sysid.data.column_words import meaning
from sysid.data.finding import Finding
from sysid.data.logs.log_table import read_log_table
from sysid.data.preparation import Preparation, read_prepared
from sysid.data.reading.columns import NO_INPUT
from sysid.data.reading.pose import find_pose
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.table import Table
from sysid.data.record import Record
from sysid.data.unit_words import ending
from sysid.errors import DataError
from sysid.robot.calibration.trajectory import side_of

NEEDED = (
    "time, the speeds of the left and of the right wheels (such as omega_l and omega_r in rad/s), "
    "and the pose x, y [m] and psi [rad], in one file or the pose in a second one (`join`)"
)
"""What a log must hold."""


def read_vehicle_logs(
    paths: Sequence[Path], options: ReadOptions, steps: Preparation
) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records of logs with a pose, and what there is to say about the measurement.

    The fit distinguishes fresh measurements from repeats itself, so every row is read. A log with
    long gaps is several drives, as windows do not reach over them; one without commands serves,
    too.
    """
    if options.held == "auto":
        options = replace(options, held="keep")
    if not options.join:
        for path in paths:
            _refuse_without(path, options)
    own_columns = _own_columns(paths, options)
    ways = [options] if own_columns is None else [own_columns, options]
    if options.resample == "auto":
        ways += [replace(way, resample="split") for way in ways]
    first: DataError | None = None
    for way in ways:
        try:
            return read_prepared(paths, way, steps)
        except DataError as error:
            first = first or error
    raise first or DataError("no log was read")


def _own_columns(paths: Sequence[Path], options: ReadOptions) -> ReadOptions | None:
    """Options that name the speeds of both sides, measured or else commanded; None where a person
    has named columns, or the names do not show them."""
    if options.outputs or options.inputs or options.speed_of:
        return None
    measured, commanded, commands = _speeds(read_log_table(paths[0], options)[0], options)
    if measured:
        return replace(options, outputs=tuple(measured), inputs=tuple(commands) or (NO_INPUT,))
    if commanded:
        return replace(options, outputs=tuple(commanded), inputs=(NO_INPUT,))
    return None


def _speeds(table: Table, options: ReadOptions) -> tuple[list[str], list[str], list[str]]:
    """Columns of both sides: measured speeds, commands that are speeds, and all commands."""
    pose = find_pose(table.names).names
    units = table.brackets
    columns = {
        kind: [n for n in table.names if n not in pose and meaning(n).quantity == kind]
        for kind in ("speed", "command")
    }
    commands = _both_sides(columns["command"])
    in_speeds = [(options.units.get(n) or units[n] or ending(n)[1]) in SPEEDS for n in commands]
    return _both_sides(columns["speed"]), commands if all(in_speeds) else [], commands


def _both_sides(names: Sequence[str]) -> list[str]:
    """Columns of the left side and as many of the right one; none where they are no pairs."""
    left, right = ([n for n in names if side_of(n) == side] for side in ("left", "right"))
    return [*left, *right] if len(left) == len(right) else []


def _refuse_without(path: Path, options: ReadOptions) -> None:
    """Refuse a log whose columns do not hold what is needed, with the list of what is missing."""
    table = read_log_table(path, options)[0]
    names = table.names
    missing = []
    if not find_pose(names).names:
        missing.append("a pose (x, y [m] and psi [rad])")
    measured, commanded, _ = _speeds(table, options)
    if not (measured or commanded or options.outputs):
        missing.append("the wheel speeds of the left and of the right side (omega_l, omega_r)")
    if missing:
        raise DataError(
            f"{path.name} lacks {' and '.join(missing)} among its columns {', '.join(names)}; "
            f"a fit needs {NEEDED}"
        )
