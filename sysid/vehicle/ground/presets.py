"""Soils by name with their sources, and soils from user input.

Those by name stand in soils.json, written as a user writes one. The numbers of soft ground are rows
of table 2.3 of Wong, *Theory of Ground Vehicles*; a standard deviation there is how far rows of the
same kind of ground differ: soils of one name do differ so much from place to place. Firm ground is
friction over a short shear of the track's rubber. What no source gives is assumed, with a standard
deviation of a third: it may be wrong by a factor up to two; the source says so.
"""

import difflib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from sysid.data.yaml_files.source import read_yaml
from sysid.errors import DataError, ModelError
from sysid.vehicle.soil import NUMBERS, Shear, Soil


@dataclass(frozen=True)
class Preset:
    """A soil with a name."""

    name: str
    title: str
    soil: Soil


def soil_preset(name: str) -> Soil:
    """The soil of that name.

    Args:
        name: such as ``dry-sand``; upper case, spaces and underscores do no harm.
    """
    wanted = "-".join(name.strip().lower().replace("_", " ").replace("-", " ").split())
    for preset in PRESETS:
        if preset.name == wanted:
            return preset.soil
    known = [p.name for p in PRESETS]
    near = difflib.get_close_matches(wanted, known, n=1)
    advice = f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}"
    raise ModelError(f"no soil is called {name!r}: {advice}")


_SPELT = {"friction_angle_deg": "friction_angle", "friction": "friction_angle"}
"""Other ways to write a number: φ in degrees, or as tan φ."""
_REQUIRED = ("cohesion", "friction_angle", "shear_modulus")
"""The numbers without a default, in the order of the fields."""


def soil_of(value: "str | Mapping[str, object] | Soil") -> Soil:
    """The soil that a person wrote: a preset's name, or numbers, over a preset where one is named.

    ``{preset: dry-sand, cohesion: 500, friction_angle_deg: 31, std: {cohesion: 100}}``. Keys are
    the fields of :class:`Soil` in its units; φ may be given as ``friction_angle`` [rad],
    ``friction_angle_deg`` [°] or ``friction`` (tan φ [1]). A number that replaces a preset's has
    the standard deviation that ``std`` gives it, else none.

    Raises:
        ModelError: a key, a name or a number is not one of a soil, or something is missing.
    """
    if isinstance(value, Soil):
        return value
    if isinstance(value, str):
        return soil_preset(value)
    if not isinstance(value, Mapping):
        raise ModelError(f"a soil is a preset's name or numbers by name, not {value!r}")
    given = dict(value)
    preset = given.pop("preset", None)
    if preset is not None and not isinstance(preset, str):
        raise ModelError(f"the soil's preset is {preset!r}: give a name such as dry-sand")
    if preset is not None:
        return soil_over(soil_preset(preset), given)
    _check_keys(given)
    missing = [k for k in _REQUIRED if k not in {_SPELT.get(key, key) for key in given}]
    if missing:
        raise ModelError(
            f"the soil lacks {' and '.join(missing)}: give a preset, or cohesion, friction_angle "
            "and shear_modulus at least"
        )
    return replace(soil_over(Soil(0.0, 0.0, 1.0), given), source=str(given.get("source", "given")))


def soil_over(base: Soil, given: Mapping[str, object]) -> Soil:
    """A soil with numbers of its own, as :func:`soil_of` reads them without a preset."""
    given = dict(given)
    spread = given.pop("std", None)
    _check_keys(given)
    numbers = _numbers(given)
    shear = str(given.get("shear", base.shear.value))
    if shear not in [s.value for s in Shear]:
        known = ", ".join(s.value for s in Shear)
        raise ModelError(f"the soil's shear is {shear!r}: give one of {known}")
    std = {k: v for k, v in base.std if k not in numbers} | _spread(spread, numbers, base)
    source = base.source
    if numbers:
        source = f"{', '.join(numbers)} given; the rest: {base.source}"
    changed: dict[str, Any] = dict(numbers)
    source = str(given.get("source", source))
    return replace(base, **changed, shear=Shear(shear), std=tuple(std.items()), source=source)


def _check_keys(given: Mapping[str, object]) -> None:
    known = [*(f.name for f in fields(Soil)), *_SPELT]
    for key in given:
        if key not in known:
            near = difflib.get_close_matches(str(key), [*known, "preset"], n=1)
            keys = ", ".join(["preset", *known])
            advice = f"did you mean {near[0]}?" if near else f"the keys are {keys}"
            raise ModelError(f"a soil has no key {key!r}: {advice}")
    angles = [k for k in ("friction_angle", *_SPELT) if k in given]
    if len(angles) > 1:
        raise ModelError(f"the soil has {' and '.join(angles)}: give the angle once")


def _numbers(given: Mapping[str, object], of: str = "") -> dict[str, float]:
    """The numbers among what was given, by their field and in its unit."""
    numbers = {}
    for key, value in given.items():
        if key in ("shear", "source"):
            continue
        name = f"{of}{key}"
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ModelError(f"the soil's {name} is {value!r}: give a number")
        number = float(value)
        if key == "friction_angle_deg":
            number = math.radians(number)
        elif key == "friction" and not of:
            if not number >= 0.0:
                raise ModelError(f"the soil's {name} is {value}: give at least 0")
            number = math.atan(number)
        elif key == "friction_angle" and number >= 0.5 * math.pi:
            raise ModelError(
                f"the soil's {name} is {value} rad: give radians below π/2, or degrees as "
                "friction_angle_deg"
            )
        numbers[_SPELT.get(key, key)] = number
    return numbers


def _spread(given: object, numbers: Mapping[str, float], base: Soil) -> dict[str, float]:
    """Standard deviations that were given, by field and in its unit."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise ModelError(f"the soil's std is {given!r}: give standard deviations by name")
    for key in given:
        if _SPELT.get(str(key), key) not in NUMBERS:
            raise ModelError(f"the soil has no number {key!r} to give a std: {', '.join(NUMBERS)}")
    spread = _numbers(given, "std of ")
    if "friction" in given:  # of the tangent: dφ = dμ cos²φ
        angle = numbers.get("friction_angle", base.friction_angle)
        spread["friction_angle"] *= math.cos(angle) ** 2
    return spread


def read_soil(path: Path) -> Soil:
    """The soil of a YAML file: its numbers, or its section ``soil`` or ``vehicle.soil``."""
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


_FILE = files("sysid.vehicle.ground").joinpath("soils.json").read_text(encoding="utf-8")
PRESETS = tuple(
    Preset(n, soil.pop("title"), soil_of(soil)) for n, soil in json.loads(_FILE).items()
)
"""Every preset, soft ground first."""
