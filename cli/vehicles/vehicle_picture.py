"""From a described vehicle to its picture."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sysid.vehicle.wheels.vehicle import Vehicle


def draw(path: Path, vehicle: "Vehicle", facts: dict[str, Any]) -> None:
    """Draw wheels, axles and centre; those of the motion where one is asked for."""
    import numpy as np

    from sysid.report.plots import VehiclePicture, WheelMark, write_picture
    from sysid.vehicle.wheels.vehicle import AXES, wheel_width
    from sysid.vehicle.wheels.wheel import velocity_at

    motion = facts.get("inverse") or facts.get("forward") or {}
    twist = motion.get("possible") or motion.get("twist")
    commands = facts.get("inverse", {}).get("wheels", {})
    shown = {w["name"]: w for w in facts["wheels"]}
    marks = []
    for wheel in vehicle.wheels:
        command = commands.get(wheel.name, {})
        angle = command.get("angle")
        angle = shown[wheel.name].get("angle") if angle is None else angle
        contact, velocity = wheel.contact(angle), None
        if twist is not None:
            velocity = velocity_at(contact, np.array([twist[axis] for axis in AXES]))
        speed = command.get("speed")
        marks.append(
            WheelMark(
                name=wheel.name,
                kind=wheel.kind,
                axis=wheel.position,
                contact=contact,
                direction=wheel.direction(angle),
                radius=wheel.r,
                width=wheel_width(wheel),
                roller=wheel.roller,
                note="" if speed is None else f"{speed:.3g} rad/s",
                velocity=velocity,
            )
        )
    icr, body = motion.get("icr") or facts["icr"], vehicle.body
    mass_centre = facts["centre_of_mass_m"]
    degrees = (facts[k] for k in ("mobility", "steerability", "manoeuvrability"))
    picture = VehiclePicture(
        title=vehicle.name,
        subtitle="mobility {}, steerability {}, manoeuvrability {}; {}".format(
            *degrees, icr["sentence"]
        ),
        wheels=marks,
        box=None if body.size is None else (*body.at[:2], *body.size[:2]),
        centre=None if icr["x"] is None else (icr["x"], icr["y"]),
        line=icr["direction"] if icr["kind"] == "line" else None,
        tracks=_tracks(vehicle),
        mass_centre=None if mass_centre is None else (mass_centre[0], mass_centre[1]),
    )
    write_picture(path, picture)


def _tracks(vehicle: "Vehicle") -> list[tuple[float, float, float, float]]:
    """Tracks where they are, which is not where the wheels stand that turn the body as they do."""
    from sysid.vehicle.wheels.vehicle import wheel_width

    tracks = vehicle.tracks
    if tracks is None:
        return []
    width = wheel_width(vehicle.wheels[0])
    return [(0.0, y, tracks.contact_length, width) for y in (tracks.width / 2, -tracks.width / 2)]
