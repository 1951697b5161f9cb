"""The mission file: what to reach, what to avoid, and with which gains, all of it checked.

Only ``goal`` is required; every default is the thesis's (chapters 4 and 6) or, where it prints
none, the value chosen for this workbench. See :func:`load_mission` for the file.
"""

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    Field,
    PlainValidator,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from sysid.errors import DataError
from sysid.mission.contracts import (
    Controller,
    Disc,
    Guidance,
    Motion,
    Navigation,
    Pose,
    Scene,
    Sensor,
)
from sysid.mission.control.pi_p import SpeedPIYawP
from sysid.mission.guidance.field import PotentialField
from sysid.mission.motion.kinematic import Kinematic
from sysid.mission.navigation.odometry import Odometry
from sysid.mission.registry import law, sensor_set
from sysid.mission.settings import Coordinate, Positive, Settings
from sysid.mission.spec_problems import first_problem
from sysid.mission.yaml_source import read_yaml, shown
from sysid.vehicle.kinematics import Geometry, wrap_angle


class Obstacle(Settings):
    """A round obstacle: the field acts from its point, collision from its surface.

    Attributes:
        x, y: position of the point [m].
        radius: of the surface around it [m].
    """

    x: Coordinate
    y: Coordinate
    radius: Positive = 0.15

    @model_validator(mode="before")
    @classmethod
    def _forms(cls, value: Any) -> Any:
        """Accept ``[x, y]``, ``[x, y, radius]`` and ``{at: [x, y], radius: r}``."""
        if isinstance(value, list | tuple):
            if len(value) not in (2, 3):
                raise ValueError(
                    f"an obstacle has {len(value)} numbers: write [x, y] or [x, y, radius]"
                )
            return dict(zip(("x", "y", "radius"), value, strict=False))
        if not isinstance(value, dict):
            if isinstance(value, Obstacle):
                return value
            raise ValueError(
                f"{shown(value)} is not an obstacle: write obstacles: [[x, y], [x, y, radius]]"
            )
        if ("at" in value) == ("x" in value or "y" in value):
            raise ValueError("an obstacle needs one position: write {at: [x, y], radius: r}")
        if "at" not in value:
            return value
        x, y = _vector(value["at"], "at", ("x", "y"), 2)
        return {"x": x, "y": y} | {k: v for k, v in value.items() if k != "at"}


class VehicleSpec(Settings):
    """Geometry of the vehicle, and the scales of a plant that does not speak µs and rad/s.

    Attributes:
        r: sprocket radius [m].
        B: distance between the track centre lines [m].
        command_scale: plant input at full drive, in the plant's units; None lets
            :func:`sysid.mission.mapping.as_robot` choose.
        speed_scale: wheel speed [rad/s] per unit of plant output; None likewise.
    """

    r: Positive = Geometry().r
    B: Positive = Geometry().B
    command_scale: Annotated[float, Field(ge=-1e9, le=1e9)] | None = None
    speed_scale: Annotated[float, Field(ge=-1e9, le=1e9)] | None = None

    @field_validator("command_scale", "speed_scale")
    @classmethod
    def _not_zero(cls, value: float | None, info: ValidationInfo) -> float | None:
        if value == 0:
            raise ValueError(
                f"vehicle.{info.field_name} is 0, which disconnects the plant: change it"
            )
        return value

    @property
    def geometry(self) -> Geometry:
        """The lengths as the kinematics take them."""
        return Geometry(self.r, self.B)

    @property
    def given_geometry(self) -> Geometry | None:
        """The lengths where the mission file gives one of them; None where both are assumed."""
        return self.geometry if {"r", "B"} & self.model_fields_set else None


class Mission(Settings):
    """One mission: from where to where, around what, and how.

    Attributes:
        goal: X, Y to reach [m].
        start: initial X, Y [m] and ψ [rad].
        obstacles: what to keep clear of.
        tolerance: the goal counts as reached within this distance [m].
        timeout: the mission is given up after this time [s].
        guidance, control, navigation, motion: the laws of the loop; in a file each is a section
            whose ``kind`` names the law and whose other keys are that law's own.
        sensors: what navigation reads besides the wheels, by kind.
        vehicle: lengths and scales.
    """

    goal: tuple[Coordinate, Coordinate]
    start: tuple[Coordinate, Coordinate, float] = (0.0, 0.0, 0.0)
    obstacles: Annotated[tuple[Obstacle, ...], Field(strict=False)] = ()
    tolerance: Positive = 0.10
    timeout: Annotated[float, Field(gt=0, le=86_400)] = 120.0
    guidance: Annotated[Guidance, PlainValidator(partial(law, "guidance"))] = PotentialField()
    control: Annotated[Controller, PlainValidator(partial(law, "control"))] = SpeedPIYawP()
    navigation: Annotated[Navigation, PlainValidator(partial(law, "navigation"))] = Odometry()
    motion: Annotated[Motion, PlainValidator(partial(law, "motion"))] = Kinematic()
    sensors: Annotated[Mapping[str, Sensor], PlainValidator(sensor_set)] = Field(
        default_factory=dict
    )
    vehicle: VehicleSpec = VehicleSpec()

    @field_validator("goal", mode="before")
    @classmethod
    def _goal(cls, value: Any) -> Any:
        return _vector(value, "goal", ("x", "y"), 2)

    @field_validator("start", mode="before")
    @classmethod
    def _start(cls, value: Any) -> Any:
        start = _vector(value, "start", ("x", "y", "psi"), 2)
        return (*start, 0.0) if len(start) == 2 else start

    @field_validator("start")
    @classmethod
    def _radians(cls, start: tuple[float, float, float]) -> tuple[float, float, float]:
        if abs(start[2]) > 6.2832:
            raise ValueError(
                f"psi = {start[2]:g} is more than a full turn: give it in radians, "
                f"e.g. {start[2] / 57.29578:.4g} for {start[2]:g} degrees"
            )
        return start

    @field_validator("obstacles", mode="before")
    @classmethod
    def _list(cls, value: Any) -> Any:
        if value is None:
            return ()
        if not isinstance(value, list | tuple):
            raise ValueError("obstacles must be a list: write obstacles: [[x, y], [x, y]]")
        return tuple(value)

    @model_validator(mode="after")
    def _clear(self) -> "Mission":
        """Nothing drives out of an obstacle, or into one, without touching it."""
        for what, (x, y) in (("start", self.start[:2]), ("goal", self.goal)):
            for o in self.obstacles:
                if math.hypot(o.x - x, o.y - y) <= o.radius:
                    raise ValueError(
                        f"the {what} ({x:g}, {y:g}) lies inside the obstacle at ({o.x:g}, {o.y:g}) "
                        f"of radius {o.radius:g} m: move one of them"
                    )
        return self

    def scene(self) -> Scene:
        """What a run of this mission is about, as the laws take it."""
        x, y, psi = self.start
        return Scene(
            start=Pose(x, y, wrap_angle(psi)),
            goal=self.goal,
            tolerance=self.tolerance,
            obstacles=tuple(Disc(o.x, o.y, o.radius) for o in self.obstacles),
            geometry=self.vehicle.geometry,
            sensors=self.sensors,
        )

    def with_geometry(self, geometry: Geometry) -> "Mission":
        """The mission driven by a vehicle of other lengths."""
        vehicle = self.vehicle.model_copy(update={"r": geometry.r, "B": geometry.B})
        return self.model_copy(update={"vehicle": vehicle})


def load_mission(path: str | Path) -> Mission:
    """Read and check a mission file.

    Args:
        path: a YAML file such as ::

            goal: [6, 3]
            start: [0, 0, 0]
            obstacles: [[2, 3.5], [3, 1, 0.2], {at: [5, 3], radius: 0.15}]
            guidance: {theta: 1, Kg: 0.3}

    Returns:
        The mission, defaults filled in.

    Raises:
        DataError: the file cannot be read, is not YAML, or says something a mission cannot be;
            one sentence ``file:line: what is wrong: what to do`` about the first of the problems.
    """
    source = read_yaml(path)
    try:
        return Mission.model_validate(source.values)
    except ValidationError as error:
        raise DataError(first_problem(error, source, Mission)) from None


def _vector(value: Any, name: str, parts: tuple[str, ...], at_least: int) -> tuple[Any, ...]:
    form = f"write {name}: [{', '.join(parts)}]"
    if not isinstance(value, list | tuple):
        raise ValueError(f"{name} is {shown(value)}: {form}")
    if not at_least <= len(value) <= len(parts):
        raise ValueError(f"{name} has {len(value)} numbers: {form}")
    return tuple(value)
