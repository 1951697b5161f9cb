"""Options that replace the laws of a mission, declared once for all commands."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.errors import UsageError

if TYPE_CHECKING:
    from sysid.robot.mission.spec import Mission

_PANEL = "Laws instead of the mission's"


@dataclass(frozen=True)
class LawChoice:
    """Kinds of laws instead of a mission's; None leaves its own.

    Attributes:
        control: a kind, or one for each axis, as ``speed=pid,yaw=pd``.
    """

    guidance: str | None = None
    control: str | None = None
    navigation: str | None = None
    motion: str | None = None

    def __bool__(self) -> bool:
        return self != LawChoice()

    def applied(self, mission: "Mission") -> "Mission":
        """The mission with these laws; one that it has already keeps its keys.

        Raises:
            UsageError: there is no such kind.
        """
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


Navigation = Annotated[
    str | None,
    typer.Option(metavar="KIND", rich_help_panel=_PANEL, help="Navigation, e.g. odometry."),
]
Guidance = Annotated[
    str | None, typer.Option(metavar="KIND", rich_help_panel=_PANEL, help="Guidance, e.g. field.")
]


def law_choice(
    guidance: Guidance = None,
    control: Annotated[
        str | None,
        typer.Option(
            metavar="KIND",
            rich_help_panel=_PANEL,
            help="Controller, e.g. pid, or one for each axis: speed=KIND,yaw=KIND.",
        ),
    ] = None,
    navigation: Navigation = None,
    motion: Annotated[
        str | None,
        typer.Option(metavar="KIND", rich_help_panel=_PANEL, help="Motion, e.g. kinematic."),
    ] = None,
) -> LawChoice:
    """The laws as every option of it says."""
    return LawChoice(guidance, control, navigation, motion)


def refuse_for_log(choice: LawChoice, log: object) -> None:
    """A log is replayed without laws.

    Raises:
        UsageError: one was named.
    """
    for role in ("guidance", "control", "navigation", "motion"):
        if getattr(choice, role) is not None:
            raise UsageError(f"{log} is a log to replay; omit --{role}")
