"""Motion by MuJoCo: the vehicle on its wheels, contact by contact."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field, PlainValidator, model_validator

from sysid.cosim.multibody.engine import Engine, engine
from sysid.cosim.multibody.machine import Machine
from sysid.data.record import Array
from sysid.data.yaml_files.problems import sentence_at
from sysid.data.yaml_files.source import shown
from sysid.errors import ModelError
from sysid.robot.mission.contracts import Body, MotionInputs, Scene
from sysid.robot.mission.settings import Positive
from sysid.robot.mission.vehicle_spec import Physics
from sysid.vehicle.kinematics import Real
from sysid.vehicle.wheels.mjcf_parts import ROAD_WHEELS, STEP

STAND_IN = Machine()

MOST_WHEELS = 20
"""Of a track; more of them only take longer."""


def _pairs(value: Any) -> int:
    """Wheels in pairs, so that none stands in the middle, where it would carry and not scrub."""
    number = type(value) in (int, float) and value in range(2, MOST_WHEELS + 1, 2)
    if not number:
        raise ValueError(
            f"wheels is {shown(value)}: write an even number from 2 to {MOST_WHEELS}, of each track"
        )
    return int(value)


class MultibodyState(NamedTuple):
    """What the engine goes on from.

    Attributes:
        omega: speeds of the wheels at the last sample [rad/s].
        lateral: speed to the left [m/s].
        touching: contacts with what stands around.
    """

    vector: Array
    omega: tuple[Real, Real]
    lateral: Real
    touching: Real


class Multibody(Physics):
    """The vehicle is a box on two rows of wheels on a rigid floor, in MuJoCo.

    The plant turns the wheels: an identified plant gives the track speeds under the load that it
    was identified with, so that servos hold its speeds, between two samples on a straight line,
    whatever friction says. What the wheels then do to the floor is the engine's.

    Attributes:
        friction: between wheels and floor.
        size: length, width and height of the box [m].
        part: longest part of a sample that the engine computes in one step [s].
    """

    friction: Annotated[float, Field(ge=0.01, le=2)] = STAND_IN.friction
    size: Annotated[tuple[Positive, Positive, Positive], Field(strict=False)] = STAND_IN.size
    wheels: Annotated[int, PlainValidator(_pairs)] = ROAD_WHEELS
    part: Annotated[float, Field(ge=1e-4, le=0.002)] = STEP

    @model_validator(mode="after")
    def _rigid_floor(self) -> "Multibody":
        """The engine's floor is level and hard."""
        for key in ("soil", "patches", "slope", "track_width"):
            if getattr(self, key) is not None:
                raise sentence_at(
                    (key,),
                    f"motion of kind multibody needs a level, hard floor and ignores {key}; give "
                    "friction, or choose motion of kind dynamic",
                )
        return self

    @property
    def wanted(self) -> tuple[str, ...]:
        """Which numbers of the vehicle it takes."""
        return ("mass", "yaw_inertia", "L")

    def completed(self, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """The given keys of the vehicle, else those of the thesis's simulation as a solid box."""
        mass = given.get("mass", STAND_IN.mass)
        stand_in = replace(STAND_IN, mass=mass, size=self.size, wheels=self.wheels)
        known = {"mass": mass, "yaw_inertia": stand_in.moment, "height": stand_in.height}
        return {**known, **given}

    @property
    def columns(self) -> tuple[str, ...]:
        """Speed to the left [m/s]; how many contacts there are with obstacles and walls."""
        return ("v_y", "touching")

    def report(self, state: MultibodyState, xp: Any) -> tuple[Real, ...]:
        return (state.lateral, state.touching)

    def start(self, scene: Scene, xp: Any) -> MultibodyState:
        return MultibodyState(self._engine(scene).start, (0.0, 0.0), 0.0, 0)

    def step(
        self, state: MultibodyState, inputs: MotionInputs, dt: Real, xp: Any
    ) -> tuple[MultibodyState, Body]:
        """The vehicle ``dt`` seconds later, its wheels brought from their old speeds to the new."""
        scene = inputs.scene
        if not isinstance(inputs.t, int | float):
            raise ModelError(
                "motion of kind multibody uses MuJoCo, which runs one mission at a time"
            )
        mujoco = self._engine(scene)
        steps = self._steps(scene.dt) if dt else 0
        passed = (np.arange(steps) + 1.0)[:, None] / max(steps, 1)
        before, now = (np.array(pair) for pair in (state.omega, (inputs.omega_l, inputs.omega_r)))
        controls = before + passed * (now - before)
        vector, body, touching = mujoco.advance(state.vector, controls, inputs.t)
        return MultibodyState(vector, (*now.tolist(),), body.lateral, touching), body

    def _steps(self, dt: float) -> int:
        """Steps of the engine between two samples."""
        return math.ceil(dt / self.part * (1.0 - 1e-9))

    def _engine(self, scene: Scene) -> Engine:
        car = scene.car
        assert car is not None
        machine = replace(
            STAND_IN,
            mass=car.mass,
            yaw_inertia=car.yaw_inertia,
            r=scene.geometry.r,
            B=scene.geometry.B,
            L=car.contact_length,
            size=self.size,
            height=car.height,
            centre=car.centre,
            wheels=self.wheels,
            friction=self.friction,
        )
        step = scene.dt / self._steps(scene.dt)
        return engine(machine, tuple(scene.start), scene.obstacles, scene.walls, step)
