"""Units of a log's columns, and the factors that convert them to SI."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from sysid.data.column_words import words
from sysid.data.record import PWM_FULL_SCALE, Channel
from sysid.data.unit_words import ending, synonym
from sysid.errors import UsageError, argument

_TURN = 2.0 * math.pi

_FACTORS: dict[str, dict[str, float]] = {
    "rad/s": {"rad/s": 1.0, "rpm": _TURN / 60.0, "deg/s": _TURN / 360.0, "rev/s": _TURN},
    "rad": {"rad": 1.0, "deg": _TURN / 360.0, "rev": _TURN},
    "m/s": {
        "m/s": 1.0,
        "mm/s": 1e-3,
        "cm/s": 1e-2,
        "km/h": 1.0 / 3.6,
        "mph": 0.44704,
        "kn": 1852.0 / 3600.0,
    },
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "km": 1e3},
    "m/s^2": {"m/s^2": 1.0},
    "V": {"V": 1.0, "mV": 1e-3},
    "A": {"A": 1.0, "mA": 1e-3},
    "W": {"W": 1.0, "kW": 1e3},
    "N": {"N": 1.0, "kN": 1e3},
    "Nm": {"Nm": 1.0, "mNm": 1e-3},
    "kg": {"kg": 1.0, "g": 1e-3},
    "Pa": {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "mbar": 1e2, "bar": 1e5},
    "degC": {"degC": 1.0},
    "K": {"K": 1.0},
    "Hz": {"Hz": 1.0},
    "s": {"s": 1.0, "ms": 1e-3, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "µs": {"us": 1.0, "µs": 1.0, "drive": PWM_FULL_SCALE, "%drive": PWM_FULL_SCALE / 100.0},
    "1": {"1": 1.0},
}
"""Unit in the Record -> units of a file that come to it, each with its factor."""

UNITS = {of: (to, factor) for to, group in _FACTORS.items() for of, factor in group.items()}
"""File unit -> (unit in the Record, factor). ``drive`` is PWM as a fraction of full drive."""

_ANY_CASE = {u.lower(): u for u in UNITS if u.lower() not in ("mv", "ma", "mnm", "kn")}
"""Units that cannot be mistaken for another one in capitals."""

LEAST_PULSE = 1100.0
"""PWM that never goes beyond this is not in µs of ±20000, of which nothing moves below."""

MOST = 1e9
"""Counts of a turn and commands of full drive lie between 1/MOST and this."""

_TICKS = re.compile(r"ticks(?P<rate>/s)?/(?P<per_turn>[0-9.eE+]+)")
_COUNTS = re.compile(
    r"(?:counts?|cpr)(?P<rate>/s)?(?:/rev\s*=\s*|\s*=\s*|/)(?P<per_turn>[0-9.eE+]+)(?:/rev)?"
)


@dataclass(frozen=True)
class Conversion:
    """value in ``unit`` = ``scale`` × value in ``file_unit``, × 1/dt when ``per_sample``."""

    unit: str
    scale: float
    file_unit: str
    per_sample: bool = False

    def channel(self, name: str, dt: float) -> Channel:
        """The channel ``name`` under this conversion, for a sample time ``dt`` [s]."""
        scale = self.scale / dt if self.per_sample else self.scale
        return Channel(name, self.unit, scale, self.file_unit if scale != 1.0 else "")


UNKNOWN = Conversion("", 1.0, "")


def conversion(unit: str, channel: str = "") -> Conversion:
    """The conversion from a file unit.

    ``ticks/360`` means encoder ticks counted in one sample, 360 to a turn; ``ticks/s/360`` means
    ticks per second; ``counts=2048/rev`` (or ``counts/2048``) is a counter that goes on counting,
    2048 to a turn: a position; ``counts/s/2048`` its speed. All others are in UNITS. A minus sign
    before a unit changes the sign of the column.
    """
    unit = unit.strip()
    if unit.startswith("-"):
        turned = conversion(unit[1:], channel)
        return replace(turned, scale=-turned.scale, file_unit=f"-{turned.file_unit}")
    where = f" of {channel}" if channel else ""
    position = _COUNTS.fullmatch(unit)
    match = position or _TICKS.fullmatch(unit)
    if match:
        try:
            per_turn = float(match["per_turn"])
        except ValueError:
            per_turn = math.nan
        if not 1.0 / MOST <= per_turn <= MOST:
            raise UsageError(
                f"unit {unit!r}{where}: the ticks per turn must be a positive number up to {MOST:g}"
            )
        if position and match["rate"] is None:
            return Conversion("rad", _TURN / per_turn, unit)
        every = position is None and match["rate"] is None
        return Conversion("rad/s", _TURN / per_turn, unit, per_sample=every)
    for name in (unit, _ANY_CASE.get(unit.lower(), ""), synonym(unit)):
        if name in UNITS:
            to, scale = UNITS[name]
            return Conversion(to, scale, unit)
    raise UsageError(
        f"unknown unit {unit!r}{where}; known are {', '.join(UNITS)}, "
        "ticks/360 (encoder ticks counted in a sample, 360 a turn), ticks/s/360 and "
        "counts=2048/rev (a counter that goes on, 2048 a turn)"
    )


def pwm_conversion(pwm_max: float) -> Conversion:
    """The conversion of a command in ±``pwm_max`` to the robot's ±20000 µs."""
    if not 1.0 / MOST <= pwm_max <= MOST:
        raise UsageError(
            f"`pwm_max` must be a positive number, such as 255, from {1 / MOST:g} to {MOST:g}, got "
            f"{pwm_max:g}"
        )
    return Conversion("µs", PWM_FULL_SCALE / pwm_max, f"±{pwm_max:g}")


def from_name(name: str) -> Conversion:
    """The conversion that a column's name states: ``u_V``, ``y_qm_m``, ``w_rad_s``, ``pwm_l``.

    A rotational speed never ends in a length or force: ``omega_m`` is the motor's speed, not
    metres, so such an ending is no unit there. The word ``rpm`` is a unit wherever it stands
    (``rpm_left``, ``rpmL``).
    """
    base, unit = ending(name)
    stated = words(base)
    rotation = stated[:1] in (("omega",), ("w",))
    if unit:
        by_ending = conversion(unit)
        if not rotation or by_ending.unit == "rad/s":
            return by_ending
    for word, unit_name in (("rpm", "rpm"), ("upm", "rpm"), ("pwm", "us"), ("omega", "rad/s")):
        if word in stated:
            return conversion(unit_name)
    return UNKNOWN


def without_false_pulses(
    by_input: Mapping[str, Conversion], stated: Collection[str], largest: Mapping[str, float]
) -> dict[str, Conversion]:
    """Inputs that only their names call PWM in µs, and whose size says another scale, unlabelled.

    Args:
        by_input: input → conversion.
        stated: inputs whose unit an option or a bracket states.
        largest: input → its largest absolute number in the file.
    """
    return {
        n: UNKNOWN
        if c.unit == "µs"
        and not c.file_unit.startswith("±")
        and c.scale == 1.0
        and n not in stated
        and 0.0 < largest[n] <= LEAST_PULSE
        else c
        for n, c in by_input.items()
    }


def conversions(
    inputs: Sequence[str],
    outputs: Sequence[str],
    bracketed: Mapping[str, str],
    units: Mapping[str, str],
    pwm_max: float | None,
    where: str,
) -> tuple[dict[str, Conversion], dict[str, Conversion]]:
    """The conversion of every channel of a log.

    A unit given by option wins over one in brackets behind the column's name in the file, that
    over the ending of the name. ``pwm_max`` is for the inputs named ``pwm…`` without a unit by
    option, or, where none is named so, for every input without a unit.

    Args:
        inputs, outputs: channel names.
        bracketed: column name → unit in brackets; empty where there is none.
        units: channel name → unit by option.
        pwm_max: command of full drive, or None.
    """
    names = (*inputs, *outputs)
    stated = {n: _bracketed(bracketed[n]) for n in names if bracketed.get(n)}
    for name, unit in units.items():
        meant = [n for n in names if n == name] or [n for n in names if n.lower() == name.lower()]
        if len(meant) != 1:
            raise UsageError(
                f"`units` names {name!r}, which is not a channel of {where}; "
                f"the channels are {', '.join(names)}"
            )
        stated[meant[0]] = conversion(unit, name)
    if pwm_max is not None:
        free = [n for n in inputs if n not in stated and from_name(n).unit in ("", "µs")]
        named = [n for n in free if "pwm" in words(n)]
        if not free:
            raise UsageError(
                f"{argument(pwm_max=pwm_max)} converts PWM inputs, but those of {where} have other "
                f"units ({', '.join(inputs)}); omit it"
            )
        stated.update(dict.fromkeys(named or free, pwm_conversion(pwm_max)))
    every = {n: stated.get(n) or from_name(n) for n in names}
    return {n: every[n] for n in inputs}, {n: every[n] for n in outputs}


def _bracketed(unit: str) -> Conversion:
    """A unit written behind the name in the file; one we do not know is kept as a label."""
    try:
        return conversion(unit)
    except UsageError:
        return Conversion(unit, 1.0, unit)
