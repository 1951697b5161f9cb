"""The closed loop of a mission around a model's plant, as it is exported."""

from sysid.robot.mission.loop import Loop
from sysid.robot.mission.simulator import closed_loop, scene_of, shaper_of
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.runners import floats
from sysid.structures.model import Model


def loop_of(model: Model, mission: Mission) -> Loop:
    """The loop that ``simulate`` would run.

    Raises:
        ModelError: the plant drives no robot, or lacks what a law needs.
    """
    robot, _ = as_robot(model.plant(), mission)
    scene, drive = scene_of(mission, robot), shaper_of(mission, robot)
    return closed_loop(mission, robot, scene, floats, drive)
