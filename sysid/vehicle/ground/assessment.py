"""The effects of a soil on a tracked vehicle, with uncertainty.

Standard deviations are those of the soil's numbers, taken as independent: each number is moved by
one of its own to both sides, as far as it can be, half the difference is what it contributes, and
contributions add in squares.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from sysid.errors import ModelError
from sysid.vehicle.ground.drawbar import Traction
from sysid.vehicle.ground.resistance import lateral_at_radius, lateral_reaction, sinkage
from sysid.vehicle.ground.skid_steer import steady_turn
from sysid.vehicle.soil import NUMBERS, Soil

SLIPS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0)
"""Slips at which drawbar pull is reported [1]."""
RADII = (0.0, 0.25, 0.5, 1.0, 2.0, 5.0)
"""Radii of reported turns [m]."""


@dataclass(frozen=True)
class Quantity:
    """A number and how surely it is known.

    Attributes:
        value: None where there is none.
        std_error: its standard deviation; None where it is not known.
        reason: why a number is missing, or what its uncertainty does not count.
        driven_by: the soil's number that contributes most to the uncertainty; empty without one.
    """

    name: str
    unit: str
    value: float | None
    std_error: float | None
    reason: str = ""
    driven_by: str = ""


@dataclass(frozen=True)
class PullAtSlip:
    """Drawbar pull at a slip [1]: thrust [N], pull with standard deviation [N], efficiency [1]."""

    slip: float
    thrust: Quantity
    pull: Quantity
    efficiency: float


@dataclass(frozen=True)
class TurnAtRadius:
    """A steady turn on a radius [m].

    Attributes:
        radius: R [m].
        moment: against turning, from shared shear strength [N m].
        empirical: what the formula with μl and the radius gives [N m].
        power: of both sprockets at 0.1 m/s of the outer track [W].
    """

    radius: float
    moment: Quantity
    empirical: float
    power: Quantity


@dataclass(frozen=True)
class SoilAssessment:
    """What a soil does to a vehicle.

    Attributes:
        quantities: thrust, sinkage, resistances, slopes.
        pulls: drawbar pull against slip, on the level.
        turns: turning resistance against radius, on the level.
    """

    traction: Traction
    quantities: tuple[Quantity, ...]
    pulls: tuple[PullAtSlip, ...]
    turns: tuple[TurnAtRadius, ...]
    notes: tuple[str, ...]

    @property
    def moment_in_the_middle(self) -> float:
        """Moment against turning about the centre of mass by μl alone (2.36) [N m]."""
        return next(q.value or 0.0 for q in self.quantities if q.name == "turning_moment")


def assess(
    traction: Traction,
    slope: float | None = None,
    slips: Sequence[float] = SLIPS,
    radii: Sequence[float] = RADII,
) -> SoilAssessment:
    """Everything a soil gives a vehicle and takes from it.

    Args:
        traction: soil, vehicle and pressure, on the level.
        slope: a slope to climb [rad].
        slips: where drawbar pull is reported [1].
        radii: of turns [m].
    """
    if slope is not None and not 0.0 <= slope < traction.tipping_slope:
        most = math.degrees(traction.tipping_slope)
        raise ModelError(
            f"the slope is {math.degrees(slope):.3g}°: give 0 to below {most:.3g}°, where the "
            "vehicle tips"
        )
    for slip in slips:
        if not 0.0 < slip <= 1.0:
            raise ModelError(f"the slip is {slip}: give a share above 0, up to 1")
    traction.spread().check(traction.vehicle.contact_length)
    there = _spread(traction, lambda t: _values(t, slope, slips) | _turns(t, radii))
    names = _UNITS if slope is not None else [n for n in _UNITS if n not in _OF_SLOPE]
    return SoilAssessment(
        traction,
        tuple(there[name] for name in names),
        tuple(
            PullAtSlip(s, there[f"thrust {s}"], there[f"pull {s}"], float(traction.efficiency(s)))
            for s in slips
        ),
        tuple(
            TurnAtRadius(r, there[f"moment {r}"], _empirical(traction, r), there[f"power {r}"])
            for r in radii
        ),
        tuple(_notes(traction)),
    )


_UNITS = {
    "thrust_max": "N",
    "rolling_resistance": "N",
    "compaction_resistance": "N",
    "sinkage": "m",
    "drawbar_pull_max": "N",
    "slip_at_drawbar_pull_max": "",
    "turning_moment": "N m",
    "steepest_slope": "rad",
    "slope_pull": "N",
    "slope_slip": "",
}
"""Quantities and their units, in the order of the report."""
_OF_SLOPE = ("slope_pull", "slope_slip")
_WHY_NONE = {
    "steepest_slope": "the resistances exceed the thrust, so it cannot drive even on level ground",
    "slope_slip": "the soil cannot give that pull",
}
_BEKKER = ("n", "k_c", "k_phi")
_OF_BEKKER = ("sinkage", "compaction_resistance")


def _values(traction: Traction, slope: float | None, slips: Sequence[float]) -> dict[str, float]:
    """Everything but turns, by name; NaN where there is nothing."""
    v, pressure = traction.vehicle, traction.spread()
    most, at = traction.largest_pull()
    peak = pressure.peak(traction.load(), v.contact_length, v.track_width)
    _, moment = lateral_reaction(traction.soil, v.weight, 0.0, 1.0, v.contact_length, pressure)
    values = {
        "thrust_max": most + traction.rolling() + traction.compaction(),
        "rolling_resistance": traction.rolling(),
        "compaction_resistance": traction.compaction(),
        "sinkage": sinkage(traction.soil, peak, min(v.track_width, v.contact_length)),
        "drawbar_pull_max": most,
        "slip_at_drawbar_pull_max": at,
        "turning_moment": moment,
        "steepest_slope": traction.steepest_slope(),
    }
    if slope is not None:
        tilted = replace(traction, slope=slope)
        values["slope_pull"] = v.weight * math.sin(slope)
        values["slope_slip"] = tilted.slip_for(values["slope_pull"])
    for slip in slips:
        values[f"thrust {slip}"] = traction.thrust(slip)
        values[f"pull {slip}"] = traction.drawbar_pull(slip)
    return {name: float(value) for name, value in values.items()}


def _turns(traction: Traction, radii: Sequence[float]) -> dict[str, float]:
    values: dict[str, float] = {}
    for radius in radii:
        try:
            turn = steady_turn(traction, radius)
            moment, power = turn.moment, turn.power
        except ModelError:
            moment = power = math.nan
        values |= {f"moment {radius}": moment, f"power {radius}": power}
    return values


def _empirical(traction: Traction, radius: float) -> float:
    """The moment that μl and the radius give [N m]."""
    v = traction.vehicle
    lateral = float(lateral_at_radius(traction.soil.lateral, radius, v.geometry.B))
    soil = replace(traction.soil, lateral=lateral)
    pressure = traction.spread()
    return float(lateral_reaction(soil, v.weight, 0.0, 1.0, v.contact_length, pressure)[1])


def _spread(
    traction: Traction, values: Callable[[Traction], Mapping[str, float]]
) -> dict[str, Quantity]:
    nominal = values(traction)
    parts: dict[str, Mapping[str, float]] = {}
    for name, std in traction.soil.std:
        low, high = _moved(traction.soil, name, -std), _moved(traction.soil, name, std)
        less, more = values(replace(traction, soil=low)), values(replace(traction, soil=high))
        parts[name] = {k: 0.5 * (more[k] - less[k]) for k in nominal}
    firm = math.isinf(traction.soil.k_phi)
    return {
        k: _quantity(k, v, {p: d[k] for p, d in parts.items()}, firm) for k, v in nominal.items()
    }


def _moved(soil: Soil, name: str, by: float) -> Soil:
    """The soil with one number moved, no farther than it can be."""
    value = getattr(soil, name)
    limits = {"friction_angle": (0.0, 1.5), "residual": (1e-3, 1.0)}
    lowest = 0.0 if name in ("cohesion", "rolling", "lateral", "k_c") else 1e-3 * value
    low, high = limits.get(name, (lowest, math.inf))
    moved: dict[str, object] = {name: min(max(value + by, low), high)}
    return replace(soil, **moved)  # type: ignore[arg-type]


def _quantity(key: str, value: float, parts: Mapping[str, float], firm: bool) -> Quantity:
    name = key.partition(" ")[0]
    unit = _UNITS.get(name, {"moment": "N m", "power": "W"}.get(name, "N"))
    if math.isnan(value):
        why = _WHY_NONE.get(
            name, "no steady turn exists, because turning needs more than the soil's strength"
        )
        return Quantity(name, unit, None, None, why)
    broken = [p for p, d in parts.items() if math.isnan(d)]
    if broken:
        why = f"one standard deviation of {broken[0]} away there is none"
        return Quantity(name, unit, value, None, why)
    total = math.sqrt(sum(d * d for d in parts.values()))
    if total > 0.0:
        return Quantity(name, unit, value, total, "", max(parts, key=lambda p: abs(parts[p])))
    if name in _OF_BEKKER and not firm and not any(p in parts for p in _BEKKER):
        return Quantity(name, unit, value, None, "n, k_c and k_phi have no standard deviation")
    if not parts and name != "slope_pull":
        return Quantity(name, unit, value, None, "the soil's numbers have no standard deviation")
    why = (
        "firm ground does not give way" if name in _OF_BEKKER else "these numbers do not change it"
    )
    return Quantity(name, unit, value, 0.0, why)


def _notes(traction: Traction) -> list[str]:
    soil, v = traction.soil, traction.vehicle
    begin, end = traction.spread().contact(v.contact_length)
    cohesive_force = 2.0 * (end - begin) * v.track_width * soil.cohesion
    said = []
    if cohesive_force > v.weight:
        said.append(
            f"Cohesion alone holds {cohesive_force:.3g} N, "
            f"{cohesive_force / v.weight:.2g} times the weight. Only lugs that cut into the soil "
            "mobilise that; for a belt that slides on top give its adhesion and friction."
        )
    peak = traction.spread().peak(traction.load(), v.contact_length, v.track_width)
    depth = float(sinkage(soil, peak, min(v.track_width, v.contact_length)))
    if depth > v.geometry.r:
        said.append(
            f"It sinks {1e3 * depth:.3g} mm, more than the sprocket's radius of "
            f"{1e3 * v.geometry.r:.3g} mm: the body would drag, which the model ignores."
        )
    unknown = [n for n in NUMBERS if n not in dict(soil.std) and n != "residual"]
    if soil.std and math.isfinite(soil.k_phi) and any(n in unknown for n in _BEKKER):
        missing = ", ".join(n for n in _BEKKER if n in unknown)
        said.append(f"No standard deviation is known for {missing}; the uncertainties omit it.")
    return said
