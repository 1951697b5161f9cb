"""The sensors of a navigation law: those of the file, or the simplest suitable ones."""

from collections.abc import Mapping
from typing import Any

from sysid.errors import ModelError
from sysid.robot.mission.contracts import Navigation, Sensor
from sysid.robot.mission.registry import law_class


def equipped(navigation: Navigation, sensors: Mapping[str, Sensor]) -> Mapping[str, Sensor]:
    """The sensors listed, or those a law takes where none is listed, with their default figures."""
    missing = lacking(navigation, sensors)
    if missing:
        raise ModelError(missing)
    if sensors:
        return sensors
    made: Any = {kind: law_class("sensors", kind)() for kind in _default_sensors(navigation)}
    return dict(made)


def lacking(navigation: Navigation, sensors: Mapping[str, Sensor]) -> str:
    """A sentence about sensors that a law needs and the list lacks; empty where it has all."""
    missing = [kind for kind in getattr(navigation, "needs", ()) if kind not in sensors]
    if not sensors or not missing:
        return ""
    return (
        f"navigation reads {_listed(getattr(navigation, 'needs', ()))} and sensors has no "
        f"{' and no '.join(missing)}: add {_listed(missing)} to sensors, or choose another kind of "
        "navigation"
    )


def assumed(navigation: Navigation, sensors: Mapping[str, Sensor], dt: float) -> tuple[str, ...]:
    """A sentence for each thing about the sensors that a law takes for granted or leaves out.

    Args:
        dt: sample time of the plant [s].
    """
    said = []
    if not sensors and _default_sensors(navigation):
        said.append(
            f"no sensors are listed: navigation reads {_listed(_default_sensors(navigation))} with "
            "default values of a small robot; list sensors to change them"
        )
    layout = getattr(navigation, "layout", None)
    if layout is None:
        return tuple(said)
    plan = layout(equipped(navigation, sensors), dt)
    if plan.too_late:
        said.append(
            f"what {_listed(plan.too_late)} reads comes later than navigation.buffer = "
            f"{getattr(navigation, 'buffer', 0)} samples and is discarded; raise the buffer or "
            "shorten the latency"
        )
    if plan.unknown:
        said.append(f"navigation has no model of {_listed(plan.unknown)} and leaves it out")
    if plan.unread:
        said.append(
            f"navigation.r gives a variance of {_listed(plan.unread)}, which no sensor reads"
        )
    return tuple(said)


def _default_sensors(navigation: Navigation) -> tuple[str, ...]:
    law: Any = navigation
    kinds: tuple[str, ...] = getattr(law, "default_sensors", getattr(law, "needs", ()))
    return kinds


def _listed(names: Any) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last
