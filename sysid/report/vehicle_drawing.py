"""The picture of a vehicle from above: body, wheels, their axles and the centre of rotation."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.report.missions.panels import GREY, through
from sysid.report.panels import Curve, Panel, draw_panels
from sysid.vehicle.wheels.vehicle import AXES, Vehicle, wheel_width
from sysid.vehicle.wheels.wheel import Wheel, velocity_at

AXLE, VELOCITY, CENTRE = 3, 4, 5
"""Colours of what belongs to no kind of wheel."""

KINDS = {
    "fixed": ("fixed wheel", 0),
    "steerable": ("steerable wheel", 1),
    "caster": ("caster wheel", GREY),
    "swedish": ("Swedish wheel", 2),
}
"""Name and colour of each kind."""

FARTHEST = 2.0
"""Sizes of the vehicle up to which a centre of turning is shown in its place, not by an arrow."""


def draw_vehicle(path: Path, vehicle: Vehicle, facts: Mapping[str, Any]) -> None:
    """Draw wheels, axles and centre; those of the motion where one is asked for."""
    motion = facts.get("inverse") or facts.get("forward") or {}
    commands = facts.get("inverse", {}).get("wheels", {})
    twist = motion.get("possible") or motion.get("twist")
    stated = {w["name"]: w.get("angle") for w in facts["wheels"]}
    angles = {n: a if (a := commands.get(n, {}).get("angle")) is not None else stated[n]
              for n in stated}  # fmt: skip
    covered = _body(vehicle) + [_rectangle(w, angles[w.name]) for w in vehicle.wheels]
    points = np.concatenate([np.column_stack([c.x, c.y]) for c in covered])
    size = float(np.ptp(points, axis=0).max())
    icr, middle = motion.get("icr") or facts["icr"], points.mean(axis=0)
    centre = None if icr["x"] is None else np.array([icr["x"], icr["y"]])
    near = centre is not None and math.dist(centre, middle) <= FARTHEST * size
    curves = [*_axes_of_body(0.12 * size), *covered]
    for wheel in vehicle.wheels:
        curves += _parts(wheel, angles[wheel.name], size, centre if near else None)
        speed = commands.get(wheel.name, {}).get("speed")
        name = wheel.name if speed is None else f"{wheel.name}: {speed:.3g} rad/s"
        curves.append(through(name, np.array([wheel.contact(angles[wheel.name])]), kind="words"))
    if twist is not None:
        at = np.array([w.contact(angles[w.name]) for w in vehicle.wheels])
        moving = np.array([velocity_at((x, y), np.array([twist[a] for a in AXES])) for x, y in at])
        scale = 0.3 * size / max(float(np.hypot(*moving.T).max()), 1e-12)
        curves += [_arrow("velocity", a, a + scale * v, VELOCITY) for a, v in
                   zip(at, moving, strict=True)]  # fmt: skip
    if (mass := facts["centre_of_mass_m"]) is not None:
        at = np.array([mass[:2]])
        curves += [through("", at, kind="dots"), through("centre of mass", at, kind="words")]
    if centre is not None:
        curves += _centre(centre, icr["direction"], middle, size, near)
    words = "mobility {}, steerability {}, manoeuvrability {}; {}".format(
        *(facts[k] for k in ("mobility", "steerability", "manoeuvrability")), icr["sentence"]
    )
    axes = ("x, forward [m]", "y, to the left [m]")
    panel = Panel("vehicle", "From above", *axes, tuple(curves), equal=True, large=True)
    draw_panels(path, vehicle.name, words, (panel,))


def _box(x: float, y: float, along: Array, length: float, width: float) -> Array:
    """Corners of a rectangle around (x, y), its length in the direction ``along``, (4, 2)."""
    half = 0.5 * np.array([[length, width], [-length, width], [-length, -width], [length, -width]])
    corners: Array = half @ np.array([along, [-along[1], along[0]]]) + [x, y]
    return corners


def _body(vehicle: Vehicle) -> list[Curve]:
    """The body where its size is known, and its tracks.

    Tracks are not where the wheels stand that turn the body as they do.
    """
    body, tracks, forward = vehicle.body, vehicle.tracks, np.array([1.0, 0.0])
    boxes = [] if body.size is None else [(*body.at[:2], forward, *body.size[:2])]
    if tracks is not None:
        wide = wheel_width(vehicle.wheels[0])
        boxes += [(0.0, side * tracks.width / 2, forward, tracks.contact_length, wide)
                  for side in (1.0, -1.0)]  # fmt: skip
    return [through("", _box(*box), kind="area", colour=GREY) for box in boxes]


def _axes_of_body(reach: float) -> list[Curve]:
    """The axes x and y of the body, and their names."""
    ends = {"x": np.array([reach, 0.0]), "y": np.array([0.0, reach])}
    names = [through(n, end[None], kind="words") for n, end in ends.items()]
    return [*(_arrow("", np.zeros(2), end, GREY) for end in ends.values()), *names]


def _direction(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle)])


def _rectangle(wheel: Wheel, angle: float | None) -> Curve:
    """A wheel from above."""
    name, colour = KINDS[wheel.kind]
    along = _direction(wheel.direction(angle))
    corners = _box(*wheel.contact(angle), along, 2.0 * wheel.r, wheel_width(wheel))
    return through(name, corners, kind="area", colour=colour)


def _parts(wheel: Wheel, angle: float | None, size: float, centre: Array | None) -> list[Curve]:
    """The axle of a wheel that cannot slide, the fork of one that turns, the rollers of a third.

    An axle reaches the centre of turning where that is near.
    """
    middle, along = np.array(wheel.contact(angle)), _direction(wheel.direction(angle))
    left, curves = np.array([-along[1], along[0]]), []
    if wheel.kind in ("fixed", "steerable"):
        far = 0.0 if centre is None else float((centre - middle) @ left)
        reach = np.array([min(far, -0.2 * size), max(far, 0.2 * size)])
        curves.append(through("axle", middle + np.outer(reach, left), colour=AXLE))
    if wheel.kind in ("steerable", "caster"):
        curves.append(through("", np.array([wheel.position, middle]), colour=GREY))
        curves.append(through("", np.array([wheel.position]), kind="dots", colour=GREY))
    if wheel.kind == "swedish":
        roller = _direction(wheel.direction(angle) + wheel.roller)
        half = min(wheel_width(wheel) / 2 / max(abs(float(roller @ left)), 1e-9), wheel.r / 2)
        for share in (-0.6, -0.2, 0.2, 0.6):
            ends = middle + share * wheel.r * along + np.outer((-half, half), roller)
            curves.append(through("", ends, colour=KINDS["swedish"][1]))
    return curves


def _arrow(label: str, tail: Array, tip: Array, colour: int) -> Curve:
    """An arrow as one line: to its tip, and the head."""
    way = tip - tail
    side = 0.08 * np.array([-way[1], way[0]])
    head = [tip - 0.2 * way + side, tip, tip - 0.2 * way - side]
    return through(label, np.array([tail, tip, *head]), colour=colour)


def _centre(
    centre: Array, line: tuple[float, float] | None, middle: Array, size: float, near: bool
) -> list[Curve]:
    """The centre of turning, the line of possible ones, or the way to one that is far."""
    if line is not None:
        ends = centre + size * np.array([[-1.0], [1.0]]) * np.array(line)
        return [through("possible centres of turning", ends, colour=CENTRE)]
    if near:
        return [through("centre of turning", centre[None], kind="marks", colour=CENTRE)]
    tip = middle + 0.7 * size * (centre - middle) / math.dist(centre, middle)
    words = "centre of turning at ({:.3g}, {:.3g}) m".format(*centre)
    return [_arrow("", middle, tip, CENTRE), through(words, tip[None], kind="words")]
