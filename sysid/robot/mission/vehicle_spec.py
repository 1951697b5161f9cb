"""The vehicle of a mission file: its lengths, its mass, the ground, and its motion."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import Field, PlainValidator, ValidationInfo, field_validator, model_validator

from sysid.data.yaml_files.source import shown
from sysid.errors import ModelError
from sysid.robot.mission.settings import Coordinate, Positive, Settings
from sysid.robot.mission.supply import Supply
from sysid.vehicle.floor import Circle, Floor, HalfPlane, Patch, Polygon
from sysid.vehicle.ground.presets import soil_of
from sysid.vehicle.kinematics import Geometry
from sysid.vehicle.soil import Soil
from sysid.vehicle.tracked import TrackedVehicle

DEFAULT_SOIL = "concrete"
"""What a vehicle stands on where a mission does not say: a hard floor, as indoors."""

STEEPEST = 5.0
"""Rise over run: what is steeper is a wall, or an angle in degrees."""

_FIELD_NAMES = {"L": "contact_length"}
"""Keys whose name here is not that of the vehicle's field."""


def _soil(value: Any) -> Soil:
    try:
        return value if isinstance(value, Soil) else soil_of(value)
    except ModelError as error:
        raise ValueError(str(error)) from None


def _point(value: Any, name: str, n: int = 2) -> tuple[float, ...]:
    numbers = isinstance(value, list | tuple) and all(type(v) in (int, float) for v in value)
    if not numbers or len(value) != n:
        form = "[x, y]" if n == 2 else "[x, y, radius]"
        raise ValueError(f"{name} of a patch is {shown(value)}: write {form}")
    return tuple(float(v) for v in value)


def _patch(value: Any) -> Patch:
    """A part of the floor: its soil, and one of ``circle``, ``polygon`` and ``half_plane``."""
    if isinstance(value, Patch):
        return value
    forms = ("circle", "polygon", "half_plane")
    if not isinstance(value, Mapping):
        raise ValueError(f"a patch is {shown(value)}: write {{soil: ice, circle: [x, y, radius]}}")
    unknown = [k for k in value if k not in ("soil", *forms)]
    given = [k for k in forms if k in value]
    if unknown or len(given) != 1 or "soil" not in value:
        raise ValueError(
            f"a patch has {', '.join(map(str, value)) or 'no keys'}: write soil, and one of circle:"
            " [x, y, radius], polygon: [[x, y], …], half_plane: [[x, y], [x, y]] (left of the line)"
        )
    return Patch(_area(given[0], value[given[0]]), _soil(value["soil"]))


def _area(form: str, value: Any) -> Circle | HalfPlane | Polygon:
    if form == "circle":
        x, y, radius = _point(value, form, 3)
        if not radius > 0.0:
            raise ValueError(f"the circle of a patch has the radius {radius:g}: give one above 0")
        return Circle(x, y, radius)
    points = value if isinstance(value, list | tuple) else ()
    if len(points) < 3 - (form == "half_plane"):
        raise ValueError(f"{form} of a patch is {shown(value)}: write {form}: [[x, y], [x, y]]")
    corners: list[Any] = [_point(p, form) for p in points]
    if form == "polygon":
        return Polygon(tuple(corners))
    if len(corners) != 2 or corners[0] == corners[1]:
        raise ValueError("half_plane of a patch needs two different points: it lies left of them")
    return HalfPlane(corners[0], corners[1])


def _patches(value: Any) -> tuple[Patch, ...] | None:
    if value is None:
        return None
    if not isinstance(value, list | tuple):
        raise ValueError(
            f"patches is {shown(value)}: write patches: [{{soil: snow, circle: [x, y, radius]}}]"
        )
    return tuple(map(_patch, value))


Slope = Annotated[float, Field(ge=-STEEPEST, le=STEEPEST)]


class Physics(Settings):
    """What a vehicle and its floor are, for motions that ask: every key may be left out.

    Attributes:
        soil: under it, by name or by its numbers (:func:`sysid.vehicle.ground.presets.soil_of`).
        patches: parts of the floor with a soil of their own; later ones lie on earlier ones.
        slope: rise of the floor a metre in X and in Y [1].
        mass: of the whole vehicle [kg].
        yaw_inertia: about the vertical through its centre of mass [kg m²].
        L: length of a track on the ground [m].
        track_width: of a track [m].
        centre: how far the centre of mass lies ahead of the middle [m].
        height: of the centre of mass above the floor [m].
    """

    soil: Annotated[
        Soil | None, PlainValidator(lambda value: None if value is None else _soil(value))
    ] = None
    patches: Annotated[tuple[Patch, ...] | None, PlainValidator(_patches)] = None
    slope: Annotated[tuple[Slope, Slope], Field(strict=False)] | None = None
    mass: Positive | None = None
    yaw_inertia: Positive | None = None
    L: Positive | None = None
    track_width: Positive | None = None
    centre: Coordinate | None = None
    height: Annotated[float, Field(ge=0, le=1e3)] | None = None

    @property
    def given(self) -> Mapping[str, Any]:
        return {k: v for k in PHYSICS if (v := getattr(self, k)) is not None}

    def completed(self, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """The given keys of vehicle and floor, with the assumptions of this motion."""
        return given


PHYSICS = tuple(Physics.model_fields)
"""Names of the keys of a vehicle and its floor."""


def tracked_vehicle(geometry: Geometry, given: Mapping[str, Any]) -> TrackedVehicle:
    """The vehicle of these keys, the thesis's numbers where one is missing."""
    fields = {
        _FIELD_NAMES.get(k, k): v for k, v in given.items() if k not in ("soil", "patches", "slope")
    }
    return TrackedVehicle(geometry, **fields)


def floor_of(given: Mapping[str, Any]) -> Floor:
    """The floor of these keys, flat and of :data:`DEFAULT_SOIL` where nothing is said."""
    soil = given["soil"] if "soil" in given else soil_of(DEFAULT_SOIL)
    return Floor(soil, given.get("patches", ()), given.get("slope", (0.0, 0.0)))


def assumed(given: Mapping[str, Any], wanted: Sequence[str], car: TrackedVehicle) -> str:
    """Which of the wanted numbers were taken and not given, in one sentence; empty for none.

    Args:
        wanted: keys that the motion takes.
    """
    words = {
        "soil": f"the floor is {DEFAULT_SOIL}",
        "mass": f"the mass {car.mass:g} kg",
        "yaw_inertia": f"the yaw inertia {car.yaw_inertia:g} kg m²",
        "L": f"the length of the tracks on the ground {car.contact_length:g} m",
        "track_width": f"their width {car.track_width:g} m",
    }
    missing = [k for k in words if k in wanted and k not in given]
    if not missing:
        return ""
    listed = ", ".join(words[k] for k in missing)
    keys = ", ".join(f"vehicle.{k}" for k in missing)
    return f"Assumed, not given: {listed} ({keys})."


class VehicleSpec(Physics):
    """Lengths and physics of the vehicle, and the scales of a plant that is no robot's own.

    Attributes:
        r: sprocket radius [m].
        B: distance between the track centre lines [m].
        motion: how it moves, in place of a section ``motion`` that says no more than its kind.
        lifted: whether the plant was identified with its tracks off the ground; None judges by the
            inertia that its tracks share.
        command_scale: plant input at full drive, in the plant's units; None lets
            :func:`sysid.robot.mission.tracks.mapping.as_robot` choose.
        speed_scale: wheel speed [rad/s] per unit of plant output; None likewise.
        supply: battery and H-bridge between command and plant; None for none.
    """

    r: Positive = Geometry().r
    B: Positive = Geometry().B
    motion: str | None = None
    lifted: bool | None = None
    command_scale: Annotated[float, Field(ge=-1e9, le=1e9)] | None = None
    speed_scale: Annotated[float, Field(ge=-1e9, le=1e9)] | None = None
    supply: Supply | None = None

    @field_validator("command_scale", "speed_scale")
    @classmethod
    def _not_zero(cls, value: float | None, info: ValidationInfo) -> float | None:
        if value == 0:
            raise ValueError(
                f"vehicle.{info.field_name} is 0, which disconnects the plant: change it"
            )
        return value

    @model_validator(mode="after")
    def _stands(self) -> "VehicleSpec":
        try:
            tracked_vehicle(self.geometry, self.given)
        except ModelError as error:
            raise ValueError(str(error)) from None
        return self

    @property
    def geometry(self) -> Geometry:
        return Geometry(self.r, self.B)

    @property
    def given_geometry(self) -> Geometry | None:
        """The lengths where the mission file gives one of them; None where both are assumed."""
        return self.geometry if {"r", "B"} & self.model_fields_set else None
