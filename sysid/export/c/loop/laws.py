"""Parameters of a law, found and replaced one by one; units and words of struct members."""

import inspect
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from pydantic import BaseModel

from sysid.export.c.loop.trees import Path

SCHEDULE = ("period",)
"""Numbers that say when a step is called: they are the caller's."""


def numbers(law: Any, path: Path = ()) -> Iterator[tuple[Path, float]]:
    """The floats of a law and of the laws inside it, by their places."""
    for name, value in _fields(law):
        if type(value) is float and name not in SCHEDULE:
            yield (*path, name), value
        elif isinstance(value, BaseModel) or is_dataclass(value):
            yield from numbers(value, (*path, name))


def with_numbers(law: Any, given: Mapping[Path, Any], path: Path = ()) -> Any:
    """The same law with other numbers at these places, taken as they are."""
    changed: dict[str, Any] = {}
    for name, value in _fields(law):
        place = (*path, name)
        if place in given:
            changed[name] = given[place]
        elif isinstance(value, BaseModel) or is_dataclass(value):
            inner = with_numbers(value, given, place)
            if inner is not value:
                changed[name] = inner
    if not changed:
        return law
    if isinstance(law, BaseModel):
        return law.model_copy(update=changed)
    return replace(law, **changed)


def _fields(law: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(law, BaseModel):
        yield from ((name, getattr(law, name)) for name in type(law).model_fields)
    elif is_dataclass(law) and not isinstance(law, type):
        yield from ((f.name, getattr(law, f.name)) for f in fields(law))


_ATTRIBUTE = re.compile(r"(\w+(?:, \w+)*): (.+)")
_UNITS = re.compile(r"\s*\[([^\]]*)\]")


def documented(law: Any, path: Path) -> tuple[str, str]:
    """(unit, words) of a number, as the docstring of its class has them; empty where it has none.

    A docstring lists ``name, other: words [unit of the one, unit of the other].``
    """
    for name in path[:-1]:
        law = getattr(law, name, None)
    section = (inspect.getdoc(type(law)) or "").partition("Attributes:")[2]
    joined = re.sub(r"\n {5,}", " ", section)  # a line that goes on is indented further
    for line in joined.splitlines():
        match = _ATTRIBUTE.match(line.strip())
        names = match[1].split(", ") if match else []
        if match and path[-1] in names:
            units = _UNITS.search(match[2])
            several = units[1].partition(" is ")[0].split(", ") if units else [""]
            at = names.index(path[-1])
            single = len(several) != len(names) or (units and " is " in units[1])
            unit = several[0] if single else several[at]
            words = _UNITS.sub("", match[2]).partition(";")[0].strip(" .`")
            return _plain(unit), _plain(words)
    return "", ""


def _plain(text: str) -> str:
    """Text without marks of reStructuredText."""
    return re.sub(r":\w+:`[^`]*`|`", "", text)


_WORDS = {
    "t": ("s", "time since the start of the mission"),
    "dt": ("s", "time since the step before, 0 at the first one"),
    "x": ("m", "X in the inertial frame"),
    "y": ("m", "Y in the inertial frame"),
    "psi": ("rad", "yaw in (-pi, pi], counter-clockwise"),
    "speed": ("m/s", "forward speed"),
    "yaw_rate": ("rad/s", "yaw rate"),
    "omega_l": ("rad/s", "left wheel speed"),
    "omega_r": ("rad/s", "right wheel speed"),
    "drive_l": ("", "left command held since the step before, 1 is full drive"),
    "drive_r": ("", "right command held since the step before, 1 is full drive"),
    "reference_speed": ("m/s", "wanted forward speed"),
    "reference_psi": ("rad", "wanted yaw"),
    "arrived": ("", "1 where the goal is reached"),
    "gives_up": ("", "1 where guidance sees no way"),
    "hold": ("", "what keeps the robot from coming closer, a number"),
    "detour": ("", "1 while it is led away from the goal on purpose"),
    "v_cmd": ("", "speed command, 1 is full drive"),
    "psi_cmd": ("", "yaw command, 1 is full drive"),
    "applied_v_cmd": ("", "part of the last speed command that reached the tracks"),
    "applied_psi_cmd": ("", "part of the last yaw command that reached the tracks"),
    "pwm_l": ("us", "left pulse width, -20000 to 20000"),
    "pwm_r": ("us", "right pulse width, -20000 to 20000"),
    "goal_x": ("m", "X of the goal"),
    "goal_y": ("m", "Y of the goal"),
    "start_x": ("m", "X of the start"),
    "start_y": ("m", "Y of the start"),
    "start_psi": ("rad", "yaw at the start"),
    "tolerance": ("m", "the goal counts as reached within this distance"),
    "vehicle_r": ("m", "sprocket radius"),
    "vehicle_B": ("m", "distance of the track centre lines"),
}
_ENDINGS = (
    ("_x", "m", "X"),
    ("_y", "m", "Y"),
    ("_vx", "m/s", "velocity in X"),
    ("_vy", "m/s", "velocity in Y"),
    ("_psi", "rad", "yaw"),
    ("_speed", "m/s", "forward speed"),
    ("_yaw_rate", "rad/s", "yaw rate"),
    ("_radius", "m", "radius"),
)


def described(name: str) -> tuple[str, str]:
    """(unit, words) of a member; empty where its name says all that is known."""
    if name in _WORDS:
        return _WORDS[name]
    for ending, unit, words in _ENDINGS:
        if name.endswith(ending):
            return unit, f"{words} of {name.removesuffix(ending).replace('_', ' ')}"
    return "", ""
