"""A vehicle that turns and stops on its way, and what a sensor on it reads."""

import itertools
import math
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.robot.mission.contracts import Body, Pose, Scene, Sensor, SensorInputs
from sysid.robot.mission.loop import ticks
from sysid.robot.mission.motion.kinematic import moved
from sysid.robot.mission.noise import generator
from sysid.robot.mission.spec import Mission
from sysid.runners import floats
from sysid.vehicle.kinematics import Geometry

SCENE = Mission(goal=(9.0, 9.0)).scene()


def way(samples: int, dt: float = 0.1) -> list[tuple[float, Body, float, float]]:
    """Time, truth and wheel speeds of a winding way."""
    body, found = Body(Pose(0.0, 0.0, 0.0), 0.0, 0.0), []
    for tick in itertools.islice(ticks(dt, 1e9), samples):
        left = 7.0 * math.sin(0.31 * tick.t) ** 2
        right = 7.0 * math.sin(0.31 * tick.t + 0.2 * math.sin(0.07 * tick.t)) ** 2
        body = moved(body, left, right, Geometry(), tick.dt, floats)
        found.append((tick.t, body, left, right))
    return found


def measurements(
    sensor: Sensor, samples: int, dt: float = 0.1, seed: int = 0, name: str = "it"
) -> dict[str, Array]:
    """What a sensor reads on the way, by name, with the columns of the truth."""
    scene: Scene = SCENE._replace(dt=dt)
    draws = generator(seed, name).standard_normal((samples, sensor.draws)).tolist()
    state, rows = sensor.start(scene, floats), []
    truth = way(samples, dt)
    for (t, body, left, right), numbers in zip(truth, draws, strict=True):
        inputs = SensorInputs(t, body, left, right, numbers, scene)
        state, values = sensor.step(state, inputs, dt if rows else 0.0, floats)
        rows.append(values)
    columns: dict[str, Any] = dict(zip(sensor.names, zip(*rows, strict=True), strict=True))
    columns["t"] = [t for t, *_ in truth]
    for i, column in enumerate(("x", "y", "psi")):
        columns[column] = [body.pose[i] for _, body, *_ in truth]
    columns["v"] = [body.speed for _, body, *_ in truth]
    columns["yaw_rate"] = [body.yaw_rate for _, body, *_ in truth]
    return {key: np.array(column, dtype=float) for key, column in columns.items()}
