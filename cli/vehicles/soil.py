"""``sysid soil``: thrust and resistances of a tracked vehicle on a soil."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import reading, render, targets
from ..options import argument, command, numbers, option, pairs

if TYPE_CHECKING:
    from sysid.vehicle.ground.assessment import Quantity, SoilAssessment
    from sysid.vehicle.ground.drawbar import Traction
    from sysid.vehicle.soil import Soil


def _numbers(given: Sequence[str]) -> dict[str, object]:
    advice = "NAME=VALUE, such as cohesion=500"
    words = [pair for pair in given if pair.strip().startswith("shear=")]
    rest = [pair for pair in given if pair not in words]
    return {**pairs(words, "--set", advice, str), **pairs(rest, "--set", advice, float)}


@command
def soil(
    ground: str | None = argument(
        "[SOIL]", "A preset's name, or a YAML file with a soil.", default=None
    ),
    vehicle: Path | None = option(
        "FILE",
        "YAML with r, B, L, track_width, centre, height, mass, as sysid vehicle reads it, "
        "or a mission [the bundled robot].",
    ),
    soil_numbers: dict[str, object] | None = option(
        "NAME=VALUE",
        "A parameter of the soil: cohesion=500, friction_angle_deg=31.",
        "--set",
        parse=_numbers,
        kind=list[str] | None,
    ),
    slope: float | None = option("DEG", "A slope to climb [°]."),
    slips: tuple[float, ...] | None = option(
        "I,I",
        "Slips at which to state the drawbar pull, 0 to 1.",
        "--slip",
        parse=lambda text: numbers(text, "--slip", "shares such as 0.05,0.2"),
        kind=str | None,
    ),
    wheels: int | None = option(
        "N",
        "Number of road wheels of a track, which cause pressure peaks [a rigid track].",
        "--road-wheels",
    ),
    plot: Path | None = targets.picture("Draw shear, pull and turning (svg or png)."),
    json: bool = reading.JSON,
) -> None:
    """List soils with their sources, or assess a vehicle on one."""
    from sysid.vehicle.ground.assessment import RADII, SLIPS, assess

    if ground is None and vehicle is None and not soil_numbers:
        _list(json)
        return
    traction = _traction(ground, vehicle, soil_numbers or {}, wheels)
    assessment = assess(
        traction,
        None if slope is None else math.radians(slope),
        slips or SLIPS,
        RADII,
    )
    if json:
        render.document(_document(assessment))
    else:
        _show(assessment, ground or str(vehicle))
    if plot is not None:
        from sysid.report.vehicles import draw_soil

        draw_soil(plot, ground or str(vehicle), assessment)


def _traction(
    ground: str | None, vehicle: Path | None, numbers: dict[str, object], wheels: int | None
) -> "Traction":
    """Soil and vehicle as the options say."""
    from sysid.vehicle.ground.drawbar import Traction
    from sysid.vehicle.pressure import Distribution, Pressure
    from sysid.vehicle.tracked import TrackedVehicle
    from sysid.vehicle.wheels.description import load_tracks

    body = TrackedVehicle() if vehicle is None else load_tracks(vehicle)
    spread = None if wheels is None else Pressure(Distribution.WHEELS, body.centre, wheels)
    return Traction(_soil(ground, vehicle, numbers), body, spread)


def _soil(ground: str | None, vehicle: Path | None, given: dict[str, object]) -> "Soil":
    from sysid.vehicle.ground.presets import read_soil, soil_of, soil_over

    if ground is None:
        return soil_of(given) if vehicle is None else soil_over(read_soil(vehicle), given)
    path = Path(ground)
    if path.suffix.lower() in (".yaml", ".yml") or path.is_file():
        return soil_over(read_soil(path), given)
    return soil_of({"preset": ground, **given})


def _list(json: bool) -> None:
    from sysid.vehicle.ground.presets import PRESETS

    if json:
        render.document(
            {"presets": [{"name": p.name, "title": p.title, **_facts(p.soil)} for p in PRESETS]}
        )
        return
    heads = ("soil", "ground", "c [kPa]", "φ [°]", "K [mm]", "μr", "μl")
    rows = []
    for p in PRESETS:
        std, s = dict(p.soil.std), p.soil
        scales = (
            ("cohesion", 1e-3), ("friction_angle", 180.0 / math.pi), ("shear_modulus", 1e3),
            ("rolling", 1.0), ("lateral", 1.0),
        )  # fmt: skip
        numbers = [_plus_minus(getattr(s, n) * k, std.get(n, 0.0) * k) for n, k in scales]
        rows.append([p.name, p.title, *numbers])
    render.table(heads, rows, caption="± 95 %; one soil: sysid soil SOIL")
    for p in PRESETS:
        render.say(f"{p.name}: {p.soil.source}.", "dim")


def _plus_minus(value: float, std: float | None) -> str:
    """A number and half of its 95 % interval, two digits; three of the number without one."""
    from sysid.estimation.assessment.delta_method import NORMAL
    from sysid.report.step_words import with_error

    return with_error(value, NORMAL * std) if std else render.number(value, 3)


def _facts(ground: "Soil") -> dict[str, Any]:
    from sysid.vehicle.soil import NUMBERS

    return {
        **{n: getattr(ground, n) for n in NUMBERS},
        "shear": ground.shear.value,
        "std": dict(ground.std),
        "source": ground.source,
    }


def _document(assessment: "SoilAssessment") -> dict[str, Any]:
    traction = assessment.traction
    body, spread = traction.vehicle, traction.spread()
    return {
        "soil": _facts(traction.soil),
        "vehicle": {
            "r": body.geometry.r,
            "B": body.geometry.B,
            **{
                n: getattr(body, n)
                for n in ("contact_length", "track_width", "mass", "centre", "height")
            },
        },
        "pressure": {
            "distribution": spread.distribution.value,
            "wheels": spread.wheels if spread.distribution == "wheels" else None,
        },
        "quantities": assessment.quantities,
        "drawbar": [
            {
                "slip": p.slip,
                "thrust_n": p.thrust.value,
                "thrust_std_error": p.thrust.std_error,
                "pull_n": p.pull.value,
                "pull_std_error": p.pull.std_error,
                "efficiency": p.efficiency,
            }
            for p in assessment.pulls
        ],
        "turning": [
            {
                "radius_m": t.radius,
                "moment_nm": t.moment.value,
                "moment_std_error": t.moment.std_error,
                "reason": t.moment.reason,
                "empirical_moment_nm": t.empirical,
                "power_w": t.power.value,
                "power_std_error": t.power.std_error,
            }
            for t in assessment.turns
        ],
        "notes": assessment.notes,
    }


_WORDS = {
    "thrust_max": "largest thrust",
    "rolling_resistance": "rolling resistance",
    "compaction_resistance": "resistance of compaction",
    "sinkage": "sinkage",
    "drawbar_pull_max": "largest drawbar pull",
    "slip_at_drawbar_pull_max": "at a slip of",
    "turning_moment": "moment against turning, μl",
    "steepest_slope": "steepest slope",
    "slope_pull": "pull up the slope",
    "slope_slip": "slip up the slope",
}
_SHOWN_IN = {"rad": ("°", 180.0 / math.pi), "m": ("mm", 1e3)}


def _show(assessment: "SoilAssessment", name: str) -> None:
    body = assessment.traction.vehicle
    render.say(
        f"{name} under {body.mass:.3g} kg on two tracks of {1e3 * body.contact_length:.3g} by "
        f"{1e3 * body.track_width:.3g} mm",
        "bold",
    )
    rows = []
    for q in assessment.quantities:
        unit, scale = _SHOWN_IN.get(q.unit, (q.unit, 1.0))
        std = None if q.std_error is None else q.std_error * scale
        shown = "–" if q.value is None else _plus_minus(q.value * scale, std)
        why = q.reason or f"most of it from {q.driven_by}"
        rows.append([_WORDS[q.name], shown, unit, why])
    render.table(("", "value ± 95 %", "unit", "the uncertainty"), rows)
    render.table(
        ("slip", "thrust [N]", "drawbar pull [N]", "efficiency"),
        [
            [p.slip, *(_plus_minus(q.value or 0.0, q.std_error) for q in (p.thrust, p.pull)),
             p.efficiency]
            for p in assessment.pulls
        ],
        title="Straight on",
    )  # fmt: skip
    render.table(
        ("radius [m]", "moment [N m]", "by μl and radius [N m]", "power at 0.1 m/s [W]"),
        [
            [t.radius, _turned(t.moment), t.empirical, _turned(t.power)]
            for t in assessment.turns
        ],
        title="Turning",
    )  # fmt: skip
    render.say(f"Soil: {assessment.traction.soil.source}.", "dim")
    render.cautions(assessment.notes)


def _turned(q: "Quantity") -> str:
    return "no steady turn" if q.value is None else _plus_minus(q.value, q.std_error)
