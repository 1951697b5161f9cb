"""Convert the pose of a log to metres and radians: units, sense and jumps of the angle."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sysid.data.finding import Finding, Severity
from sysid.data.reading.columns import Choice
from sysid.data.reading.pose_columns import (
    PoseColumns,
    angle_unit,
    counts_as_compass,
    is_compass,
    pose_conversions,
)
from sysid.data.record import Array
from sysid.data.units import Conversion
from sysid.errors import UsageError, argument

Units = tuple[Conversion, ...]


def usable_pose(
    choice: Choice, brackets: Mapping[str, str], units: Mapping[str, str]
) -> tuple[Choice, Units]:
    """The choice with its pose if the units can be read, else without it and with the reason."""
    if not choice.pose:
        return choice, ()
    try:
        return choice, pose_conversions(choice.pose, brackets, units)
    except UsageError as error:
        if any(n in units for n in choice.pose):
            raise
        alike = PoseColumns((), choice.pose, str(error))
        ignored = (*choice.ignored, *choice.pose)
        return replace(choice, pose=(), ignored=ignored, alike=alike), ()


def pose_findings(choice: Choice, where: str) -> tuple[Finding, ...]:
    """Columns that look like a pose and were not used, with the reason."""
    alike, why = choice.alike.alike, choice.alike.why
    if not alike:
        return ()
    one = len(alike) == 1
    return (
        Finding(
            "pose",
            Severity.NOTE if choice.pose else Severity.WARNING,
            f"{where}: {', '.join(alike)} look{'s' if one else ''} like a pose but "
            f"{'was' if one else 'were'} not used: {why}.",
            "" if choice.pose else "A pose needs x, y and an angle, such as x, y, psi.",
            record=where,
        ),
    )


def pose_in_si(
    values: Array, choice: Choice, units: Units, where: str
) -> tuple[Array, tuple[Finding, ...]]:
    """All columns with those of the pose in m and rad, the angle without folds, and what is said.

    Args:
        values: (N, n): inputs, outputs and pose as the file has them.
        units: of x, y and angle, as ``pose_conversions`` gives them.
    """
    if not choice.pose:
        return values, pose_findings(choice, where)
    out = values.copy()
    first = len(choice.inputs) + len(choice.outputs)
    findings = list(pose_findings(choice, where))
    for k in (0, 1):
        out[:, first + k] *= units[k].scale
    x, y, angle = out[:, first], out[:, first + 1], out[:, first + 2]
    unit = units[2]
    if unit.scale == 0.0:
        name = choice.pose[2]
        unit_name, seen = angle_unit(x, y, angle)
        unit = Conversion("rad", np.pi / 180.0 if unit_name == "deg" else 1.0, unit_name)
        if unit_name == "deg":
            text = f"{where}: {name} has no unit and was read in degrees, judging by its values."
            advice = f"If that is wrong, give {argument(units={name: 'rad'})}."
            findings.append(Finding("pose", Severity.WARNING, text, advice, name, where))
        elif not seen and np.ptp(angle) > 4.0 * np.pi:
            text = f"{where}: {name} has no unit and was read in radians."
            advice = f"If it is in degrees, give {argument(units={name: 'deg'})}."
            findings.append(Finding("pose", Severity.WARNING, text, advice, name, where))
    angle = np.unwrap(angle * unit.scale)
    if is_compass(choice.pose[2]) and counts_as_compass(x, y, angle):
        angle = 0.5 * np.pi - angle
        text = (
            f"{where}: by the path driven, {choice.pose[2]} counts clockwise from y, like a "
            f"compass; it was read as 90° − {choice.pose[2]}."
        )
        findings.append(Finding("pose", Severity.WARNING, text, record=where))
    out[:, first + 2] = angle
    converted = [
        f"{n} from {c.file_unit}"
        for n, c in zip(choice.pose, (*units[:2], unit), strict=True)
        if c.scale != 1.0
    ]
    names = ", ".join(choice.pose)
    converted_to = f" ({', '.join(converted)}, converted to m and rad)" if converted else ""
    if converted or choice.pose != ("x", "y", "psi"):
        text = f"{where}: the pose is {names}{converted_to}."
        findings.append(Finding("reading", Severity.NOTE, text, record=where))
    return out, tuple(findings)
