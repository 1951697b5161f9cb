"""Meaning of the words in a column's name: side, command, measurement or time."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from sysid.data.unit_words import ending, synonym, without_unit, word_groups, word_set

Quantity = Literal["command", "speed", "measurement", "reference", "supply", "other"]
"""What a column holds: a command to the plant, a speed, another measurement, a set point, the
supply voltage, or something its name does not state."""

_UPPER, _LOWER = "A-ZÀ-ÖØ-Þ", "a-zß-öø-ÿ"
_WORD = re.compile(rf"[{_UPPER}]?[{_LOWER}]+|[{_UPPER}]+(?![{_LOWER}])|[{_UPPER}]|\d+")

SIDES = {
    **dict.fromkeys(("l", "left", "links", "li", "gauche"), "left"),
    **dict.fromkeys(("r", "right", "rechts", "re", "droite"), "right"),
}
"""Word -> the side of the robot that it names."""

COMMANDS = word_groups(
    "pwm",
    "duty dutycycle throttle gas gaspedal fahrpedal pedal",
    "cmd command rcout rcou befehl kommando commande stellgröße stellgroesse stellsignal stellwert "
    "op mv pid controller regler reglerausgang brake bremse frein",
    "volt volts voltage spannung",
    "control ctrl effort drive power leistung",
    "rudder ruder ruderwinkel gouvernail steer steering lenkung lenkwinkel heater heizung heat "
    "chauffage pump pumpe pompe valve ventil vanne fan lüfter relay esc servo damper klappe "
    "dosing dosierung stirrer agitator rührer ruehrer compressor kompressor verdichter blower "
    "gebläse geblaese peltier tec",
    "u motor mot",
)
"""Words of a command, the clearest first: the first group with one of a name's words counts."""

ACTUATOR = len(COMMANDS) - 2
"""The group of parts that act on a plant."""

MEASURED_TOO = (3, 4, 6)
"""Groups of ``COMMANDS`` whose words are measured as often as they are commanded."""

SPEEDS = word_groups(
    "omega w",
    "rpm upm drehzahl tacho",
    "speed vel velocity geschwindigkeit wheelspeed motorspeed vitesse",
    "v",
)
"""Words of a speed, in the same way."""

SPEED_UNITS = frozenset(("rpm", "rad/s", "deg/s", "rev/s", "m/s", "mm/s", "cm/s", "km/h"))
"""Units that make a column a speed where no word does: ``left_rpm``."""

MEASUREMENTS = word_groups(
    "y out output ausgang measured actual feedback istwert ist messwert pv",
    "temp temperature temperatur température level füllstand fuellstand pegel niveau",
    "pressure druck pression ph o2 co2 humidity feuchte moisture flow durchfluss débit debit "
    "force kraft thrust schub torque drehmoment",
    "position pos angle winkel displacement weg theta phi abstand",
    "yawrate gyro gyr gierrate drehrate",
    "current strom courant accel acceleration beschleunigung",
    "enc encoder ticks counts",
)
"""Words of other measurements, in the same way."""

VECTORS = word_set("acc accel acceleration gyro gyr mag magnetometer imu wind")
"""Words of what has axes: a letter beside them is one of these (``AccY``), no output."""

PROCESS_MEASUREMENTS = MEASUREMENTS[1:3]
"""Words of measurements that are not of motion."""

TAGS = word_set("tic pic fic lic")
"""Letters by which plants tag controllers of temperature, pressure, flow and level (ISA-5.1)."""

PROCESS_UNITS = frozenset(("degC", "°C", "K", "Pa", "N"))
"""Units of such measurements in a record, where no word states what is measured."""

RESULT_UNITS = PROCESS_UNITS | word_set(
    "rad deg rev m cm mm um kPa hPa MPa mbar bar psi kg g kN m/s^2 m/s2 degF °F pH ppm lux lx"
)
"""Units of what a sensor reads; those of commands and drives (V, A, Hz, Nm, %) are none."""

DRIVE_UNITS = word_set("V mV")
"""Units of what drives a plant where the name says nothing: ``armature [V]`` beside a speed."""

AMBIENT = word_set("outdoor outside ambient outdoors surroundings aussen außen umgebung")
"""Words of what surrounds a plant: last among its outputs."""

_FLOW = re.compile(
    r"(t|kg|g|l|ml|gal|m\^?3|cm\^?3|m³)/(s|sec|min|h|hr)|[kmµu]?(g|mol|S)/(l|ml|m\^?3|m³|cm)", re.I
)
"""Units of flows, and of what a liquid or gas holds."""

DRIVES = word_set(
    "torque drehmoment moment couple force kraft current strom courant freq frequency frequenz "
    "fréquence hz"
)
"""Words of what drives a plant where nothing else in the log does: each is measured too, but turns,
moves or pumps what the other columns measure."""

SET_POINTS = word_set(
    "ref reference setpoint sp desired des target goal soll sollwert führungsgröße "
    "fuehrungsgroesse vorgabe consigne demand consigna alvo objetivo börvärde gewenst zadana "
    "setpunt"
)
"""Words of what a controller is to reach."""

ENABLES = word_set("enable enabled enabling armed freigabe freigegeben activé habilitado")
"""Words of a switch that is on where the drive is on."""

OF_DRIVES = word_set("torque motor motors drive drives driver power output servo")
"""With ``on`` they say the same: ``torque_on``."""

BRAKES = word_set(
    "brake bremse frein freno released disabled estop notaus coasting freewheeling freilauf"
)
"""Words of a switch that is on where the drive is held or let go."""

REFERENCES = SET_POINTS | {"hat", "sim", "stddev", "error", "err"}
BATTERIES = frozenset(("battery", "bat", "batt", "vbat", "akku", "batterie", "soc"))
SUPPLIES = BATTERIES | {"supply", "versorgung"}

COMPOUND = 5
"""Letters from which a word is looked for at the end of a compound; shorter ones end too many."""

_GLUED = {w for group in (*COMMANDS[:4], *SPEEDS[:3], ("motor",)) for w in group if len(w) > 2}
"""Words to which a side is often glued: ``pwml``, ``rpmright``."""


@dataclass(frozen=True)
class Meaning:
    """What a name says.

    Attributes:
        quantity: what the column holds.
        rank: place of the word that says so in its list of groups (0 is the clearest).
        side: "left", "right" or "".
    """

    quantity: Quantity
    rank: int = 0
    side: str = ""


def words(name: str) -> tuple[str, ...]:
    """The words of a name in lower case: ``pwmL`` → pwm, l; ``Left_RPM`` → left, rpm."""
    parts: list[str] = []
    for word in _WORD.findall(name):
        low = word.lower()
        for side in sorted(SIDES, key=len, reverse=True):
            if low not in _KNOWN and low.endswith(side) and low[: -len(side)] in _GLUED:
                parts += [low[: -len(side)], side]
                break
        else:
            parts.append(low)
    return tuple(parts)


def is_set_point(name: str) -> bool:
    """Whether a name is of a set point: ``speed_ref``, ``SollDrehzahl``."""
    parts = words(name)
    pairs = {a + b for a, b in pairwise(parts)}  # Set Point
    return bool(SET_POINTS & {*parts, *pairs}) or any(w.startswith("soll") for w in parts)


def releases(name: str) -> Literal["enable", "brake", ""]:
    """What a switch of this name says of the drive: that it is on, that it is off, or nothing."""
    parts = set(words(without_unit(name)))
    if parts & BRAKES:
        return "brake"
    return "enable" if parts & ENABLES or ("on" in parts and parts & OF_DRIVES) else ""


def meaning(name: str, unit: str = "") -> Meaning:
    """What a column holds, by the words of its name and by the unit that stands behind it.

    A reference stays one whatever else is in its name (``speed_ref``); a word of a command goes
    before one of a speed (``cmd_speed`` is a command), save for the two letters that only stand
    for a command where nothing else is said (``motor_speed`` and ``Motor [rpm]`` are speeds).
    """
    base, unit = _base_and_unit(name, unit)
    parts = _without_axis(words(base))
    side = next((SIDES[w] for w in parts if w in SIDES), "")
    if REFERENCES & set(parts) or is_set_point(base):
        return Meaning("reference", 0, side)
    of_water = "supply" in parts and (
        unit in PROCESS_UNITS or _rank(parts, PROCESS_MEASUREMENTS) is not None
    )
    if SUPPLIES & set(parts) or any(w.startswith(("batter", "akku", "versorg")) for w in parts):
        return Meaning("measurement", 1, side) if of_water else Meaning("supply", 0, side)
    parts = _with_pairs(parts)
    weak = len(COMMANDS) - 1
    command, speed = _rank(parts, COMMANDS), _rank(parts, SPEEDS)
    if command is not None and (command < weak or speed is None):
        measured = _rank(parts, MEASUREMENTS)
        if command == weak - 1 and _rank(parts[-1:], MEASUREMENTS) in (1, 2):
            return Meaning("measurement", measured or 0, side)  # heater_temp, pump_pressure
        if command >= weak - 1 and unit in SPEED_UNITS and "u" not in parts:
            return Meaning("speed", speed or 1, side)  # fan_rpm, not u_l_rad_s
        if command < weak or measured is None:
            return Meaning("command", command, side)
    if speed is None and command is None and unit in SPEED_UNITS:
        speed = 1
    if speed is not None:
        return Meaning("speed", speed, side)
    by_unit = 1 if unit in PROCESS_UNITS else None  # says what a word would
    found = [rank for rank in (_rank(parts, MEASUREMENTS), by_unit) if rank is not None]
    return Meaning("measurement", found[0], side) if found else Meaning("other", 0, side)


def left_and_right(names: Sequence[str]) -> tuple[int, int] | None:
    """Places of the one name that says left and of the one that says right; None without both."""
    sides = [meaning(name).side for name in names]
    if sides.count("left") != 1 or sides.count("right") != 1:
        return None
    return sides.index("left"), sides.index("right")


def family(name: str) -> tuple[str, ...]:
    """The words of a name without those that distinguish the members of a pair.

    ``Pump A`` and ``Pump B``, ``y1`` and ``y2``, ``pwm_l`` and ``pwm_r``, ``ML`` and ``MR`` are
    families.
    """
    parts = [w for w in words(without_unit(name)) if not w.isdigit() and w not in SIDES]
    parts = [w for w in parts if w not in ("a", "b")] if len(parts) > 1 else parts
    if len(parts) == 1 and re.search(r"[a-zA-Z][LR]$", name):
        return (parts[0][:-1] if parts[0][-1] in "lr" else parts[0],)
    return tuple(parts)


def is_drive(name: str, unit: str) -> bool:
    """Whether a column commands a drive in parts of its full drive or voltage: 0 is no drive.

    A PWM or duty cycle by itself, other commands if they are those of a side (``cmd_left``). A
    speed that a controller follows is no such command, so its unit must not be one of speed.
    """
    meant = meaning(name)
    plain = meant.rank <= 1 or bool(meant.side)
    return meant.quantity == "command" and plain and unit not in SPEED_UNITS


def is_wheel_speed(name: str, unit: str) -> bool:
    """Whether a column is the speed of a motor, wheel or track: 0 is standstill."""
    meant = meaning(name)
    plain = meant.rank <= 1 or bool(meant.side) or unit == "rad/s"
    return meant.quantity == "speed" and plain and unit in ("", "rad/s", "m/s")


def may_move(name: str, unit: str) -> bool:
    """Whether a measurement may be of something that turns or moves.

    A temperature, a level of a liquid, a pressure, a flow or a force is none of motion, whatever
    it is read in; a name that says nothing may be anything.
    """
    base, _ = ending(name)
    parts = _with_pairs(words(base))
    moves = _rank(parts, SPEEDS) is not None or _rank(parts, MEASUREMENTS[3:]) is not None
    named = bool(TAGS & {*parts}) or _rank(parts, PROCESS_MEASUREMENTS) is not None
    return moves or not (named or unit in PROCESS_UNITS)


def is_actuator(meant: Meaning) -> bool:
    """Whether a meaning is a command to an actuator and not a measurement in any log."""
    return meant.quantity == "command" and meant.rank not in MEASURED_TOO


def may_drive(name: str, unit: str = "") -> bool:
    """Whether a column that names no command may be the input beside measurements of its effect."""
    meant = meaning(name, unit)
    base, unit = _base_and_unit(name, unit)
    named = bool(DRIVES & {*words(base), unit.lower()})
    named = named or (meant.quantity == "other" and unit in DRIVE_UNITS)
    return named and meant.quantity in ("measurement", "other")


def is_ambient(name: str) -> bool:
    """Whether a name is of what surrounds the plant, a disturbance rather than an output."""
    return any(w in AMBIENT or w.startswith(("aussen", "außen", "umgebung")) for w in words(name))


def is_battery(name: str) -> bool:
    """Whether a supply is a battery by its name: its voltage is never commanded."""
    return any(w in BATTERIES or w.startswith(("batter", "akku")) for w in words(name))


def ends_in_speed(name: str, meant: Meaning) -> bool:
    """Whether a command by its name is an actuator's speed: ``Fan speed``."""
    of_part = meant.quantity == "command" and meant.rank == ACTUATOR
    return of_part and _rank(words(without_unit(name))[-1:], SPEEDS) is not None


def names_speed(name: str) -> bool:
    """Whether a word of a name, and not only its unit, says that it is a speed."""
    return _rank(_with_pairs(words(without_unit(name))), SPEEDS) is not None


def leaves_a_source(name: str, unit: str = "") -> bool:
    """Whether "out" may be of what drives a plant: the voltage that an amplifier puts out."""
    unit = _base_and_unit(name, unit)[1]
    return unit in DRIVE_UNITS and meaning(name, unit) == Meaning("measurement", 0)


def turns_an_actuator(name: str, unit: str = "") -> bool:
    """Whether a speed is that of what an actuator's word names: ``Stirrer [rpm]``."""
    part = _rank(words(without_unit(name)), COMMANDS) == ACTUATOR
    return part and meaning(name, unit).quantity == "speed"


def has_result_unit(name: str, unit: str = "") -> bool:
    """Whether the unit is of what a sensor reads, whatever the name says: ``Sway (deg)``."""
    unit = _base_and_unit(name, unit)[1]
    return unit in RESULT_UNITS or unit in SPEED_UNITS or bool(_FLOW.fullmatch(unit))


def _without_axis(parts: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(w for w in parts if w != "y") if VECTORS & {*parts} else parts


def _with_pairs(parts: tuple[str, ...]) -> tuple[str, ...]:
    """Words, and neighbours that are one word together: YawRate, wheel_speed, pO2."""
    pairs = (a + b for a, b in pairwise(parts))
    return (*parts, *(pair for pair in pairs if pair in _KNOWN))


def _base_and_unit(name: str, unit: str) -> tuple[str, str]:
    """A name without its unit, and the unit: that behind it in the file, else its ending."""
    base, ended = ending(name)
    return base, synonym(unit) if unit else ended


def _rank(parts: tuple[str, ...], groups: tuple[tuple[str, ...], ...]) -> int | None:
    """The first group that has one of the words, or that a compound ends in: Motordrehzahl."""
    for i, group in enumerate(groups):
        long = tuple(word for word in group if len(word) >= COMPOUND)
        if any(word in group or (long and word.endswith(long)) for word in parts):
            return i
    return None


_KNOWN = frozenset(
    w for groups in (COMMANDS, SPEEDS, MEASUREMENTS) for group in groups for w in group
)
