"""What reading a log file decided, each with the option that decides otherwise."""

from collections.abc import Sequence

import numpy as np

from sysid.data.column_words import DRIVES, is_set_point, words
from sysid.data.decision import Decision, listed
from sysid.data.finding import Finding
from sysid.data.reading.clock import UNIT_NAMES
from sysid.data.reading.columns import Choice
from sysid.data.reading.dates import ORDERS
from sysid.data.reading.table import Table
from sysid.data.reading.text_layout import Layout
from sysid.data.record import Array, Channel, Record
from sysid.data.units import Conversion


def decisions(
    table: Table,
    choice: Choice,
    t: Array,
    rows: int,
    records: Sequence[Record],
    findings: Sequence[Finding],
    pose_units: Sequence[Conversion],
) -> tuple[Decision, ...]:
    """What was decided on time, columns, units, rows and jumps, in this order.

    Args:
        table, choice: the file and its columns.
        t: instants of all rows [s], (N,).
        pose_units: of the pose; an angle of unknown unit has scale 0.
    """
    first = records[0]
    codes = {f.code: f for f in findings}
    inputs = _channels(first.inputs)
    if any(is_set_point(c.name) for c in first.inputs):
        drive = led_elsewhere(first.inputs, first.outputs)
        of = "includes the drive" if drive else "is the closed loop's"
        inputs += f", a set point: the model {of}"
    scaled = any(c.file_unit.startswith("±") for c in first.inputs)
    found = [
        *_of_text(table),
        Decision("time", time_words(table, choice, t), ("time", "units")),
        Decision("dt", f"{first.dt:.6g} s", ("ts",)),
        Decision("in", inputs, ("inputs", "pwm_max" if scaled else "units")),
        Decision("out", _channels(first.outputs), ("outputs", "units")),
    ]
    if first.pose is not None:
        found.append(Decision("pose", _pose(choice.pose, pose_units, findings), ("units",)))
    parts = _rows(len(table) - rows, records, codes)
    if parts:
        found.append(Decision("rows", parts, ("resample",)))
    if (off := codes.get("released")) is not None:
        found.append(Decision("driven", f"where {off.channel} says so", ("enable",)))
    if "held-telemetry" in codes:
        found.append(Decision("rate", "that of the slowest sensor", ("held",)))
    coded = [f for f in findings if f.code == "missing-code"]
    if coded:
        said = [f.sentence.partition(": ")[2].partition(",")[0] for f in coded]
        found.append(Decision("missing", "; ".join(said), ("missing",)))
    wraps = [f.channel for f in findings if f.code == "counter" and "was unwrapped" in f.sentence]
    if wraps:
        found.append(Decision("unwrapped", listed([n for n in wraps if n]), ("unwrap",)))
    speeds = [n for n in choice.outputs if f"{n}_speed" in first.output_names]
    if speeds:
        found.append(Decision("speed of", listed(speeds), ("speed_of",)))
    return tuple(found)


def led_elsewhere(inputs: Sequence[Channel], outputs: Sequence[Channel]) -> tuple[str, ...]:
    """The set points among the inputs that are of no output: a torque that a drive makes.

    Of other units than all outputs, or by their names of what drives the outputs.
    """
    units, named = {c.unit for c in outputs}, {w for c in outputs for w in words(c.name)}
    return tuple(
        c.name
        for c in inputs
        if is_set_point(c.name)
        and (
            (c.unit and "" not in units and c.unit not in units)
            or DRIVES & {*words(c.name)} - named
        )
    )


def _of_text(table: Table) -> list[Decision]:
    """How a text was read where that is not the usual way."""
    text, said = table.source, []
    if isinstance(text, Layout) and text.encoding:
        said.append(Decision("text", f"in {text.encoding}", ("encoding",)))
    if isinstance(text, Layout) and text.decimal == ",":
        said.append(Decision("numbers", "with a decimal comma", ("decimal",)))
    return said


def time_words(table: Table, choice: Choice, t: Array) -> str:
    """The time column and its unit, which the instants ``t`` [s] of its stamps show, (N,)."""
    clock = choice.clock
    if clock is None:
        return "by the number of the row"
    if clock.counts:
        return f"counted by {clock.name}"
    dates = table.dates(clock.name)
    if dates is not None:
        columns = " + ".join(table.date_and_clock(clock.name))
        return f"{columns} [dates{', ' * bool(dates.order)}{ORDERS.get(dates.order, '')}]"
    d, seconds = np.diff(table.columns((clock.name,))[:, 0]), np.diff(t)
    ahead = d > 0
    ratio = float(np.median(seconds[ahead] / d[ahead])) if ahead.any() else 1.0
    unit = min(UNIT_NAMES, key=lambda u: abs(np.log(max(ratio, 1e-12) / u)))
    return f"{clock.name} [{UNIT_NAMES[unit]}]"


def _channels(channels: Sequence[Channel]) -> str:
    """Names with their units, once for those that share it."""
    if not channels:
        return "none"
    by_unit: dict[str, list[str]] = {}
    for c in channels:
        converted = f"{c.file_unit} → {c.unit}" if c.scale != 1.0 else c.unit
        by_unit.setdefault(converted, []).append(c.name)
    return ", ".join(f"{listed(names)} [{unit or 'no unit'}]" for unit, names in by_unit.items())


def _pose(names: Sequence[str], units: Sequence[Conversion], findings: Sequence[Finding]) -> str:
    said = " ".join(f.sentence for f in findings if f.code == "pose")
    guessed = "deg" if "was read in degrees" in said else "rad"
    shown = [c.file_unit or c.unit if c.scale else guessed for c in units]
    clockwise = ", clockwise from y" if "compass" in said else ""
    return f"{', '.join(names)} [{', '.join(shown)}{clockwise}]"


def _rows(left_out: int, records: Sequence[Record], codes: dict[str, Finding]) -> str:
    parts = [f"{left_out} left out"] if left_out else []
    parts += ["gaps interpolated"] if "gaps" in codes and len(records) == 1 else []
    parts += ["resampled evenly"] if "jitter" in codes else []
    parts += [f"cut into {len(records)} experiments"] if len(records) > 1 else []
    return ", ".join(parts)
