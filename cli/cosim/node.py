"""``sysid node``: the exported plant as the robot of a mission, for a node that guides it."""

from pathlib import Path

from sysid.workspace.store import Workspace

from .. import reading, render, targets
from ..mission_options import accept_changes as changes_accepted
from ..missions.guided import facts_of
from ..missions.law_options import LawChoice
from ..missions.ros_options import Topic
from ..missions.simulate import load_plant, show_drive
from ..options import argument, command, flag, group, option


@command
def node(
    mission: Path = argument("MISSION", "Vehicle, start, sensors, controller (YAML)."),
    plant: Path | None = option("PATH", "Plant package, folder or zip [WORKSPACE/plant]."),
    lock_step: bool = flag(
        "Wait for the answer to every odometry message, which repeats the run of one process."
    ),
    speed: float = option(
        "N", "Mission seconds per real second, without --lock-step.", "--pace", default=1.0
    ),
    seed: int = option("N", "Of the sensors' noise.", default=0, min=0),
    plot: Path | None = targets.picture("Draw the result: .svg or .png."),
    output: Path | None = targets.target(
        "FILE", "CSV to write [WORKSPACE/missions/NAME_node.csv]."
    ),
    accept_changes: bool = changes_accepted(),
    laws: LawChoice = group(LawChoice),
    over: Topic = group(Topic),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Play the robot as a node of ROS 1, with the exported plant.

    It publishes /clock and /odom, and is driven by references of speed and heading, which `sysid
    simulate MISSION --ros`, Simulink or a node of your own publishes. The mission says what the
    vehicle is and where it starts.
    """
    from sysid.cosim.robot import Pace, play_robot
    from sysid.robot.mission.spec import load_mission
    from sysid.robot.mission.tracks.mapping import as_robot

    pace = Pace(lock_step=lock_step, speed=speed)
    place = Workspace(workspace)
    package = load_plant(place, plant, accept_changes)
    driven = laws.applied(load_mission(mission))
    robot, notes = as_robot(package.plant(), driven)

    from sysid.cosim.ros.ports import robot_node

    with (
        render.progress(f"Playing the robot of {mission.name} over ROS"),
        robot_node(*over.port) as port,
    ):
        result = play_robot(driven, robot, port, pace, over.cut, seed=seed)
    target = output or place.missions_dir / f"{mission.stem}_node.csv"
    facts = facts_of(mission, driven, result, (target, plot, None), seed)
    facts["warnings"] = [*package.notes, *notes]
    if json:
        render.document(facts)
        return
    show_drive(mission.name, facts)
