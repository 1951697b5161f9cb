"""Numbers in a message by path: ``twist.twist.linear.x``, ``velocity[wheel_left]``, ``data[0]``.

A whole number in brackets counts from 0. A word picks the element that is called so: of a
JointState by its ``name``, of a MultiArray by the labels of its layout, of a list of messages by
their ``name``, ``child_frame_id`` or ``label``. Behind a quaternion stand ``yaw``, ``pitch`` and
``roll``, counted as REP-103 says: x forward, y left, z up, yaw counter-clockwise.
"""

import difflib
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from sysid.errors import UsageError

Step = str | int | tuple[str, str]
"""A field by name, an element by number, or a field and what its element is called."""

Reader = Callable[[Any], float]
"""Takes a number out of a message; NaN where this message does not hold it."""

MOST_ELEMENTS = 64
"""Longer arrays are images and scans; their elements are not listed one by one."""

QUATERNION = {"x", "y", "z", "w"}
POSES = ((), ("pose",), ("pose", "pose"), ("transform",))
"""Where a pose stands in the messages that hold one."""

_STEP = re.compile(r"\.?(?P<name>[A-Za-z_]\w*)|\[(?P<inside>[^\[\]]+)\]")
_NAMES = ("name", "child_frame_id", "label")


class NoSuchFieldError(Exception):
    """A path leads nowhere, or not to a number; the text is the end of a sentence."""


def steps_of(path: str) -> tuple[Step, ...]:
    """The steps of a path such as ``velocity[wheel_left]``; none for an empty one."""
    steps: list[Step] = []
    at = 0
    for match in _STEP.finditer(path):
        if match.start() != at:
            break
        at = match.end()
        inside = (match["inside"] or "").strip().strip("'\"")
        if match["name"]:
            steps.append(match["name"])
        elif inside.isdigit():
            steps.append(int(inside))
        elif steps and isinstance(steps[-1], str):
            steps[-1] = (steps[-1], inside)
        else:
            at = -1
            break
    if at != len(path):
        raise UsageError(
            f"the path {path!r} cannot be read; write fields and elements as in "
            "twist.twist.linear.x, data[0] or velocity[wheel_left]"
        )
    return tuple(steps)


def reader(message: Any, steps: Sequence[Step]) -> Reader:
    """What takes the number at the end of the steps out of messages like this one.

    Args:
        message: the first of its topic, on which the path is tried.
        steps: of the path; none, where the message is a single number.

    Raises:
        NoSuchFieldError: there is no such field, or it is no number.
    """
    steps = tuple(steps)
    if not steps:
        leaves = [path for path, _ in numbers(message)]
        if len(leaves) != 1:
            raise NoSuchFieldError(f"holds {len(leaves)} numbers{nearest('', leaves)}")
        steps = steps_of(leaves[0])
    to_number, inner = _turned(message, steps)
    try:
        value = _at(message, inner)
    except IndexError:  # another message may be longer, or have that name
        value = 0.0
    except LookupError:
        known = [path for path, _ in numbers(message)]
        raise NoSuchFieldError(f"has no {written(steps)}{nearest(written(steps), known)}") from None
    if to_number is float and not _is_number(value):
        raise NoSuchFieldError(f"holds {_kind(value)} in {written(steps)}, not a number")

    def take(other_message: Any) -> float:
        try:
            return to_number(_at(other_message, inner))
        except LookupError:
            return math.nan

    return take


def _turned(message: Any, steps: tuple[Step, ...]) -> tuple[Reader, tuple[Step, ...]]:
    """What makes a number of the value at the end of a path, and the path to that value."""
    angle = ANGLES.get(str(steps[-1]))
    if angle is not None:
        try:
            if _is_quaternion(_at(message, steps[:-1])):
                return angle, steps[:-1]
        except LookupError:
            pass
    return float, steps


def _at(message: Any, steps: Sequence[Step]) -> Any:
    """The value at the end of a path."""
    for step in steps:
        message = _step(message, step)
    return message


def pose_steps(message: Any, steps: Sequence[Step]) -> dict[str, tuple[Step, ...]]:
    """Where x, y and the heading ψ of the pose at a place of a message stand.

    Raises:
        NoSuchFieldError: there is none.
    """
    for more in POSES:
        place = (*steps, *more)
        try:
            value = _at(message, place)
        except LookupError:
            continue
        if all(hasattr(value, n) for n in ("x", "y", "theta")):
            return {"x": (*place, "x"), "y": (*place, "y"), "psi": (*place, "theta")}
        for where, turn in (("position", "orientation"), ("translation", "rotation")):
            if hasattr(value, where) and hasattr(value, turn):
                at = (*place, where)
                return {"x": (*at, "x"), "y": (*at, "y"), "psi": (*place, turn, "yaw")}
    raise NoSuchFieldError("holds no pose (a position with an orientation)")


def numbers(message: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Every number of a message by its path; covariances, headers and long arrays left out."""
    if _is_number(message):
        yield path, float(message)
    elif _is_quaternion(message) and path:
        yield f"{path}.yaw", _yaw(message)
    elif hasattr(message, "__dataclass_fields__"):
        for name in message.__dataclass_fields__:
            if name.startswith("__") or name in ("header", "layout") or "covariance" in name:
                continue
            below = f"{path}.{name}" if path else name
            value = getattr(message, name)
            if not _is_array(value):
                yield from numbers(value, below)
            elif len(value) <= MOST_ELEMENTS:
                for label, item in zip(_element_names(message, value), value, strict=True):
                    yield from numbers(item, f"{below}[{label}]")


def _element_names(message: Any, values: Any) -> list[str]:
    """What to write in brackets for the elements of an array of a message."""
    labels = _labels(message)
    if len(labels) != len(values):
        labels = [_own_name(item) for item in values]
    return [label or str(k) for k, label in enumerate(labels)]


def written(steps: Sequence[Step]) -> str:
    """The steps as one types them."""
    text = ""
    for step in steps:
        if isinstance(step, str):
            text += f".{step}" if text else step
        else:
            text += f"[{step if isinstance(step, int) else step[0]}]"
    return text


def nearest(wrong: str, known: Sequence[str], count: int = 3) -> str:
    """The known names most like a wrong one, else the first ones, as the end of a sentence."""
    near = difflib.get_close_matches(wrong, known, n=count, cutoff=0.5) or list(known)[:count]
    return f"; the nearest {'is' if len(near) == 1 else 'are'} {', '.join(near)}" if near else ""


def si_unit(kind: str, steps: Sequence[Step]) -> str:
    """The unit that ROS prescribes for a number (REP-103), empty where it prescribes none.

    Args:
        kind: type of the message, ``sensor_msgs/msg/JointState``.
    """
    words = [s for s in steps if isinstance(s, str)]
    if not words:
        return ""
    if words[-1] in (*ANGLES, "theta"):
        return "rad"
    if kind.endswith("/JointState"):
        return {"position": "rad", "velocity": "rad/s"}.get(words[0], "")
    owner = words[-2] if len(words) > 1 else ""
    if owner == "linear" and "accel" in (*words, kind.rpartition("/")[2][:5].lower()):
        return "m/s^2"
    units = {
        "linear": "m/s",
        "angular": "rad/s",
        "angular_velocity": "rad/s",
        "linear_acceleration": "m/s^2",
        "position": "m",
        "translation": "m",
        "force": "N",
        "torque": "Nm",
    }
    return units.get(owner, "") if words[-1] in ("x", "y", "z") else ""


def _step(value: Any, step: Step) -> Any:
    if isinstance(step, int):
        if not _is_array(value):
            raise LookupError(step)
        return value[step]
    name = step if isinstance(step, str) else step[0]
    if name not in getattr(value, "__dataclass_fields__", ()):
        raise LookupError(name)
    element = getattr(value, name)
    if isinstance(step, str):
        return element
    if not _is_array(element):
        raise LookupError(step[1])
    labels = _labels(value) or [_own_name(item) for item in element]
    if step[1] not in labels[: len(element)]:
        raise (IndexError if not labels else LookupError)(step[1])
    return element[labels.index(step[1])]


def _labels(message: Any) -> list[str]:
    """What the elements of a message's arrays are called: joints, labels of a layout."""
    names = getattr(message, "name", None)
    if isinstance(names, list) and all(isinstance(n, str) for n in names):
        return names
    layout = getattr(message, "layout", None)
    return [d.label for d in getattr(layout, "dim", ())] if layout is not None else []


def _own_name(item: Any) -> str:
    return next((str(getattr(item, n)) for n in _NAMES if hasattr(item, n)), "")


def _is_number(value: Any) -> bool:
    return isinstance(value, bool | int | float | np.number | np.bool_)


def _is_array(value: Any) -> bool:
    return isinstance(value, list | np.ndarray)


def _is_quaternion(value: Any) -> bool:
    return set(getattr(value, "__dataclass_fields__", ())) - {"__msgtype__"} == QUATERNION


def _kind(value: Any) -> str:
    """What a value is, for a sentence."""
    if isinstance(value, str):
        return "a text"
    if _is_array(value):
        return f"{len(value)} elements (choose one with [0])"
    names = [n for n in getattr(value, "__dataclass_fields__", ()) if not n.startswith("__")]
    return f"a message of {', '.join(names)}" if names else f"a {type(value).__name__}"


def _yaw(q: Any) -> float:
    """ψ = atan2(2 (wz + xy), 1 − 2 (y² + z²)) [rad]; NaN for a quaternion of zeros."""
    if not (q.w or q.x or q.y or q.z):
        return math.nan
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))


ANGLES: Mapping[str, Reader] = {
    "yaw": _yaw,
    "pitch": lambda q: math.asin(max(-1.0, min(1.0, 2.0 * (q.w * q.y - q.z * q.x)))),
    "roll": lambda q: math.atan2(
        2.0 * (q.w * q.x + q.y * q.z), 1.0 - 2.0 * (q.x * q.x + q.y * q.y)
    ),
}
"""Angles of a quaternion [rad], by what stands behind its path."""
