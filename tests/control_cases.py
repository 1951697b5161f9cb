"""What tests of controllers share: a robot that follows references, and the inputs of one axis."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from mission_cases import SCENE

from sysid.data.record import Array
from sysid.robot.mission.axis import PUBLISHED, AxisInputs
from sysid.robot.mission.contracts import Body, Command, ControlInputs, Pose, References
from sysid.robot.mission.loop import plain_shaper
from sysid.runners import floats
from sysid.vehicle.kinematics import Geometry, body_velocity, step_pose


def pwm(command: Any) -> tuple[float, float]:
    """What the command module makes of a command [µs]."""
    return plain_shaper(command, Body(SCENE.start, 0.0, 0.0), 0.0, floats)[0]


def driven(
    law: Any, references: Sequence[tuple[float, float]], plant: Any, scene: Any = SCENE
) -> Array:
    """Speed, yaw and both commands while the references run, a row a period of 0.1 s."""
    state, x, pose = law.start(scene, floats), plant.initial_state(), (0.0, 0.0, 0.0)
    command, applied, rows = (0.0, 0.0), Command(0.0, 0.0), []
    for k, (speed, psi) in enumerate(references):
        y = plant.step(x, np.array(command))[1]
        v, yaw_rate = (float(m) for m in body_velocity(y[0], y[1], Geometry()))
        pose = step_pose(*pose, v, yaw_rate, 0.1)
        body = Body(Pose(*(float(p) for p in pose)), v, yaw_rate)
        asked = References(speed, psi, False)
        given = ControlInputs(0.1 * k, asked, body, scene, applied)
        state, decided = law.step(state, given, 0.1, floats)
        command, applied = plain_shaper(decided, body, 0.1 * k, floats)
        x = plant.step(x, np.array(command))[0]
        rows.append((v, body.pose.psi, *decided))
    return np.array(rows)


def inputs(error: float = 0.0, **more: float) -> AxisInputs:
    """At the thesis's robot, limits ±1."""
    given = AxisInputs(0.0, error, 0.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, PUBLISHED.speed)
    return given._replace(**more)
