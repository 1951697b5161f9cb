"""Options that replace the laws of a mission, declared once for all commands."""

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError

from ..options import changed, in_panel

if TYPE_CHECKING:
    from sysid.robot.mission.spec import Mission

_law_option = in_panel("Laws instead of the mission's", advanced=True)
NAVIGATION = partial(_law_option, "KIND", "Navigation, e.g. odometry.")
GUIDANCE = partial(_law_option, "KIND", "Guidance, e.g. field.")


@dataclass(frozen=True)
class LawChoice:
    """Kinds of laws instead of a mission's; None leaves its own.

    Attributes:
        control: a kind, or one for each axis, as ``speed=pid,yaw=pd``.
    """

    guidance: str | None = GUIDANCE()
    control: str | None = _law_option(
        "KIND", "Controller, e.g. pid, or one for each axis: speed=KIND,yaw=KIND."
    )
    navigation: str | None = NAVIGATION()
    motion: str | None = _law_option("KIND", "Motion, e.g. kinematic.")

    def refuse_for_log(self, log: object) -> None:
        """A log is replayed without laws."""
        for role in changed(self):
            raise UsageError(f"{log} is a log to replay; omit --{role}")

    def applied(self, mission: "Mission") -> "Mission":
        """The mission with these laws; one that it has already keeps its keys."""
        changed: dict[str, Any] = {}
        for role in ("guidance", "navigation", "motion"):
            kind = getattr(self, role)
            if kind is not None:
                changed[role] = _law(role, kind, getattr(mission, role))
        if self.control is not None:
            from .control_option import chosen_controller

            changed["control"] = chosen_controller(self.control, mission.control)
        return mission.model_copy(update=changed) if changed else mission


def _law(role: str, kind: str, present: Any) -> Any:
    """The law of a kind with its default keys, or the present one where that is of the kind."""
    from sysid.robot.mission.registry import law, law_class

    cls = law_class(role, kind.strip())
    return present if type(present) is cls else law(role, {"kind": kind.strip()})
