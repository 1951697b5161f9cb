"""The YAML file of a vehicle: wheels one by one, or the lengths of a tracked robot."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, model_validator

from sysid.data.yaml_files.problems import first_problem, keys_of, sentence_at
from sysid.data.yaml_files.settings import Coordinate, Gain, Positive, Settings
from sysid.data.yaml_files.source import Place, YamlSource, read_yaml, shown
from sysid.errors import DataError, ModelError
from sysid.vehicle.kinematics import Geometry
from sysid.vehicle.tracked import TrackedVehicle
from sysid.vehicle.wheels.body import Body
from sysid.vehicle.wheels.vehicle import Tracks, Vehicle
from sysid.vehicle.wheels.wheel import Wheel

ONLY_MISSIONS = (
    *("command_scale", "speed_scale", "supply", "lifted"),  # how a plant is wired
    *("motion", "soil", "patches", "slope"),  # how it moves and on what
)
"""Keys of a mission's section ``vehicle`` that say nothing of the vehicle itself."""

_OF_TRACKS = ("B", "L", "track_width", "effective_width", "centre", "height")


class VehicleFile(Settings):
    """What a vehicle file may say; without ``wheels`` it is a tracked robot of our lengths.

    Attributes:
        wheels: each with its keys (:class:`sysid.vehicle.wheels.wheel.Wheel`).
        r: sprocket radius of the tracks, or radius of the wheels that give none [m].
        B: distance between the track centre lines [m].
        L: contact length of a track [m].
        track_width: b of a track [m].
        effective_width: distance at which two wheels would turn the robot as its tracks do [m];
            B unless given, in truth more (fit it to a drive).
        centre: how far the centre of mass lies ahead of the middle of the tracks [m].
        height: of the centre of mass above the ground [m].
        max_speed: of every wheel or sprocket that gives none [rad/s].
        mass: of the whole vehicle [kg].
        yaw_inertia: of the whole about its centre of mass [kg m²].
        friction: coefficient between wheels and ground.
        body: box, mass and inertia of what the wheels carry.
    """

    name: str = ""
    wheels: Annotated[tuple[Wheel, ...], Field(strict=False)] | None = None
    r: Positive | None = None
    B: Positive = Geometry().B
    L: Positive = TrackedVehicle().contact_length
    track_width: Positive = TrackedVehicle().track_width
    effective_width: Positive | None = None
    centre: Coordinate = 0.0
    height: Positive | None = None
    max_speed: Positive | None = None
    mass: Positive | None = None
    yaw_inertia: Positive | None = None
    friction: Gain | None = None
    body: Body = Body()

    @model_validator(mode="before")
    @classmethod
    def _defaults(cls, value: Any) -> Any:
        """Give wheels the radius and largest speed of the vehicle, and drop keys of missions."""
        if not isinstance(value, dict):
            return value
        value = {k: v for k, v in value.items() if k not in ONLY_MISSIONS}
        if "contact_length" in value and "L" not in value:
            value["L"] = value.pop("contact_length")
        wheels = value.get("wheels")
        if "wheels" in value and not (isinstance(wheels, list | tuple) and wheels):
            raise sentence_at(
                ("wheels",),
                f"wheels is {shown(wheels) if wheels else 'empty'}: write wheels: "
                "[{kind: fixed, at: [x, y], r: 0.05}, …], or leave it out for a tracked robot",
            )
        if not wheels:
            return value
        driven = {k: value[k] for k in ("r", "max_speed") if k in value}
        loose = {k: v for k, v in driven.items() if k != "max_speed"}  # casters have no motor

        def complete(wheel: Any) -> Any:
            if not isinstance(wheel, dict):
                return wheel
            return (loose if wheel.get("kind") == "caster" else driven) | wheel

        return value | {"wheels": [complete(w) for w in wheels]}

    @model_validator(mode="after")
    def _wheels_or_tracks(self) -> "VehicleFile":
        given = [key for key in _OF_TRACKS if key in self.model_fields_set]
        if self.wheels and given:
            raise sentence_at(
                (given[0],), f"{given[0]} describes tracks, but there are wheels, too: keep one"
            )
        return self

    def vehicle(self, name: str) -> Vehicle:
        """The vehicle, with a name if the file gives it none."""
        known: dict[str, Any] = {
            "name": self.name or name,
            "body": self.body,
            "mass": self.mass,
            "yaw_inertia": self.yaw_inertia,
            "friction": self.friction,
        }
        if self.wheels:
            return Vehicle(self.wheels, **known)
        tracks = Tracks(self.B, self.effective_width or self.B, self.L)
        radius, width = self.r or Geometry().r, self.track_width
        wheels = tuple(
            Wheel(name=side, at=(0.0, y, 0.0), r=radius, width=width, max_speed=self.max_speed)
            for side, y in (
                ("left", 0.5 * tracks.effective_width),
                ("right", -0.5 * tracks.effective_width),
            )
        )
        if self.body.mass_centre is None:
            x, y, z = self.body.at
            z = z if self.height is None else self.height - radius  # axles are at z = 0
            moved = {"mass_centre": (x + self.centre, y, z)}
            known["body"] = self.body.model_copy(update=moved)
        return Vehicle(wheels, tracks=tracks, **known)


def load_vehicle(path: str | Path) -> Vehicle:
    """Read a vehicle from a YAML file or a URDF.

    A YAML file holds the keys of :class:`VehicleFile` at its top, or in a section ``vehicle`` as a
    mission does.

    Args:
        path: the file; names ending in .urdf or .xml are read as URDF.

    Raises:
        DataError: the file cannot be read or describes no vehicle; one sentence with its line.
    """
    path = Path(path)
    if path.suffix.lower() in (".urdf", ".xml", ".xacro"):
        from sysid.vehicle.wheels.urdf_reading import read_urdf

        return read_urdf(path)
    source, described = _described(path)
    try:
        return described.vehicle(path.stem)
    except ModelError as error:
        raise DataError(f"{source.where(())}: {error}") from None


def load_tracks(path: Path) -> TrackedVehicle:
    """The tracked vehicle of a YAML file as :func:`load_vehicle` reads it, for soils."""
    source, described = _described(path)
    if described.wheels:
        where = source.where(("wheels",))
        raise DataError(f"{where}: it has wheels, and soils apply to tracks only")
    keys = ("track_width", "mass", "yaw_inertia", "centre", "height")
    given = {k: v for k in keys if (v := getattr(described, k)) is not None}
    try:
        geometry = Geometry(described.r or Geometry().r, described.B)
        return TrackedVehicle(geometry, described.L, **given)
    except ModelError as error:
        raise DataError(f"{source.where(())}: {error}") from None


def _described(path: Path) -> tuple[YamlSource, VehicleFile]:
    source = _own_section(read_yaml(path))
    try:
        return source, VehicleFile.model_validate(source.values)
    except ValidationError as error:
        raise DataError(
            first_problem(error, source, _known_keys, "the vehicle", {"at": "at: [x, y]"})
        ) from None


def _own_section(source: YamlSource) -> YamlSource:
    """What the file says of the vehicle: all of it, or the section of a mission."""
    values = source.values
    if "vehicle" not in values and "goal" not in values:
        return source
    inner = values.get("vehicle")
    if inner is not None and not isinstance(inner, Mapping):
        raise DataError(
            f"{source.where(('vehicle',))}: vehicle is {shown(inner)}: write a section "
            "{key: value} with its settings"
        )
    lines = {place[1:]: line for place, line in source.lines.items() if place[:1] == ("vehicle",)}
    return YamlSource(source.name, dict(inner or {}), lines)


def _known_keys(place: Place) -> list[str]:
    if place[:1] == ("wheels",):
        return list(Wheel.model_fields)
    return keys_of(VehicleFile, place)
