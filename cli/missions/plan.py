"""``sysid plan``: the references of a mission's guidance, without a plant."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.workspace.store import Workspace

from .. import reading, render, targets
from ..command_help import Command
from ..options import argument, command, option
from .law_options import GUIDANCE, LawChoice

if TYPE_CHECKING:
    from sysid.robot.mission.plan import Plan
    from sysid.robot.mission.spec import Mission

_IN_WORKSPACE = Path("-")
"""What ``--plot`` without a file stands for: the picture goes beside the missions' logs."""


class PlotMayStandAlone(Command):
    """A command whose ``--plot`` may come without a file."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the place in the workspace behind a ``--plot`` that ends the line or an option."""
        filled: list[str] = []
        for k, word in enumerate(args):
            filled.append(word)
            following = args[k + 1] if k + 1 < len(args) else "--"
            if word in ("-p", "--plot") and following.startswith("-"):
                filled.append(str(_IN_WORKSPACE))
        return super().parse_args(ctx, filled)


@command
def plan(
    mission: Path = argument("MISSION", "A mission (YAML)."),
    plot: Path | None = option(
        "[FILE]",
        "Draw field lines, potential, forces and speeds: .svg or .png "
        "[WORKSPACE/missions/NAME_plan.svg].",
        "-p",
        "--plot",
    ),
    guidance: str | None = GUIDANCE(),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Show where a mission's guidance leads, without a plant."""
    if plot is not None and plot != _IN_WORKSPACE:
        targets.check_picture(plot)
    from sysid.robot.mission.plan import plan as follow
    from sysid.robot.mission.registry import kind_of
    from sysid.robot.mission.spec import load_mission

    given = LawChoice(guidance).applied(load_mission(mission))
    with render.progress(f"Following {mission.name}"):
        route = follow(given)
    facts: dict[str, Any] = {"guidance": kind_of("guidance", given.guidance), **route.summary()}
    facts["sentence"] = _sentence(given, route)
    if plot == _IN_WORKSPACE:
        plot = Workspace(workspace).missions_dir / f"{mission.stem}_plan.svg"
        targets.make_folder(plot, "--plot")
    if plot is not None:
        from sysid.report.missions.drives import draw_plan

        draw_plan(plot, mission.stem, given, route)
        facts["plot"] = plot
    if json:
        render.document(facts)
    else:
        _show(mission.stem, facts)


def _sentence(mission: "Mission", route: "Plan") -> str:
    """Where the way leads, in words."""
    x, y = route.way[-1]
    if not route.arrives:
        return (
            f"The references lead from the start to ({x:.2f}, {y:.2f}) and no farther, because of "
            "a local minimum, a blocked way or a circle. Choose another law of guidance or an "
            "escape."
        )
    if route.min_clearance_m is not None and route.min_clearance_m <= 0:
        return "The references lead to the goal, but through an obstacle."
    share = route.arriving_share
    if share < 1:
        return (
            f"The references lead from the start to the goal; from {share:.0%} of the places "
            "around they do."
        )
    return "The references lead to the goal, from the start and from everywhere around."


def _show(name: str, facts: dict[str, Any]) -> None:
    way = facts["way"]
    rows = [
        ("arrives", "yes" if way["arrives"] else "no"),
        ("length of the way [m]", render.number(way["length_m"], 4)),
        ("time at the references [s]", render.number(way["time_s"], 4)),
        ("nearest obstacle [m]", render.number(way["min_clearance_m"], 3)),
        ("places around that lead to the goal [%]", f"{100 * facts['arriving_share']:.0f}"),
    ]
    rows += [
        ("another end at x, y [m]", f"{end['x']:.2f}, {end['y']:.2f}")
        for end in facts["ends_besides_goal"]
    ]
    render.table((name, ""), rows)
    render.say(facts["sentence"])
    if "plot" in facts:
        render.say(f"Picture: {facts['plot']}")
