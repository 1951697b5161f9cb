"""The three robots of the thesis as far as they can be had: model, Gazebo, the robot itself."""

from functools import cache

import numpy as np
import sysid_datasets
from sysid_datasets.twin import AT_REST, DEVASTATOR, SAMPLE_TIME, Twin, advance

import sysid
from sysid.data.record import Array, Channel, Record
from sysid.effects.ground import Ground
from sysid.robot.mission.contracts import ROBOT_INPUTS, ROBOT_OUTPUTS, SteppablePlant
from sysid.robot.mission.result import MissionResult
from sysid.robot.mission.simulator import simulate
from sysid.robot.mission.spec import Mission
from sysid.robot.mission.tracks.mapping import as_robot
from sysid.structures.model import Model
from sysid.testbench.motor.model import bench_model
from thesis.bench_motor import bench

ORDERS = "na=1 nb=1 nk=1"
"""Each track by its own last speed and both last commands: na = I, nb = nk = ones (5.5)."""

SYMMETRIC = Twin(voltage_gain=(1.0, 1.0))
"""The twin with two equal tracks, in place of the model in Gazebo: 1.5 kg and no imperfection."""


MASS, FRICTION = 1.5, 0.1
"""Mass of the robot [kg] and friction of its tracks in Gazebo (8.2)."""

EXACT = 1e-4
"""Noise of readings that stand for the true pose: no filter takes none [m/√Hz, rad/√Hz]."""


def bundled(log: str) -> Record:
    """A bundled log."""
    return sysid.read_log(sysid_datasets.path(log))


@cache
def published_model(orders: str = ORDERS) -> Model:
    """The structure that the thesis accepted, a NARX wavelet network, from ``multilevel``."""
    return sysid.fit(bundled("multilevel"), "narx-wavelet", orders)


class TwinRobot:
    """A twin that missions drive as they drive any plant; its state is that of the truth."""

    dt = SAMPLE_TIME
    inputs: tuple[Channel, ...] = ROBOT_INPUTS
    outputs: tuple[Channel, ...] = ROBOT_OUTPUTS
    input_range: tuple[tuple[float, float], ...] = ((-20000.0, 20000.0),) * 2
    ground = Ground()

    def __init__(self, twin: Twin) -> None:
        self.twin = twin
        self.u_offset = np.zeros(2)

    def initial_state(self) -> Array:
        """At rest in the origin."""
        return np.array(AT_REST)

    def step(self, state: Array, u: Array) -> tuple[Array, Array]:
        """The next state and the track speeds before it."""
        start = (state[0], state[1], state[2], state[3], state[4])
        return np.array(advance(start, u.tolist(), twin=self.twin)), state[:2].copy()


def simulink(mission: Mission) -> MissionResult:
    """A mission with the identified model."""
    return simulate(mission, as_robot(published_model().plant(), mission)[0])


def gazebo(mission: Mission) -> MissionResult:
    """A mission with the symmetric twin."""
    return driven(mission, TwinRobot(SYMMETRIC))


def gazebo_by_forces(mission: Mission) -> MissionResult:
    """A mission with the mass and the friction that the thesis gives Gazebo (8.2), by forces.

    The motors are those of the bench, the floor is rigid, and the pose is known as in Gazebo.
    """
    own = mission.model_dump(include={"goal", "start"})
    own["obstacles"] = [(o.x, o.y, o.radius) for o in mission.obstacles]
    floor = {
        "preset": "concrete",
        "friction_angle": float(np.arctan(FRICTION)),
        "lateral": FRICTION,
    }
    own["vehicle"] = {
        "motion": "dynamic",
        "soil": floor,
        "mass": MASS,
        "command_scale": DEVASTATOR.supply,
        "lifted": True,
    }
    own["navigation"] = {"kind": "ekf"}
    own["sensors"] = {
        "encoders": {},
        "gyroscope": {"bias_std": 0.0},
        "position_fixes": {"noise": EXACT},
        "visual_odometry": {"noise": EXACT},
    }
    model = bench_model(bench())
    assert model is not None
    complete = Mission.model_validate(own)
    return simulate(complete, as_robot(model.plant(), complete)[0])


def driven(mission: Mission, plant: SteppablePlant, seed: int = 0) -> MissionResult:
    """A mission with a plant that speaks µs and rad/s."""
    return simulate(mission, plant, seed)


def robot(mission: Mission, seed: int) -> MissionResult:
    """A mission with the twin itself, seen through its sensors."""
    return driven(mission, TwinRobot(DEVASTATOR), seed)
