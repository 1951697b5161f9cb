"""The swing angle of a log: from an angle, a quaternion or a position."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sysid.data.column_words import words
from sysid.data.finding import Finding, Severity
from sysid.data.logs.log_table import read_log_table
from sysid.data.reading.columns import NO_INPUT, choose_columns
from sysid.data.reading.read_options import ReadOptions
from sysid.data.reading.row_times import row_times
from sysid.data.reading.table import Table
from sysid.data.record import Array
from sysid.data.unit_words import ending
from sysid.data.units import conversion
from sysid.errors import DataError, UsageError, argument

ANGLES = frozenset(
    (
        *("angle", "theta", "phi", "psi", "roll", "pitch", "yaw", "swing", "tilt"),
        *("winkel", "pendulum", "heading", "rot", "euler"),
    )
)
"""Words of a column that holds an angle."""
RATES = frozenset(
    ("rate", "vel", "velocity", "speed", "omega", "gyro", "dot", "accel", "acc", "w", "w2")
)
"""Words that make it the rate of one."""
CLEAR = 3.0
"""Among several angles one is the swing where it moves by so many times the next one."""
_QUATERNION = re.compile(
    r"(?P<head>.*?)(?:q|quat|quaternion|orientation|ori|rotation|rot)[ _.\-]*(?P<part>[wxyz0-3])",
    re.IGNORECASE,
)
_SCALAR_FIRST = {"0": "w", "1": "x", "2": "y", "3": "z"}
_POSITION = re.compile(
    r"(?:p|pos|position|com|cog|tracker)?[ _.\-]*(?P<axis>[xyz])(?:[ _.\-]*pos(?:ition)?)?",
    re.IGNORECASE,
)
MIN_ROWS = 20
"""Rows that a log of a swing needs."""


@dataclass(frozen=True, eq=False)
class Swing:
    """An angle over time.

    Attributes:
        t: instants, rising, (N,) [s].
        angle: (N,) [rad], or in an untold unit.
        in_radians: whether the unit is known; else it is radians or degrees.
    """

    name: str
    t: Array
    angle: Array
    in_radians: bool
    findings: tuple[Finding, ...]


def read_swing(
    path: str | Path, options: ReadOptions, arm: float, trim: tuple[float, float] = (0.0, 0.0)
) -> Swing:
    """The swing that a log holds.

    An angle goes before a quaternion, whose rotation about its main axis is
    taken, and that before a position, whose way along its main direction is arm·sin θ.

    Args:
        options: ``outputs`` (one: the angle), ``time``, ``ts``, ``units``, ``delimiter`` and
            ``decimal`` count here.
        arm: distance of the tracked point from the hinge [m], of use for a position only.
        trim: seconds left out at the head and at the tail.
    """
    path = Path(path)
    table = read_log_table(path, replace(options, strict=True))[0]
    known = [n for n in options.units if n.lower() not in [c.lower() for c in table.names]]
    if known:
        raise UsageError(f"`units` names {known[0]!r}, which is not a column: {_listed(table)}")
    names, kind = _places(table, options)
    t, said = _times(table, names, options)
    values = table.columns(names)
    angle, in_radians, how = _ANGLE_OF[kind](table, names, values, options, arm)
    good = np.isfinite(angle) & np.isfinite(t)
    missing = int(np.sum(~good))
    t, angle = t[good], angle[good]
    if np.any(np.diff(t) < 0):
        row = int(np.flatnonzero(np.diff(t) < 0)[0]) + 1
        raise DataError(f"{table.where}: the time falls after {t[row - 1]:g} s: sort the rows")
    if len(t):
        head, tail = trim
        fresh = np.append(True, np.diff(t) > 0)
        fresh &= (t >= t[0] + head) & (t <= t[-1] - tail)
        t, angle = t[fresh], angle[fresh]
    if len(t) < MIN_ROWS:
        raise DataError(
            f"{table.where} has {len(t)} measurements of {how}; "
            "record ten swings at 20 Hz or faster"
        )
    notes = [_note(table, "swing-columns", f"the angle is {how}.")] if how != names[0] else []
    if missing:
        notes.append(_note(table, "empty-cells", f"{missing} rows without a measurement left out."))
    return Swing(table.where, t - t[0], angle, in_radians, (*said, *notes))


def _places(table: Table, options: ReadOptions) -> tuple[tuple[str, ...], str]:
    if options.outputs:
        if len(options.outputs) > 1:
            raise UsageError("`outputs` names several columns; name one angle")
        asked = options.outputs[0]
        names = [n for n in table.names if n.lower() == asked.lower()]
        if not names:
            raise UsageError(f"{table.where} has no column {asked!r}: {_listed(table)}")
        return (names[0],), "angle"
    parts: dict[str, dict[str, str]] = {"quaternion": {}, "position": {}}
    for name in table.names:
        base = ending(name)[0]
        turned, moved = _QUATERNION.fullmatch(base), _POSITION.fullmatch(base)
        if turned:
            part = turned["part"].lower()
            parts["quaternion"].setdefault(_SCALAR_FIRST.get(part, part), name)
        elif moved:
            parts["position"].setdefault(moved["axis"].lower(), name)
    angles = [n for n in table.names if _is_angle(table, n)]
    if angles:
        return _largest(table, angles), "angle"
    if set(parts["quaternion"]) == set("wxyz"):
        return tuple(parts["quaternion"][a] for a in "wxyz"), "quaternion"
    if len(parts["position"]) >= 2:
        return tuple(parts["position"].values()), "position"
    raise DataError(
        f"{table.where} holds no angle, quaternion or position: {_listed(table)}; name the "
        f"column with {argument(outputs=table.names[-1])}"
    )


def _is_angle(table: Table, name: str) -> bool:
    base, unit = ending(name)
    unit = unit or table.units[table.names.index(name)]
    said = set(words(base))
    if RATES & said or _QUATERNION.fullmatch(base):
        return False
    try:
        fits = not unit or conversion(unit).unit == "rad"
    except UsageError:
        fits = True  # a label of the file that says nothing
    return fits and bool(ANGLES & said)


def _largest(table: Table, angles: Sequence[str]) -> tuple[str, ...]:
    """The angle that swings: alone, or by far the largest of several."""
    if len(angles) == 1:
        return (angles[0],)
    moves = [_span(_unfolded(table.columns((n,))[:, 0], False)) for n in angles]
    order = np.argsort(moves)[::-1]
    if moves[order[0]] < CLEAR * moves[order[1]]:
        raise DataError(
            f"{table.where} holds several angles that swing ({', '.join(angles)}): name one with "
            f"{argument(outputs=angles[int(order[0])])}"
        )
    return (angles[int(order[0])],)


def _span(values: Array) -> float:
    """The range of the bulk: a wild measurement is no swing."""
    good = values[np.isfinite(values)]
    return float(np.ptp(np.percentile(good, (1.0, 99.0)))) if len(good) else 0.0


def _times(
    table: Table, names: tuple[str, ...], options: ReadOptions
) -> tuple[Array, tuple[Finding, ...]]:
    choice = choose_columns(table, (NO_INPUT,), names, options.time, options.ts is not None)
    clock = row_times(table, choice.clock, options.units, options.ts)
    untold = [f for f in clock.findings if f.code == "sample-time" and f.severity > Severity.NOTE]
    if untold and options.ts is None:
        raise DataError(
            f"{table.where} has no sample time, which the period needs; give it in seconds with "
            "`ts`, or the time column with `time`"
        )
    return clock.t, clock.findings


def _from_angle(
    table: Table, names: tuple[str, ...], values: Array, options: ReadOptions, arm: float
) -> tuple[Array, bool, str]:
    unit = _unit(table, names[0], options.units)
    factor = conversion(unit, names[0]) if unit else None
    if factor is not None and factor.unit not in ("rad", ""):
        raise UsageError(
            f"{table.where}: {names[0]} is in {unit}, which is not an angle; name another column, "
            "or "
            f"its unit with {argument(units={names[0]: 'deg'})}"
        )
    known = factor is not None and bool(factor.unit)
    angle = values[:, 0] * (factor.scale if factor is not None and known else 1.0)
    return _unfolded(angle, known), known, names[0]


def _unfolded(angle: Array, in_radians: bool) -> Array:
    """An angle that starts over at ±180° made to go on; a wild measurement is no fold."""
    turn = 360.0 if not in_radians and _span(angle) > 2.0 * np.pi else 2.0 * np.pi
    if _span(angle) < 0.5 * turn:
        return angle
    good, out = np.isfinite(angle), angle.copy()
    out[good] = np.unwrap(angle[good], period=turn)
    return out


def _from_quaternion(
    table: Table, names: tuple[str, ...], values: Array, options: ReadOptions, arm: float
) -> tuple[Array, bool, str]:
    """Rotation about the axis the body mostly turns about, from its mean attitude."""
    size = np.linalg.norm(values, axis=1)
    good = np.isfinite(size) & (size > 0.5)  # a tracker that sees nothing writes zeros
    if good.sum() < MIN_ROWS:
        raise DataError(f"{table.where}: {', '.join(names)} hold no unit quaternion")
    q = values[good] / size[good, None]
    mean = np.linalg.eigh(q.T @ q)[1][:, -1]  # Markley (2007): signs of q do not matter
    w0, v0 = mean[0], -mean[1:]
    w = w0 * q[:, 0] - q[:, 1:] @ v0
    v = w0 * q[:, 1:] + q[:, :1] * v0 + np.cross(np.broadcast_to(v0, q[:, 1:].shape), q[:, 1:])
    v = v * np.sign(np.where(w == 0.0, 1.0, w))[:, None]
    sine = np.linalg.norm(v, axis=1)
    turned = v * (2.0 * np.arctan2(sine, np.abs(w)) / np.maximum(sine, 1e-12))[:, None]
    angle = np.full(len(values), np.nan)
    angle[good] = _along_main(turned)
    return angle, True, f"the rotation of {', '.join(names)} about its main axis"


def _from_position(
    table: Table, names: tuple[str, ...], values: Array, options: ReadOptions, arm: float
) -> tuple[Array, bool, str]:
    """Way along the main direction over the arm: its sine."""
    scales = []
    for name in names:
        unit = _unit(table, name, options.units) or "m"
        factor = conversion(unit, name)
        if factor.unit != "m":
            raise UsageError(f"{table.where}: {name} is in {unit}, which is not a length")
        scales.append(factor.scale)
    place = values * np.array(scales)
    good = np.all(np.isfinite(place), axis=1)
    if good.sum() < MIN_ROWS:
        raise DataError(f"{table.where}: {', '.join(names)} hold {int(good.sum())} positions")
    way = _along_main(place[good])
    way = way - 0.5 * float(np.sum(np.percentile(way, (1.0, 99.0))))
    if _span(way) > 2.0 * arm:
        raise DataError(
            f"{table.where}: {', '.join(names)} move by {_span(way):.3g} m, farther than a body at "
            f"{arm:g} m from the hinge can: name their unit, or the distance with `l`"
        )
    angle = np.full(len(values), np.nan)
    angle[good] = np.arcsin(np.clip(way / arm, -1.0, 1.0))
    return angle, True, f"the way of {', '.join(names)} over the arm of {arm:g} m"


_ANGLE_OF = {
    "angle": _from_angle,
    "quaternion": _from_quaternion,
    "position": _from_position,
}


def _along_main(vectors: Array) -> Array:
    """Components along the direction in which vectors (N, 3) or (N, 2) vary most, (N,)."""
    centred = vectors - np.median(vectors, axis=0)
    main = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    return np.asarray(centred @ main)


def _unit(table: Table, name: str, units: Mapping[str, str]) -> str:
    given = next((u for n, u in units.items() if n.lower() == name.lower()), "")
    return given or table.units[table.names.index(name)] or ending(name)[1]


def _listed(table: Table) -> str:
    return f"its columns are {', '.join(table.names[:20])}"


def _note(table: Table, code: str, sentence: str) -> Finding:
    return Finding(code, Severity.NOTE, f"{table.where}: {sentence}", record=table.where)
