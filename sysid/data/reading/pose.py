"""Pose of a vehicle in a log: its columns by name, in m and rad, sense and jumps of the angle."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.column_words import words
from sysid.data.finding import Finding, Severity
from sysid.data.record import Array
from sysid.data.unit_words import ending, without_unit, word_set
from sysid.data.units import Conversion, conversion
from sysid.errors import UsageError, argument

if TYPE_CHECKING:
    from sysid.data.reading.columns import Choice

AXES = ("x", "y", "angle")
_ANGLES = word_set(
    "psi yaw heading theta th hdg phi kurs gier gierwinkel orientation azimuth bearing course"
)
_COMPASS = frozenset(("heading", "hdg", "kurs", "azimuth", "bearing", "course"))
"""Angles that a navigator counts clockwise from north."""
_X = frozenset(("x", "px", "posx", "xpos"))
_Y = frozenset(("y", "py", "posy", "ypos"))
_BESIDE = word_set(
    "pos position pose robot odom odometry world map ground truth gt mocap optitrack vicon global "
    "p field body est angle winkel"
)
"""Words that may stand beside the axis in the name of a pose column."""

ALIGNED = 0.7
"""Mean of cos 2(way − angle) from which an angle's unit is believed: 1 is perfect agreement,
and the directions of another unit are spread over the circle."""
MIN_MOVES = 30
"""Steps of the way from which the direction of travel is compared with the angle."""


@dataclass(frozen=True)
class PoseColumns:
    """The columns of the pose.

    Attributes:
        names: x, y and angle; empty where the three are not all there.
        alike: columns that look like parts of a pose but were not used.
        why: why they were not, as part of a sentence; empty where nothing looks like a pose.
    """

    names: tuple[str, ...] = ()
    alike: tuple[str, ...] = ()
    why: str = ""


def find_pose(names: Sequence[str]) -> PoseColumns:
    """The pose among these columns, by their names.

    ``x, y, psi`` go before decorated names (``pos_x [mm]``, ``odom_yaw``); decorated ones are
    used where there is one of each, or one set that shares its decoration.
    """
    by_axis: dict[str, list[str]] = {axis: [] for axis in AXES}
    for name in names:
        axis = _axis(name)
        if axis:
            by_axis[axis].append(name)
    if not by_axis["angle"] and not (by_axis["x"] and by_axis["y"]):
        return PoseColumns()
    every = tuple(n for n in names if any(n in group for group in by_axis.values()))
    missing = [axis for axis in AXES if not by_axis[axis]]
    if missing:
        if not (by_axis["x"] and by_axis["y"]):
            return PoseColumns()  # a lone angle is a signal like any other
        return PoseColumns((), every, "the angle (psi, yaw, heading, theta) is missing")
    picked = _one_set(by_axis)
    if not picked:
        return PoseColumns((), every, "there are several of them")
    return PoseColumns(picked, tuple(n for n in every if n not in picked), "another set was used")


def pose_conversions(
    pose: Sequence[str], brackets: Mapping[str, str], units: Mapping[str, str]
) -> tuple[Conversion, ...]:
    """The conversions of x, y and angle to m, m and rad; an angle without a unit has scale 0.

    Args:
        pose: column names of x, y, angle.
        brackets: column name → unit in brackets, empty where there is none.
        units: column name → unit by option.
    """
    conversions = []
    for axis, name in zip(AXES, pose, strict=True):
        stated = units.get(name) or brackets.get(name) or ending(name)[1]
        wanted, examples = ("rad", "rad or deg") if axis == "angle" else ("m", "m, cm or mm")
        if not stated:
            conversions.append(Conversion(wanted, 0.0 if axis == "angle" else 1.0, ""))
            continue
        try:
            known = conversion(stated, name)
        except UsageError:
            known = Conversion("", 1.0, stated)
        if known.unit != wanted:
            raise UsageError(
                f"the unit of {name} is {stated}, which does not fit a pose; "
                f"give {argument(units={name: wanted})} ({examples})"
            )
        conversions.append(known)
    return tuple(conversions)


def angle_unit(x: Array, y: Array, angle: Array) -> tuple[str, bool]:
    """The unit of an angle without one: ("rad" or "deg", whether it was detected).

    Two things show it: a fold (a jump of nearly 2π or 360 between neighbours), and the way: while
    the vehicle drives, the direction of the way is the angle, or opposite to it in reverse, so
    Re mean exp(2i(χ − ψ)) is near 1 for the right unit.
    """
    d = np.abs(np.diff(angle))
    jumps = d[d > np.pi]
    if len(jumps):
        for unit, turn in (("rad", 2.0 * np.pi), ("deg", 360.0)):
            if np.all(np.abs(jumps / turn - 1.0) < 0.1):
                return unit, True
    ways = {u: _agreement(x, y, angle * s) for u, s in (("rad", 1.0), ("deg", np.pi / 180.0))}
    if max(ways.values()) >= ALIGNED and abs(ways["rad"] - ways["deg"]) > 0.2:
        return max(ways, key=lambda u: ways[u]), True
    return "rad", False


def counts_as_compass(x: Array, y: Array, angle: Array) -> bool:
    """Whether the way says that the angle [rad] counts clockwise from y: ψ = π/2 − angle."""
    return _agreement(x, y, 0.5 * np.pi - angle) >= ALIGNED and _agreement(x, y, angle) < ALIGNED


def is_compass(name: str) -> bool:
    """Whether the name is one under which navigators log a clockwise angle."""
    return bool(set(words(without_unit(name))) & _COMPASS)


def _agreement(x: Array, y: Array, angle: Array) -> float:
    """Re mean exp(2i(χ − ψ)) over the steps that move: 1 where the angle is that of the way."""
    span = float(np.hypot(np.ptp(x), np.ptp(y)))
    # Steps of the way that are long against the noise of a tracking camera (1/200 of the field).
    kept = [0]
    for k in range(1, len(x)):
        if np.hypot(x[k] - x[kept[-1]], y[k] - y[kept[-1]]) > 0.005 * span:
            kept.append(k)
    if span == 0.0 or len(kept) < MIN_MOVES:
        return 0.0
    i = np.array(kept)
    way = np.arctan2(np.diff(y[i]), np.diff(x[i]))
    mid = 0.5 * (np.unwrap(angle)[i[:-1]] + np.unwrap(angle)[i[1:]])
    return float(np.real(np.mean(np.exp(2j * (way - mid)))))


def _axis(name: str) -> str:
    stated = set(words(without_unit(name))) - _BESIDE
    if len(stated) != 1:
        return ""
    (word,) = stated
    if word in _X:
        return "x"
    if word in _Y:
        return "y"
    return "angle" if word in _ANGLES else ""


def _one_set(by_axis: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """One column an axis: the only ones, those without decoration, or one decoration's."""
    if all(len(group) == 1 for group in by_axis.values()):
        return tuple(by_axis[axis][0] for axis in AXES)
    by_decoration: dict[frozenset[str], dict[str, list[str]]] = {}
    for axis, group in by_axis.items():
        for name in group:
            decoration = frozenset(set(words(without_unit(name))) & _BESIDE)
            by_decoration.setdefault(decoration, {}).setdefault(axis, []).append(name)
    whole = {
        k: v
        for k, v in by_decoration.items()
        if set(v) == set(AXES) and all(len(g) == 1 for g in v.values())
    }
    chosen = whole.get(frozenset()) or (next(iter(whole.values())) if len(whole) == 1 else None)
    return tuple(chosen[axis][0] for axis in AXES) if chosen else ()


Units = tuple[Conversion, ...]


def usable_pose(
    choice: "Choice", brackets: Mapping[str, str], units: Mapping[str, str]
) -> "tuple[Choice, Units]":
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


def pose_findings(choice: "Choice", where: str) -> tuple[Finding, ...]:
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
    values: Array, choice: "Choice", units: Units, where: str
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
