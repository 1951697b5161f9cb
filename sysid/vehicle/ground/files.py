"""Soils and tracked vehicles from YAML files, missions included."""

import difflib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from sysid.data.yaml_files.source import YamlSource, read_yaml, shown
from sysid.errors import DataError, ModelError
from sysid.vehicle.ground.presets import soil_of
from sysid.vehicle.kinematics import Geometry
from sysid.vehicle.soil import Soil
from sysid.vehicle.tracked import TrackedVehicle

_LENGTHS = ("r", "B")
_VEHICLE_FIELDS = tuple(f.name for f in fields(TrackedVehicle) if f.name != "geometry")
_SPELT = {"L": "contact_length"}
_OTHERS = ("name", "effective_width", "max_speed", "friction", "body")
"""What a description of a tracked vehicle also says, and no soil asks for."""
KEYS = (*_LENGTHS, *_SPELT, *_VEHICLE_FIELDS)
"""What a file may say of a vehicle here."""


def read_soil(path: Path) -> Soil:
    """The soil of a YAML file: its numbers, or its section ``soil`` or ``vehicle.soil``.

    Raises:
        DataError: the file cannot be read, or holds no soil; with the line.
    """
    source = read_yaml(path)
    values: Any = source.values
    place: tuple[str, ...] = ()
    for key in ("vehicle", "soil"):
        if isinstance(values, Mapping) and key in values:
            values, place = values[key], (*place, key)
    try:
        return soil_of(values)
    except ModelError as error:
        raise DataError(f"{source.where(place)}: {error}") from None


def read_vehicle(path: Path) -> TrackedVehicle:
    """The vehicle of a YAML file: its keys, or its section ``vehicle``; the rest by default.

    ``r``, ``B``, ``L`` (or ``contact_length``), ``track_width``, ``centre``, ``height`` [m],
    ``mass`` [kg], ``yaw_inertia`` [kg m²]. Keys that only other descriptions of tracks have are
    passed over, in a mission all others; wheels are refused.

    Raises:
        DataError: the file cannot be read, or holds no vehicle; with the line.
    """
    source = read_yaml(path)
    section = source.values.get("vehicle", source.values)
    place: tuple[str, ...] = ("vehicle",) if "vehicle" in source.values else ()
    if not isinstance(section, Mapping):
        raise DataError(f"{source.where(place)}: vehicle is {shown(section)}: write its numbers")
    numbers = _numbers(source, section, place)
    lengths = {k: numbers.pop(k) for k in _LENGTHS if k in numbers}
    try:
        return TrackedVehicle(Geometry(**lengths), **numbers)
    except ModelError as error:
        raise DataError(f"{source.where(place)}: {error}") from None


def _numbers(
    source: YamlSource, section: Mapping[str, Any], place: tuple[str, ...]
) -> dict[str, float]:
    numbers = {}
    for key, value in section.items():
        where = source.where((*place, key))
        if key == "wheels":
            raise DataError(f"{where}: it has wheels, and soils apply to tracks only")
        if key in _OTHERS or (place and key not in KEYS):
            continue
        if key not in KEYS:
            near = difflib.get_close_matches(key, KEYS, n=1)
            advice = f"did you mean {near[0]}?" if near else f"the keys are {', '.join(KEYS)}"
            raise DataError(f"{where}: a tracked vehicle has no key {key!r}: {advice}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise DataError(f"{where}: {key} is {shown(value)}: give a number")
        numbers[_SPELT.get(key, key)] = float(value)
    return numbers
