"""A vehicle as a MuJoCo model (MJCF) on a level floor: it stands, drives and turns as it is.

Tracks are rows of road wheels that turn together (:mod:`sysid.vehicle.wheels.mjcf_parts`), other
wheels touch the floor in a point, Swedish wheels carry rollers. Every driven wheel and track has an
actuator of its name that holds a speed [rad/s], every steered wheel one that holds an angle [rad].
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from xml.sax.saxutils import quoteattr

import numpy as np

from sysid.errors import ModelError
from sysid.vehicle.tracked import G
from sysid.vehicle.wheels.body import MassProperties
from sysid.vehicle.wheels.mjcf_parts import (
    ROAD_WHEELS,
    Axle,
    Row,
    block,
    floor,
    friction,
    options,
    under_a_track,
    words,
)
from sysid.vehicle.wheels.vehicle import FORK, Vehicle, wheel_properties, wheel_width
from sysid.vehicle.wheels.wheel import Wheel

ROLLERS = 12
"""Round one Swedish wheel: their barrels then overlap, whatever their angle up to π/4."""

SLIM = 0.2
"""Radius of a roller over that of its wheel."""

ROLLERS_SHARE = 0.5
"""Of a Swedish wheel's mass in its rollers."""

DENSITY = 1000.0
"""Of wheels of unknown mass [kg/m³]: what MuJoCo takes for a shape without a mass."""

TURNED = 2.0
"""What a motor turns with its wheel, over (share of the vehicle's mass) r²: that of the thesis's
rotors behind their gear."""

SERVO_TIME = 0.001
"""In which a servo brings what it turns to its speed [s]: one step, below which it would swing."""

STEERING_TIME = 0.05
"""In which a steering servo comes to its angle [s]."""


@dataclass(frozen=True)
class _Part:
    """What one wheel or track adds to a model: bodies, constraints and actuators."""

    bodies: list[str]
    together: list[str]
    actuators: list[str]


def mjcf_text(vehicle: Vehicle) -> str:
    """The vehicle as the text of an MJCF file, standing on its floor at the origin.

    Masses that only the whole has are shared out as in :meth:`Vehicle.with_masses`; a wheel
    of unknown mass is taken as solid and as dense as water, which is MuJoCo's own assumption.
    """
    whole = _weighed(vehicle.with_masses())
    body = whole.body_properties()
    if body is None:
        raise ModelError(
            f"{vehicle.name}: a MuJoCo model needs the mass of the body, and its size or inertia: "
            "give mass (of the whole) and body: {size: [length, width, height]}"
        )
    ground = min(w.height - w.r for w in whole.wheels)
    total = body.mass + sum(w.mass or 0.0 for w in whole.wheels)
    load = total * G / len(whole.wheels)
    part = _track if whole.tracks is not None else _wheel
    parts = [part(whole, wheel, load) for wheel in whole.wheels]
    frame = f' name="base_link" pos="{words((0.0, 0.0, -ground))}"'
    inside = ["<freejoint/>", *_body(whole, body, ground)]
    inside += [line for p in parts for line in p.bodies]
    lines = [
        '<compiler angle="radian"/>',
        *options(),
        *block("worldbody", [*floor(whole.friction), *block("body", inside, frame)]),
        *block("equality", [line for p in parts for line in p.together]),
        *block("actuator", [line for p in parts for line in p.actuators]),
    ]
    return "\n".join([*block("mujoco", lines, f" model={quoteattr(vehicle.name)}"), ""])


def _weighed(vehicle: Vehicle) -> Vehicle:
    """The vehicle with a mass for every wheel."""
    wheels = [
        w
        if w.mass is not None
        else w.model_copy(update={"mass": DENSITY * math.pi * w.r**2 * wheel_width(w)})
        for w in vehicle.wheels
    ]
    return replace(vehicle, wheels=tuple(wheels))


def _body(vehicle: Vehicle, properties: MassProperties, ground: float) -> list[str]:
    """Mass and box of the body, which touches the floor only where it stands clear of it."""
    lines, body = [_inertial(properties)], vehicle.body
    if body.size is not None:
        clear = body.at[2] - 0.5 * body.size[2] > ground
        lines.append(
            f'<geom class="body" type="box" pos="{words(body.at)}" '
            f'size="{words(0.5 * s for s in body.size)}"{friction(vehicle.friction)}'
            f'{_ON_FLOOR if clear else ""} rgba=".27 .42 .62 1"/>'
        )
    return lines


_ON_FLOOR = ' conaffinity="3"'


def _track(vehicle: Vehicle, wheel: Wheel, load: float) -> _Part:
    """A row of road wheels at the geometric width: the effective one comes from scrubbing."""
    assert vehicle.tracks is not None
    x, y = wheel.position
    places = tuple((x + under_a_track(vehicle.tracks.contact_length)).tolist())
    row = Row(
        wheel.name,
        math.copysign(0.5 * vehicle.tracks.width, y),
        wheel.height,
        places,
        wheel.r,
        (wheel.mass or 0.0) / ROAD_WHEELS,
        load / ROAD_WHEELS,
        vehicle.friction,
        Axle(_turned(wheel, load)),
    )
    return _Part(row.wheels, row.together, [row.servo()])


def _wheel(vehicle: Vehicle, wheel: Wheel, load: float) -> _Part:
    name = quoteattr(wheel.name)
    steered = wheel.kind in ("steerable", "caster")
    straight = wheel.model_copy(update={"heading": 0.0, "angle": 0.0, "at": (0.0, 0.0, 0.0)})
    properties = wheel_properties(straight)
    assert properties is not None
    place = (*wheel.position, wheel.height)
    inner = _rolling(wheel, properties, friction(vehicle.friction), 1.0 - FORK if steered else 1.0)
    rotor = "" if wheel.kind == "caster" else f' armature="{_turned(wheel, load)!r}"'
    turn = f'<joint name={name} axis="0 1 0"{rotor}/>'
    if not steered:
        frame = f" name={quoteattr(wheel.name + '_wheel')}{_pose(place, wheel.heading)}"
        bodies = block("body", [turn, *inner], frame)
    else:
        hub = f" name={quoteattr(wheel.name + '_wheel')}{_pose((-wheel.offset, wheel.side, 0.0))}"
        frame = f" name={quoteattr(wheel.name + '_fork')}{_pose(place, wheel.direction())}"
        inside = [
            _steering_joint(wheel, load),
            _inertial(properties.share(FORK)),
            *block("body", [turn, *inner], hub),
        ]
        bodies = block("body", inside, frame)
    return _Part(bodies, [], _servos(wheel, load))


def _turned(wheel: Wheel, load: float) -> float:
    """Moment of inertia that a servo turns besides the wheel [kg m²]."""
    return TURNED * load / G * wheel.r**2


def _servos(wheel: Wheel, load: float) -> list[str]:
    """What holds a wheel's speed and angle; a caster turns by itself."""
    if wheel.kind == "caster":
        return []
    name, kv = quoteattr(wheel.name), _turned(wheel, load) / SERVO_TIME
    lines = [f'<velocity name={name} joint={name} kv="{kv!r}"/>']
    if wheel.kind == "steerable":
        joint = quoteattr(f"{wheel.name}_steering")
        kp = kv / STEERING_TIME
        lines.append(f'<position name={joint} joint={joint} kp="{kp!r}" kv="{kv!r}"/>')
    return lines


def _steering_joint(wheel: Wheel, load: float) -> str:
    limits, rotor = wheel.angle_limits, ""
    if wheel.kind == "steerable":
        rotor = f' armature="{_turned(wheel, load)!r}"'
    bounds = "" if limits is None else f' limited="true" range="{words(limits)}"'
    name = quoteattr(f"{wheel.name}_steering")
    return f'<joint name={name} axis="0 0 1" ref="{wheel.angle!r}"{rotor}{bounds}/>'


def _rolling(wheel: Wheel, properties: MassProperties, grip: str, share: float) -> list[str]:
    """Mass and rim of a wheel in its own frame, its axle along y.

    The rim is an ellipsoid: a cylinder touches a plane along a line, the ends of which would scrub
    in every turn and hold casters fast, however narrow the tyre is.
    """
    if wheel.kind == "swedish":
        return _swedish(wheel, properties, grip)
    size = words((wheel.r, 0.5 * wheel_width(wheel), wheel.r))
    return [
        _inertial(properties.share(share)),
        f'<geom class="wheel" type="ellipsoid" size="{size}"{grip}/>',
    ]


def _swedish(wheel: Wheel, properties: MassProperties, grip: str) -> list[str]:
    """A hub with rollers round it, barrels whose flanks follow the rim.

    A roller whose middle is at the angle α round the axle points along cos γ t + sin γ n, with t
    along the rim there and n along the axle. Its barrel is an ellipsoid of half length a and radius
    ρ, round along its flank with the radius a²/ρ = r/cos² γ, that of the rim cut along it.
    """
    slim = SLIM * wheel.r
    half = math.sqrt(slim * wheel.r) / math.cos(wheel.roller)
    mass = ROLLERS_SHARE * properties.mass / ROLLERS
    moment = 0.4 * mass * slim**2  # of a ball
    lines = [_inertial(properties.share(1.0 - ROLLERS_SHARE))]
    c, s = math.cos(wheel.roller), math.sin(wheel.roller)
    for k in range(ROLLERS):
        alpha = 2.0 * math.pi * k / ROLLERS - 0.5 * math.pi
        ca, sa = math.cos(alpha), math.sin(alpha)
        out, along = np.array([ca, 0.0, sa]), np.array([-sa * c, s, ca * c])
        axes = words((*along, *np.cross(out, along)))
        frame = f'pos="{words((wheel.r - slim) * out)}" xyaxes="{axes}"'
        inner = [
            '<joint axis="1 0 0"/>',
            f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="{words((moment,) * 3)}"/>',
            f'<geom class="wheel" type="ellipsoid" size="{words((half, slim, slim))}"{grip}/>',
        ]
        lines += block("body", inner, f" {frame}")
    return lines


def _pose(place: Sequence[float], heading: float = 0.0) -> str:
    turned = (math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading))
    return f' pos="{words(place)}"' + (f' quat="{words(turned)}"' if heading else "")


def _inertial(properties: MassProperties) -> str:
    t = properties.tensor
    entries = (t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[0, 2], t[1, 2])
    place = f'pos="{words(properties.centre)}" mass="{properties.mass!r}"'
    return f'<inertial {place} fullinertia="{words(entries)}"/>'
