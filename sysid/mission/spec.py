"""The mission file: what to reach, what to avoid, and with which gains, all of it checked.

Only ``goal`` is required; every default is the thesis's (chapters 4 and 6) or, where it prints
none, the value chosen for this workbench. See :func:`load_mission` for the file.
"""

import math
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from sysid.errors import DataError
from sysid.mission.spec_problems import first_problem, shown
from sysid.mission.yaml_source import read_yaml
from sysid.vehicle.kinematics import Geometry

# Bounds far outside any use, which keep every later formula inside the range of floats.
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Positive = Annotated[float, Field(ge=1e-6, le=1e6)]
Gain = Annotated[float, Field(ge=0, le=1e6)]


class _Spec(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _mapping(cls, value: Any) -> Any:
        """Read a key with nothing after it, as in ``guidance:``, as an empty section."""
        return {} if value is None else value


class Obstacle(_Spec):
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


class GuidanceSpec(_Spec):
    """Gains of the potential field and of the references (thesis 4.19–4.31, 6.2.5).

    Attributes:
        K: attraction.
        d: distance to the goal where the parabolic attraction becomes conic [m].
        rho0: distance to an obstacle's point within which it repels [m].
        eta: repulsion.
        v_max: largest speed reference [m/s].
        theta, h: shape of the speed reference V_max θʰ/(θʰ + Δʰ).
        Kg, Ki: weight of the goal and of each obstacle in range in Δ [m].
    """

    K: Positive = 0.15
    d: Positive = 2.0
    rho0: Positive = 0.7
    eta: Gain = 0.05
    v_max: Positive = 0.3
    theta: Positive = 2.0
    h: Annotated[float, Field(gt=0, le=10)] = 1.0
    Kg: Gain = 0.4
    Ki: Gain = 1.0


class ControlSpec(_Spec):
    """Gains, limits and period of the controller (thesis 6.1–6.3).

    Attributes:
        kp_speed, ki_speed: PI on the forward speed [drive per m/s, drive per m].
        kp_yaw: P on the yaw [drive per rad].
        v_cmd_min, v_cmd_max: limits of the speed command [drive, 1 is full].
        psi_cmd_max: limit of the yaw command either way [drive].
        period: time between two commands [s].
    """

    kp_speed: Gain = 2.0
    ki_speed: Gain = 1.85
    kp_yaw: Gain = 0.4
    v_cmd_min: Annotated[float, Field(ge=-1, le=0)] = 0.0
    v_cmd_max: Annotated[float, Field(gt=0, le=1)] = 1.0
    psi_cmd_max: Annotated[float, Field(gt=0, le=1)] = 0.3
    period: Annotated[float, Field(ge=1e-4, le=60)] = 0.1


class VehicleSpec(_Spec):
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


class Mission(_Spec):
    """One mission: from where to where, around what, and how.

    Attributes:
        goal: X, Y to reach [m].
        start: initial X, Y [m] and ψ [rad].
        obstacles: what to keep clear of.
        tolerance: the goal counts as reached within this distance [m].
        timeout: the mission is given up after this time [s].
        guidance, control, vehicle: gains, limits and lengths.
    """

    goal: tuple[Coordinate, Coordinate]
    start: tuple[Coordinate, Coordinate, float] = (0.0, 0.0, 0.0)
    obstacles: Annotated[tuple[Obstacle, ...], Field(strict=False)] = ()
    tolerance: Positive = 0.10
    timeout: Annotated[float, Field(gt=0, le=86_400)] = 120.0
    guidance: GuidanceSpec = GuidanceSpec()
    control: ControlSpec = ControlSpec()
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
