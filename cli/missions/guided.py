"""``sysid simulate MISSION --ros``: the node that guides."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import render, targets
from .ros_options import OverRos

if TYPE_CHECKING:
    from sysid.plant.package import Package
    from sysid.robot.mission.result import MissionResult
    from sysid.robot.mission.spec import Mission


def guide_over_ros(
    path: Path, mission: "Mission", package: "Package", over: OverRos
) -> "tuple[MissionResult, tuple[str, ...]]":
    """Guide the robot of ``/odom``; what it came to, and what was assumed of a plant."""
    from sysid.cosim.guiding import guide
    from sysid.cosim.ros.ports import guidance_node
    from sysid.robot.mission.tracks.mapping import as_robot

    known, notes = as_robot(package.plant(), mission)
    with (
        render.progress(f"Guiding {path.name} over ROS"),
        guidance_node(*over.port) as port,
    ):
        return guide(mission, port, over.cut, known), notes


def facts_of(
    path: Path,
    mission: "Mission",
    result: "MissionResult",
    files: tuple[Path, Path | None, Path | None],
    seed: int,
) -> dict[str, Any]:
    """Log, picture and bag written; the facts of a mission as ``sysid simulate`` gives them."""
    from sysid.robot.mission.result import write_log

    log, plot, bag = files
    targets.make_folder(log, "-o")
    facts = result.summary() | {"seed": seed, "log": write_log(result, log)}
    if bag is not None:
        from sysid.data.bags.writing import write_drive

        facts["bag"] = write_drive(result.log, bag)
    if plot is not None:
        from sysid.report.missions.drives import draw_mission

        draw_mission(plot, path.stem, mission, result)
        facts["plot"] = plot
    return facts
