"""``--control``: another controller for a mission, named in one word or one for each axis."""

from typing import Any

from pydantic import ValidationError

from sysid.errors import UsageError
from sysid.robot.mission.contracts import Controller
from sysid.robot.mission.control.axes import AXES, AxisController
from sysid.robot.mission.control.linear import PI, YawP
from sysid.robot.mission.control.pi_p import SpeedPIYawP
from sysid.robot.mission.registry import law
from sysid.robot.mission.settings import ControlSettings

FORM = "write a kind, as pid, or one for each axis, as speed=pid,yaw=pd"


def chosen_controller(text: str, present: Controller) -> Controller:
    """The controller that a choice names, with what the present one says of limits and period.

    Args:
        text: a kind, e.g. ``pid``, or one for an axis each, e.g. ``speed=pid,yaw=pd``; an axis
            that is not named keeps its law.
        present: the mission's; a law of it that is chosen again keeps its keys.
    """
    try:
        if "=" not in text:
            chosen = law("control", {"kind": text.strip()})
            if type(chosen) is type(present) and not isinstance(chosen, AxisController):
                return present
        else:
            chosen = law("control", {**_laws(present), **_named(text)})
    except ValidationError as error:
        raise UsageError(str(error.errors()[0]["msg"])) from None
    kept = _common(present, chosen)
    if isinstance(chosen, AxisController):
        before = _laws(present)
        for axis in AXES:
            if type(before.get(axis)) is type(getattr(chosen, axis)):
                kept[axis] = before[axis]
    controller: Controller = chosen.model_copy(update=kept)
    return controller


def _named(text: str) -> dict[str, Any]:
    """Sections of the axes that the text names."""
    named = {}
    for part in text.split(","):
        axis, _, kind = (word.strip() for word in part.partition("="))
        if axis not in AXES or not kind or axis in named:
            raise UsageError(f"--control {text}: {FORM}")
        named[axis] = {"kind": kind}
    return named


def _laws(present: Controller) -> dict[str, Any]:
    """The laws of a controller's axes, where it has such."""
    if isinstance(present, AxisController):
        return {axis: getattr(present, axis) for axis in AXES}
    if isinstance(present, SpeedPIYawP):
        speed = PI(kp=present.kp_speed, ki=present.ki_speed)
        return {"speed": speed, "yaw": YawP(kp=present.kp_yaw)}
    return {}


def _common(present: Controller, chosen: Any) -> dict[str, Any]:
    """What was said of the present controller as a whole and holds for the chosen one, too."""
    if not isinstance(present, ControlSettings):
        return {}
    axis_keys = AxisController.model_fields.keys() - {*AXES}
    said = axis_keys & present.model_fields_set & type(chosen).model_fields.keys()
    return {name: getattr(present, name) for name in said}
