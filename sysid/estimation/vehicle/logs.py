"""Logs of drives as the fit of a vehicle reads them: every row as logged, inputs or none."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from sysid.data.column_words import meaning
from sysid.data.files import read_bytes
from sysid.data.finding import Finding
from sysid.data.preparation import Preparation, read_prepared
from sysid.data.reading.columns import NO_INPUT
from sysid.data.reading.pose_columns import find_pose
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.table import read_table
from sysid.data.record import Record
from sysid.errors import DataError

NEEDED = (
    "time, the speeds of the left and of the right wheels (such as omega_l and omega_r in rad/s), "
    "and the pose x, y [m] and psi [rad], in one file or the pose in a second one (`join`)"
)
"""What a log must hold."""


def read_drives(
    paths: Sequence[Path], options: ReadOptions, steps: Preparation
) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records of logs with a pose, and what there is to say about the reading.

    The fit tells fresh readings from repeats itself, so that every row is read. A log with long
    gaps is several drives, as windows do not reach over them; one without commands serves, too.

    Raises:
        DataError, UsageError: a file cannot be read, or lacks what a fit needs.
    """
    if options.held == "auto":
        options = replace(options, held="keep")
    ways = [options]
    if not options.inputs:
        ways.append(replace(options, inputs=(NO_INPUT,)))
    if options.resample == "auto":
        ways += [replace(way, resample="split") for way in ways]
    first: DataError | None = None
    for way in ways:
        try:
            return read_prepared(paths, way, steps)
        except DataError as error:
            first = first or error
    if not options.join:
        for path in paths:
            _refuse_without(path, options)
    raise first or DataError("no log was read")


def _refuse_without(path: Path, options: ReadOptions) -> None:
    """Refuse a log whose columns do not hold what is needed, with the list of what is missing.

    Raises:
        DataError: a pose, or the speeds of two sides, cannot be seen among its names.
    """
    names = read_table(read_bytes(path), path.name, options.delimiter, options.decimal).names
    missing = []
    if not find_pose(names).names:
        missing.append("a pose (x, y [m] and psi [rad])")
    sides = {m.side for m in map(meaning, names) if m.quantity in ("speed", "command")}
    if not {"left", "right"} <= sides and len(options.outputs) != 2:
        missing.append("the wheel speeds of the left and of the right side (omega_l, omega_r)")
    if missing:
        raise DataError(
            f"{path.name} lacks {' and '.join(missing)} among its columns {', '.join(names)}; "
            f"a fit needs {NEEDED}"
        )
