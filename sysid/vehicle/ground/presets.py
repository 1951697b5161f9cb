"""Soils by name with their sources, and soils from user input.

The numbers of soft ground are rows of table 2.3 of Wong, *Theory of Ground Vehicles*; a standard
deviation there is how far rows of the same kind of ground differ: soils of one name do differ so
much from place to place. What no source gives is assumed, and the source says so.
"""

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from sysid.errors import ModelError
from sysid.vehicle.soil import NUMBERS, Shear, Soil

_WONG = "Wong, Theory of Ground Vehicles, 3rd ed."
_ADHESION = f"{_WONG}, chapter 1 (road adhesion of rubber, sliding)"
_ASSUMED = 1.0 / 3.0
"""Standard deviation over value of an assumed number: it may be wrong by a factor up to two."""


@dataclass(frozen=True)
class Preset:
    """A soil with a name.

    Attributes:
        name: how it is asked for.
        title: what ground it is.
        soil: its numbers, with standard deviations and source.
    """

    name: str
    title: str
    soil: Soil


def _soft(
    name: str,
    title: str,
    row: tuple[float, float, float, float, float],
    differ: tuple[float, float],
    modulus: tuple[float, float],
    words: str,
) -> Preset:
    """Ground that gives way, from a row of Wong's table 2.3.

    Args:
        row: n [1], k_c [kN/m^(n+1)], k_φ [kN/m^(n+2)], c [kPa], φ [°].
        differ: standard deviations of c [kPa] and φ [°] among rows of that kind.
        modulus: K and its standard deviation [cm].
        words: which rows, and where K is from.
    """
    n, k_c, k_phi, c, phi = row
    rolling, lateral = 0.05, round(math.tan(math.radians(phi)), 2)
    return Preset(
        name,
        title,
        Soil(
            cohesion=1e3 * c,
            friction_angle=math.radians(phi),
            shear_modulus=modulus[0] / 100.0,
            rolling=rolling,
            lateral=lateral,
            n=n,
            k_c=1e3 * k_c,
            k_phi=1e3 * k_phi,
            std=(
                ("cohesion", 1e3 * differ[0]),
                ("friction_angle", math.radians(differ[1])),
                ("shear_modulus", modulus[1] / 100.0),
                ("rolling", rolling * _ASSUMED),
                ("lateral", lateral * _ASSUMED),
            ),
            source=f"{_WONG}, table 2.3, {words}; rolling and lateral assumed (lateral = tan φ): "
            "measure",
        ),
    )


def _rigid(
    name: str,
    title: str,
    friction: tuple[float, float],
    lateral: tuple[float, float],
    rolling: float,
    source: str,
) -> Preset:
    """Ground that does not give way: friction over a short shear of the track's rubber.

    Args:
        friction: tan φ and its standard deviation [1].
        lateral: μl and its standard deviation [1].
        rolling: μr [1], assumed.
        source: where the first two are from.
    """
    mu, spread = friction
    modulus = 0.005
    return Preset(
        name,
        title,
        Soil(
            cohesion=0.0,
            friction_angle=math.atan(mu),
            shear_modulus=modulus,
            rolling=rolling,
            lateral=lateral[0],
            std=(
                ("friction_angle", spread / (1.0 + mu * mu)),
                ("shear_modulus", modulus * _ASSUMED),
                ("rolling", rolling * _ASSUMED),
                ("lateral", lateral[1]),
            ),
            source=f"{source}; shear_modulus and rolling assumed: measure",
        ),
    )


_SANDY = "K the middle of Wong's 1 cm (firm) to 2.5 cm (loose sandy ground)"
_SANDY_K = (1.75, 0.43)
"""The middle of 1 to 2.5 cm, and the standard deviation of a value anywhere between."""

PRESETS = (
    _soft(
        "dry-sand",
        "loose dry sand",
        (1.1, 0.99, 1528.43, 1.04, 28.0),
        (0.18, 2.2),
        _SANDY_K,
        f"dry sand (Land Locomotion Lab), spread against LETE sand; {_SANDY}",
    ),
    _soft(
        "lete-sand",
        "firm sand",
        (0.79, 102.0, 5301.0, 1.3, 31.1),
        (0.18, 2.2),
        (1.2, 0.2),
        "LETE sand (Wong), spread against dry sand; K as measured on it by Wong",
    ),
    _soft(
        "sandy-loam",
        "sandy loam, 15 % water",
        (0.7, 5.27, 1515.04, 1.72, 29.0),
        (4.2, 9.0),
        _SANDY_K,
        f"sandy loam 15 % (Land Locomotion Lab), spread of its eight rows of sandy loam; {_SANDY}",
    ),
    _soft(
        "loam",
        "loam, 24 % water",
        (1.01, 0.06, 5880.0, 3.1, 29.8),
        (2.1, 2.3),
        _SANDY_K,
        f"Grenville loam (Wong), spread against North Gower clayey loam; {_SANDY}",
    ),
    _soft(
        "clay",
        "clayey soil, 38 % water",
        (0.5, 13.19, 692.15, 4.14, 13.0),
        (1.5, 2.1),
        (0.6, 0.2),
        "clayey soil (Thailand) 38 %, spread against 55 %; K Wong's 0.6 cm for clay",
    ),
    _soft(
        "snow",
        "undisturbed snow",
        (1.6, 4.37, 196.72, 1.03, 19.7),
        (0.29, 2.5),
        (3.75, 0.72),
        "snow (U.S.), spread of its two rows (in Sweden 6 kPa); K the middle of Wong's 2.5 to 5 cm",
    ),
    _rigid(
        "concrete",
        "dry concrete or asphalt under rubber",
        (0.75, 0.1),
        (0.9, 0.1),
        0.03,
        f"{_ADHESION}; lateral: the same, table 6.1 (rubber track on concrete)",
    ),
    _rigid(
        "carpet",
        "short-pile carpet under rubber",
        (0.6, 0.2),
        (0.6, 0.2),
        0.08,
        "friction and lateral assumed, no source known",
    ),
    _rigid(
        "wood",
        "parquet or laminate under rubber",
        (0.5, 0.17),
        (0.5, 0.17),
        0.03,
        "friction and lateral assumed, no source known",
    ),
    _rigid(
        "ice",
        "ice under rubber",
        (0.07, 0.02),
        (0.07, 0.02),
        0.03,
        f"{_ADHESION}; lateral assumed equal",
    ),
)
"""Every preset, soft ground first."""


def soil_preset(name: str) -> Soil:
    """The soil of that name.

    Args:
        name: such as ``dry-sand``; upper case, spaces and underscores do no harm.

    Raises:
        ModelError: there is none of that name.
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
    """A soil with numbers of its own, as :func:`soil_of` reads them without a preset.

    Raises:
        ModelError: a key or a number is not one of a soil.
    """
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
