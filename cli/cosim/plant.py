"""``sysid plant``: the exported plant as the robot of a mission, for a node that guides it."""

from pathlib import Path
from typing import Annotated

import typer

from sysid.errors import UsageError
from sysid.workspace.store import Workspace

from .. import reading, render, targets
from ..mission_options import AcceptChanges
from ..missions.guided import facts_of
from ..missions.law_options import LawChoice, law_choice
from ..missions.ros_options import OverRos, over_ros
from ..missions.simulate import load_plant, show_drive


@reading.composed(laws=law_choice, over=over_ros)
def plant(
    mission: Annotated[
        Path, typer.Argument(metavar="MISSION", help="Vehicle, start, sensors, controller (YAML).")
    ],
    plant: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Plant package, folder or zip [WORKSPACE/plant]."),
    ] = None,
    lock_step: Annotated[
        bool,
        typer.Option(
            "--lock-step",
            help="Wait for the answer to every odometry message, which repeats the run of one "
            "process.",
        ),
    ] = False,
    speed: Annotated[
        float,
        typer.Option(metavar="N", help="Mission seconds per real second, without --lock-step."),
    ] = 1.0,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Of the sensors' noise.")] = 0,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the result: .svg or .png.")
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="CSV to write [WORKSPACE/missions/NAME_plant.csv]."),
    ] = None,
    accept_changes: AcceptChanges = False,
    *,
    laws: LawChoice,
    over: OverRos,
    workspace: reading.WorkspaceRoot = reading.DEFAULT_WORKSPACE,
    json: reading.Json = False,
) -> None:
    """Play the robot: the exported plant as a node that publishes /clock and /odom.

    It is driven by references of speed and heading, which `sysid simulate MISSION --ros`, Simulink
    or a node of your own publishes. The mission says what the vehicle is and where it starts.
    """
    from sysid.cosim.robot import Pace, play_robot
    from sysid.robot.mission.spec import load_mission
    from sysid.robot.mission.tracks.mapping import as_robot

    targets.check_picture(plot)
    if log is not None:
        targets.check(log, "--log")
    if not over.ros:
        raise UsageError("sysid plant plays the robot for another node; add --ros")
    pace = Pace(lock_step=lock_step, speed=speed)
    place = Workspace(workspace)
    package = load_plant(place, plant, accept_changes)
    driven = laws.applied(load_mission(mission))
    robot, notes = as_robot(package.plant(), driven)

    from sysid.cosim.ros.ports import robot_node

    with (
        render.progress(f"Playing the robot of {mission.name} over ROS"),
        robot_node(over.topic, over.wait) as port,
    ):
        result = play_robot(driven, robot, port, pace, over.cut, seed=seed)
    target = log or place.missions_dir / f"{mission.stem}_plant.csv"
    facts = facts_of(mission, driven, result, (target, plot, None), seed)
    facts["warnings"] = [*package.notes, *notes]
    if json:
        render.document(facts)
        return
    show_drive(mission.name, facts)
