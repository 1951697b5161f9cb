"""The mission file: goal, obstacles and laws, validated.

Only ``goal`` is required; every default is the thesis's (chapters 4 and 6) or, where it prints
none, the value chosen for this workbench. See :func:`load_mission` for the file.
"""

import math
from collections.abc import Mapping, Sequence
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

from sysid.data.yaml_files.problems import sentence_at
from sysid.data.yaml_files.source import read_yaml, shown
from sysid.errors import DataError
from sysid.robot.mission.clearance import nearest_point
from sysid.robot.mission.contracts import (
    Controller,
    Disc,
    Guidance,
    Limits,
    Motion,
    Navigation,
    Pose,
    Scene,
    Sensor,
    Wall,
)
from sysid.robot.mission.control.pi_p import SpeedPIYawP
from sysid.robot.mission.equipment import equipped, lacking
from sysid.robot.mission.guidance.around_law import Feasible, PassingWaypoints, way_length
from sysid.robot.mission.guidance.escape import leading_out
from sysid.robot.mission.guidance.field import PotentialField
from sysid.robot.mission.motion.kinematic import Kinematic
from sysid.robot.mission.navigation.dead_reckoning import Odometry
from sysid.robot.mission.registry import (
    first_problem,
    law,
    motion_chosen,
    sensor_set,
)
from sysid.robot.mission.settings import Coordinate, Positive, Settings
from sysid.robot.mission.variation import Variation
from sysid.robot.mission.vehicle_spec import Physics, VehicleSpec, floor_of, tracked_vehicle
from sysid.runners import floats
from sysid.vehicle.floor import Polygon
from sysid.vehicle.kinematics import Geometry, wrap_angle
from sysid.vehicle.tracked import TrackedVehicle

Place = tuple[Coordinate, Coordinate]
"""X, Y [m]."""
Places = Annotated[tuple[Place, ...], Field(strict=False)]


class Obstacle(Settings):
    """A round obstacle: the field acts from its point, collision from its surface.

    Attributes:
        x, y: position of the point at t = 0 [m].
        radius: of the surface around it [m].
        velocity: of the point in X and Y, which stays the same [m/s].
    """

    x: Coordinate
    y: Coordinate
    radius: Positive = 0.15
    velocity: Place = (0.0, 0.0)

    @model_validator(mode="before")
    @classmethod
    def _forms(cls, value: Any) -> Any:
        """Accept ``[x, y]``, ``[x, y, r]`` and ``{at: [x, y], radius: r, velocity: [vx, vy]}``."""
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
        rest = {k: v for k, v in value.items() if k != "at"}
        if "velocity" in rest:
            rest["velocity"] = _vector(rest["velocity"], "velocity", ("vx", "vy"), 2)
        return {"x": x, "y": y} | rest

    @property
    def disc(self) -> Disc:
        return Disc(self.x, self.y, self.radius, *self.velocity)


class LimitSpec(Settings):
    """What references of guidance are kept within; ``plant`` and ``none`` stand for a switch.

    Attributes:
        from_plant: whether what the plant can do limits them; None leaves it to the law of
            guidance: published references are as published.
        speed, acceleration: limits instead of the plant's [m/s, m/s²].
        yaw_rate, yaw_acceleration: likewise [rad/s, rad/s²].
    """

    from_plant: bool | None = None
    speed: Positive | None = None
    acceleration: Positive | None = None
    yaw_rate: Positive | None = None
    yaw_acceleration: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _short(cls, value: Any) -> Any:
        """Accept ``limits: plant`` and ``limits: none``."""
        if isinstance(value, str):
            if value not in ("plant", "none"):
                raise ValueError(
                    f"limits is {shown(value)}: write plant, none or a section such as "
                    "{speed: 0.2}"
                )
            return {"from_plant": value == "plant"}
        return value

    @property
    def given(self) -> Mapping[str, float]:
        return {k: v for k in Limits._fields if (v := getattr(self, k)) is not None}


class Mission(Settings):
    """One mission: from where to where, around what, and how.

    Attributes:
        goal: X, Y to reach [m].
        start: initial X, Y [m] and ψ [rad].
        obstacles: round ones to keep clear of, which may move.
        walls: lines to keep clear of, each from point to point [m].
        polygons: areas to keep out of, by their corners [m].
        waypoints: places to pass on the way to the goal, in this order [m].
        path: points of the line to follow to the goal, for laws that follow one [m].
        tolerance: the goal and each waypoint counts as reached within this distance [m].
        timeout: the mission is given up after this time [s].
        guidance, control, navigation, motion: the laws of the loop; in a file each is a section
            whose ``kind`` names the law and whose other keys are that law's own.
        sensors: what navigation reads besides the wheels, by kind.
        limits: what the references of guidance are kept within.
        vary: quantities that vary between many runs, and by how much.
    """

    goal: tuple[Coordinate, Coordinate]
    start: tuple[Coordinate, Coordinate, float] = (0.0, 0.0, 0.0)
    obstacles: Annotated[tuple[Obstacle, ...], Field(strict=False)] = ()
    walls: Annotated[tuple[Places, ...], Field(strict=False)] = ()
    polygons: Annotated[tuple[Places, ...], Field(strict=False)] = ()
    waypoints: Places = ()
    path: Places = ()
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
    limits: LimitSpec = LimitSpec()
    vary: Variation = Variation()

    @model_validator(mode="before")
    @classmethod
    def _one_motion(cls, value: Any) -> Any:
        """``vehicle: {motion: dynamic}`` says the kind of the section ``motion``."""
        return motion_chosen(value)

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

    @field_validator("obstacles", "waypoints", "path", "walls", "polygons", mode="before")
    @classmethod
    def _lists(cls, value: Any, info: ValidationInfo) -> Any:
        name = str(info.field_name)
        if value is None:
            return ()
        if name in ("waypoints", "path"):
            return _points(value, name, 1)
        if not isinstance(value, list | tuple):
            if name == "obstacles":
                raise ValueError("obstacles must be a list: write obstacles: [[x, y], [x, y]]")
            raise ValueError(f"{name} is {shown(value)}: {_LINES_FORM.format(name)}")
        if name == "obstacles":
            return tuple(value)
        at_least = 2 if name == "walls" else 3
        return tuple(_points(v, f"{name}[{k}]", at_least) for k, v in enumerate(value, 1))

    @model_validator(mode="after")
    def _agrees(self) -> "Mission":
        """Navigation has what it reads, and one thing is said in one way."""
        sentence = lacking(self.navigation, self.sensors)
        if sentence:
            raise sentence_at(("navigation",), sentence)
        if self.path and self.waypoints:
            raise sentence_at(("waypoints",), "a path leads past its own points: keep one of them")
        of_motion = self.motion.given if isinstance(self.motion, Physics) else {}
        for key, value in of_motion.items():
            if self.vehicle.given.get(key, value) != value:
                raise sentence_at(
                    ("vehicle", key), f"{key} of the vehicle is not that of motion: keep one"
                )
        tracked_vehicle(self.vehicle.geometry, self.physics)
        return self

    @property
    def physics(self) -> Mapping[str, Any]:
        """What is said of the vehicle and its floor, in either section."""
        of_motion = self.motion.given if isinstance(self.motion, Physics) else {}
        return {**self.vehicle.given, **of_motion}

    @property
    def car(self) -> TrackedVehicle:
        """The vehicle, with what its motion takes for granted where nothing is said."""
        motion, physics = self.motion, self.physics
        known = motion.completed(physics) if isinstance(motion, Physics) else physics
        return tracked_vehicle(self.vehicle.geometry, known)

    @model_validator(mode="after")
    def _clear(self) -> "Mission":
        scene = self.scene()
        standing = tuple(o for o in scene.obstacles if o.vx == o.vy == 0)
        places: list[tuple[tuple[str | int, ...], str, Place, tuple[Disc, ...]]] = [
            (("start",), "start", self.start[:2], scene.obstacles),
            (("goal",), "goal", self.goal, standing),  # one that moves goes away again
        ]
        places += [
            ((key, k), name, place, standing)
            for key, name in (("waypoints", "waypoint"), ("path", "point of the path"))
            for k, place in enumerate(getattr(self, key))
        ]
        for where, what, place, discs in places:
            touched = _touched(place, discs, scene.walls, self.polygons)
            if touched:
                x, y = place
                raise sentence_at(
                    where, f"the {what} ({x:g}, {y:g}) lies {touched}: move one of them"
                )
        return self

    @property
    def complete_guidance(self) -> Guidance:
        """The law of guidance with all that the mission asks of it: way, escape, limits.

        Raises:
            DataError: there is a path, and the law follows none.
        """
        limited = self.limits_from_plant or self.limits.given
        return Feasible(self.way_guidance) if limited else self.way_guidance

    @property
    def limits_from_plant(self) -> bool:
        """Whether the references are kept within what the plant can do."""
        asked = self.limits.from_plant
        return self.guidance.traits.feasible if asked is None else asked

    @property
    def way_guidance(self) -> Guidance:
        """The law of guidance with what the mission asks of the way: waypoints, escape."""
        law = self.guidance
        if self.path and not law.traits.follows_path:
            raise DataError(
                "the mission has a path, which its law of guidance does not follow: write "
                "guidance: {kind: pure-pursuit}, or waypoints instead of path"
            )
        if isinstance(law, PotentialField):
            law = leading_out(law)
        if self.waypoints and not law.traits.passes_waypoints:
            law = PassingWaypoints(law)
        return law

    def scene(self) -> Scene:
        """What a run of this mission is about, as the laws take it."""
        x, y, psi = self.start
        return Scene(
            start=Pose(x, y, wrap_angle(psi)),
            goal=self.goal,
            tolerance=self.tolerance,
            obstacles=tuple(o.disc for o in self.obstacles),
            geometry=self.vehicle.geometry,
            walls=(*map(Wall, self.walls), *(Wall((*p, p[0])) for p in self.polygons)),
            way=self.waypoints,
            path=self.path,
            limits=Limits(**self.limits.given),
            sensors=equipped(self.navigation, self.sensors),
            car=self.car,
            floor=floor_of(self.physics),
        )

    def with_physics(self, physics: Mapping[str, Any]) -> "Mission":
        """The mission with other numbers of vehicle and floor, which are taken as they are."""
        if not physics:
            return self
        changed: dict[str, Any] = {"vehicle": self.vehicle.model_copy(update=dict(physics))}
        if isinstance(self.motion, Physics):
            of_motion = {k: physics[k] for k in self.motion.given if k in physics}
            changed["motion"] = self.motion.model_copy(update=of_motion)
        return self.model_copy(update=changed)

    def with_geometry(self, geometry: Geometry) -> "Mission":
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


    Raises:
        DataError: the file cannot be read, is not YAML, or says something a mission cannot be;
            one sentence ``file:line: what is wrong: what to do`` about the first of the problems.
    """
    source = read_yaml(path)
    try:
        mission = Mission.model_validate(source.values)
    except ValidationError as error:
        raise DataError(first_problem(error, source, Mission)) from None
    short = _too_short(mission)
    if short:
        raise DataError(f"{source.where(('timeout',))}: {short}")
    return mission


def _too_short(mission: Mission) -> str:
    """What to say of a mission that nothing could finish in time; empty where it could."""
    scene, speed = mission.scene(), mission.guidance.traits.top_speed
    stops = (*scene.path, *scene.targets)
    # Each place counts as reached a tolerance before it.
    way = way_length(scene.start, stops) - scene.tolerance * (2 * len(stops) - 1)
    if not way / speed > mission.timeout:
        return ""
    return (
        f"timeout is {mission.timeout:g} s, but the way of {way:.3g} m takes {way / speed:.3g} s "
        f"at the largest speed of {speed:g} m/s that guidance asks for: raise timeout"
    )


_LINES_FORM = "write {}: [[[x, y], [x, y], [x, y]]]"


def _points(value: Any, name: str, at_least: int) -> tuple[Any, ...]:
    key = name.partition("[")[0]
    form = f"write {name}: [[x, y], [x, y]]" if key == name else _LINES_FORM.format(key)
    if not isinstance(value, list | tuple):
        raise ValueError(f"{name} is {shown(value)}: {form}")
    if value and not isinstance(value[0], list | tuple):
        raise ValueError(f"{name} holds {shown(value[0])} where a point should be: {form}")
    if len(value) < at_least:
        raise ValueError(f"{name} has {len(value)} points and needs {at_least}: {form}")
    return tuple(_vector(v, f"{name}[{k}]", ("x", "y"), 2) for k, v in enumerate(value, 1))


def _touched(
    place: Place, discs: Sequence[Disc], walls: Sequence[Wall], polygons: Sequence[Sequence[Place]]
) -> str:
    """Where a place is that nothing can drive to; empty where it is free."""
    x, y = place
    for o in discs:
        if math.hypot(o.x - x, o.y - y) <= o.radius:
            return f"inside the obstacle at ({o.x:g}, {o.y:g}) of radius {o.radius:g} m"
    for k, polygon in enumerate(polygons, 1):
        if Polygon(tuple(polygon)).contains(x, y, floats):
            return f"inside polygons[{k}]"
    for wall in walls:
        if nearest_point(wall, x, y, floats) == place:
            (ax, ay), (bx, by) = wall.points[:2]
            return f"on the wall that begins with ({ax:g}, {ay:g}), ({bx:g}, {by:g})"
    return ""


def _vector(value: Any, name: str, parts: tuple[str, ...], at_least: int) -> tuple[Any, ...]:
    form = f"write {name}: [{', '.join(parts)}]"
    if not isinstance(value, list | tuple):
        raise ValueError(f"{name} is {shown(value)}: {form}")
    if not at_least <= len(value) <= len(parts):
        raise ValueError(f"{name} has {len(value)} numbers: {form}")
    return tuple(value)
