"""A vehicle and its kinematics as plain documents, to be printed or stored."""

from typing import Any

from sysid.vehicle.wheels.constraints import Angles, Scale
from sysid.vehicle.wheels.findings import (
    forward_words,
    icr_words,
    inverse_words,
    notes,
    type_words,
)
from sysid.vehicle.wheels.mobility import Icr, icr_of_twist
from sysid.vehicle.wheels.twists import ForwardKinematics, InverseKinematics
from sysid.vehicle.wheels.vehicle import AXES, Vehicle
from sysid.vehicle.wheels.wheel import Wheel

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
