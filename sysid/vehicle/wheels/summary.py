"""A vehicle and its kinematics as plain documents, and findings about it in words."""

import math
from collections.abc import Iterator
from typing import Any

from sysid.vehicle.wheels.constraints import RANK_TOLERANCE, Angles, Scale, rank, rows_of
from sysid.vehicle.wheels.mobility import Icr, IcrKind, icr, icr_of_twist
from sysid.vehicle.wheels.twists import (
    ForwardKinematics,
    InverseKinematics,
    speeds_determine_motion,
)
from sysid.vehicle.wheels.vehicle import AXES, Vehicle
from sysid.vehicle.wheels.wheel import Wheel

TYPES = {
    (3, 0): "drives in any direction at once, as with omni wheels, Mecanum wheels or casters alone",
    (2, 0): "differential drive: forward and turning at once, never sideways",
    (2, 1): "one steered wheel, else casters: turns at once, and drives where the wheel is steered",
    (1, 1): "as a tricycle, bicycle or car: drives along an arc that steering chooses",
    (1, 2): "two steered wheels or more: steering moves the centre of turning anywhere",
}
"""Degrees of mobility and steerability of the five classical types (Campion 1996), in words."""

INERTIA_APART = 2.0
"""Ratio of measured to computed yaw inertia beyond which one of them is doubted: bodies differ from
a solid box by less (a thin shell has 5/3 of its inertia)."""


def type_words(vehicle: Vehicle) -> str:
    """What a vehicle of these degrees does."""
    degrees = vehicle.degrees
    known = TYPES.get((degrees.mobility, degrees.steerability))
    if known is not None:
        return known
    if degrees.mobility == 0:
        return (
            "the axles of the fixed wheels do not meet in one point, so that the vehicle cannot "
            "move unless wheels slide"
        )
    centre = icr([w for w in vehicle.wheels if w.kind == "fixed"])
    if centre.kind is IcrKind.INFINITY:
        return (
            "drives straight only, since its fixed wheels stand on several parallel axles; it "
            "turns by letting them slide, as skid steering does (describe it as tracks with an "
            "effective_width)"
        )
    return "its fixed wheels let it turn about one point only"


def icr_words(icr: Icr) -> str:
    """Where the body turns about, as a sentence with its numbers."""
    words, run = icr.kind.value, ""
    if icr.direction is not None:
        dx, dy = icr.direction
        run = f"{math.degrees(math.atan2(dy, dx)):.4g}° to x"
    if icr.point is None:
        return f"{words}, at {run}" if run else words
    x, y = icr.point
    place = f"({x:.4g}, {y:.4g}) m"
    return f"{words}: through {place} at {run}" if run else f"{words}: {place}"


def notes(vehicle: Vehicle, angles: Angles | None = None) -> tuple[str, ...]:
    """Sentences on what a reader would not expect; none where all is plain."""
    return (*vehicle.notes, *_notes(vehicle, angles))


def _notes(vehicle: Vehicle, angles: Angles | None) -> Iterator[str]:
    wheels, scale = vehicle.wheels, Scale.of(vehicle.wheels)
    for k, one in enumerate(wheels):
        for other in wheels[k + 1 :]:
            apart = math.dist(one.position, other.position)
            same_place = apart <= RANK_TOLERANCE * scale.length
            if one.kind == other.kind == "fixed" and same_place:
                yield f"{one.name} and {other.name} stand in one place and act as one wheel."
    off = {n: a for n, a in vehicle.misalignment(angles).items() if a}
    if off and vehicle.mobility > 0:
        worst = max(off, key=lambda name: abs(off[name]))
        yield (
            f"At these steering angles the axles do not meet in one point: the vehicle stands, or "
            f"wheels slide; {worst} points {math.degrees(abs(off[worst])):.3g}° off the motion "
            "that suits all of them best."
        )
    fixed = rows_of([w.sliding_row() for w in wheels if w.kind == "fixed"])
    if rank(fixed, scale) == 1:
        for wheel in wheels:
            if wheel.kind == "steerable" and _on_axle(wheel, fixed[0].tolist(), scale):
                yield (
                    f"{wheel.name} stands on the axle of the fixed wheels: steering it turns "
                    "nothing."
                )
    if not speeds_determine_motion(wheels):
        yield (
            "The wheel speeds neither determine the motion nor command all of it, because casters "
            "follow any motion of the body."
        )
    yield from _on_inertia(vehicle)


def _on_inertia(vehicle: Vehicle) -> Iterator[str]:
    parts, measured = vehicle.mass_properties(), vehicle.yaw_inertia
    if parts is None or measured is None:
        return
    computed = float(parts.tensor[2, 2])
    if not 1 / INERTIA_APART <= measured / computed <= INERTIA_APART:
        yield (
            f"The yaw inertia of {measured:.4g} kg m² is {measured / computed:.3g} times the "
            f"{computed:.4g} kg m² that masses and sizes of the parts give: one of them is wrong."
        )


def _on_axle(wheel: Wheel, row: list[float], scale: Scale) -> bool:
    """Whether the steering axis lies on the line a y − b x + l = 0 of a fixed wheel's axle."""
    a, b, lever = row
    x, y = wheel.position
    return abs(a * y - b * x + lever) <= RANK_TOLERANCE * scale.length


def inverse_words(inverse: InverseKinematics) -> str:
    """Whether the wanted twist is possible, and what is missing."""
    if inverse.exact:
        words = "The wheels can give this motion"
    else:
        vx, vy, wz = inverse.impossible
        words = (
            f"Not all of it is possible: {vx:.4g} m/s forward, {vy:.4g} m/s to the left and "
            f"{wz:.4g} rad/s are missing, {inverse.residual:.4g} m/s at the wheels"
        )
    if inverse.slowdown > 1:
        return f"{words}, {inverse.slowdown:.3g} times faster than motors reach."
    return f"{words}."


def forward_words(forward: ForwardKinematics) -> str:
    """The motion from the wheel speeds, and whether they agree."""
    if forward.agree:
        return "The wheels agree: none of them has to slip."
    every = [*forward.rolling.items(), *forward.sliding.items()]
    worst = max(every, key=lambda item: abs(item[1]))[0]
    return (
        f"The wheels do not agree: they slip by {forward.residual:.4g} m/s (root mean square), "
        f"{worst} most, or lengths or angles are not as described."
    )


_SPECIAL = ("angle_limits", "offset", "side", "roller", "width", "mass", "max_speed")
"""Keys of a wheel that are listed only if given."""


def summary(vehicle: Vehicle, angles: Angles | None = None) -> dict[str, Any]:
    """Everything that is known of a vehicle, at steering angles [rad] by name of the wheel."""
    matrices = vehicle.constraints(angles)
    inverses = {name: vehicle.inverse(twist) for name, twist in AXES.items()}
    limits = vehicle.limits()
    parts = vehicle.mass_properties()
    return {
        "name": vehicle.name,
        "mobility": vehicle.mobility,
        "steerability": vehicle.steerability,
        "manoeuvrability": vehicle.manoeuvrability,
        "sentence": type_words(vehicle),
        "icr": icr_document(vehicle.icr(angles)),
        "wheels": [_wheel(w, inverses, (angles or {}).get(w.name)) for w in vehicle.wheels],
        "limits": {"vx_m_s": limits["vx"], "vy_m_s": limits["vy"], "wz_rad_s": limits["wz"]},
        "J1": matrices.J1,
        "J2": matrices.J2,
        "C1": matrices.C1,
        "rank_C1": matrices.rank,
        "C1_casters": matrices.C1c,
        "C2_casters": matrices.C2c,
        "misalignment_rad": vehicle.misalignment(angles),
        "mass_kg": parts.mass if parts else vehicle.mass,
        "centre_of_mass_m": parts.centre if parts else vehicle.body.mass_centre,
        "inertia_kg_m2": parts.tensor if parts else None,
        "yaw_inertia_kg_m2": vehicle.yaw_inertia or (float(parts.tensor[2, 2]) if parts else None),
        "tracks": vehicle.tracks,
        "friction": vehicle.friction,
        "notes": notes(vehicle, angles),
    }


def _wheel(wheel: Wheel, axes: dict[str, InverseKinematics], angle: float | None) -> dict[str, Any]:
    x, y = wheel.position
    facts: dict[str, Any] = {
        "name": wheel.name,
        "kind": wheel.kind,
        "x": x,
        "y": y,
        "z": wheel.height,
        "r": wheel.r,
        "heading": wheel.heading,
    }
    if wheel.kind in ("steerable", "caster"):
        facts["angle"] = wheel.angle if angle is None else angle
    facts |= {k: getattr(wheel, k) for k in _SPECIAL if k in wheel.model_fields_set}
    at = {name: inverse.wheels[wheel.name] for name, inverse in axes.items() if inverse.exact}
    facts["speeds"] = {name: at[name].speed if name in at else None for name in AXES}
    if "angle" in facts:
        facts["angles"] = {name: at[name].angle if name in at else None for name in AXES}
    return facts


def icr_document(icr: Icr) -> dict[str, Any]:
    """An instantaneous centre: kind, x, y [m], direction and a sentence."""
    x, y = icr.point or (None, None)
    return {
        "kind": icr.kind.name.lower(),
        "x": x,
        "y": y,
        "direction": icr.direction,
        "sentence": icr_words(icr),
    }


def inverse_document(vehicle: Vehicle, inverse: InverseKinematics) -> dict[str, Any]:
    """An answer of inverse kinematics."""
    return {
        "wanted": _twist(inverse.wanted),
        "possible": _twist(inverse.possible),
        "impossible": _twist(inverse.impossible),
        "residual_m_s": inverse.residual,
        "slowdown": inverse.slowdown,
        "wheels": {
            name: {"speed": w.speed, "angle": w.angle, "share_of_max_speed": w.over}
            for name, w in inverse.wheels.items()
        },
        "icr": icr_document(icr_of_twist(inverse.possible, Scale.of(vehicle.wheels))),
        "sentence": inverse_words(inverse),
    }


def forward_document(vehicle: Vehicle, forward: ForwardKinematics) -> dict[str, Any]:
    """An answer of forward kinematics."""
    return {
        "twist": _twist(forward.twist),
        "rolling_slip_m_s": forward.rolling,
        "sliding_m_s": forward.sliding,
        "residual_m_s": forward.residual,
        "icr": icr_document(icr_of_twist(forward.twist, Scale.of(vehicle.wheels))),
        "sentence": forward_words(forward),
    }


def _twist(twist: Any) -> dict[str, float]:
    return {name: float(value) for name, value in zip(AXES, twist, strict=True)}
