"""A vehicle as a URDF: a box on cylinders, with masses, inertia tensors and friction.

Steering angles and rollers, for which a URDF has no place, stand in elements ``sysid``, which other
programs pass over.
"""

import math
from collections.abc import Iterable, Sequence
from xml.sax.saxutils import quoteattr

import numpy as np

from sysid.data.record import Array
from sysid.vehicle.wheels.body import MassProperties
from sysid.vehicle.wheels.vehicle import FORK, Vehicle, wheel_properties, wheel_width
from sysid.vehicle.wheels.wheel import Wheel

BASE = "base_link"

_NO_LIMIT = 'effort="1000000.0"'
"""URDF asks for a limit of effort wherever there is another limit; 0 would block the joint."""


def urdf_text(vehicle: Vehicle) -> str:
    """The vehicle as the text of a URDF file; :func:`load_vehicle` reads it back.

    Masses that only the whole has are shared out as in :meth:`Vehicle.with_masses`; parts without
    a known mass have no inertia, and a simulator will ask for it.
    """
    whole = vehicle.with_masses()
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(vehicle.name)}>"]
    lines += _base(whole)
    for wheel in whole.wheels:
        lines += _wheel(wheel)
    if vehicle.friction is not None:
        for wheel in whole.wheels:
            mu = repr(vehicle.friction)
            lines += [
                f"  <gazebo reference={quoteattr(_link(wheel))}>",
                f"    <mu1>{mu}</mu1>",
                f"    <mu2>{mu}</mu2>",
                "  </gazebo>",
            ]
    return "\n".join([*lines, "</robot>", ""])


def _link(wheel: Wheel) -> str:
    return f"{wheel.name}_link"


def _base(vehicle: Vehicle) -> list[str]:
    body, inner = vehicle.body, []
    if body.size is not None:
        inner = _shape(f'<box size="{_numbers(body.size)}"/>', body.at)
    properties = vehicle.body_properties()
    return _element(
        "link", BASE, [*inner, *(_inertial(properties) if properties is not None else ())]
    )


def _wheel(wheel: Wheel) -> list[str]:
    """A link and its joint, on a steered wheel behind one more of each."""
    name, link = wheel.name, _link(wheel)
    lines, parent, heading = [], BASE, wheel.heading
    place: Sequence[float] = (*wheel.position, wheel.height)
    if wheel.kind in ("steerable", "caster"):
        parent, lines = f"{name}_steering_link", _steering(wheel)
        place, heading = (-wheel.offset, wheel.side, 0.0), 0.0
    cylinder = f'<cylinder radius="{wheel.r!r}" length="{wheel_width(wheel)!r}"/>'
    shape = _shape(cylinder, (0.0, 0.0, 0.0), f"{math.pi / 2!r} 0 0")  # its axis along y
    straight = wheel.model_copy(update={"heading": 0.0, "angle": 0.0})
    properties, fork = wheel_properties(straight), FORK if parent != BASE else 0.0
    if properties is not None:
        shape += _inertial(_share(properties, 1.0 - fork, np.zeros(3)))
    speed = "" if wheel.max_speed is None else f' velocity="{wheel.max_speed!r}"'
    joint = _joint(parent, link, place, heading, "0 1 0")
    joint += [f"    <limit {_NO_LIMIT}{speed}/>"] if speed else []
    kept = {}
    if wheel.kind == "swedish":
        kept["roller"] = wheel.roller
    if wheel.angle:
        kept["angle"] = wheel.angle
    own_words = "".join(f' {key}="{value!r}"' for key, value in kept.items())
    return [
        *lines,
        *_element("link", link, shape),
        *_element("joint", name, joint, ' type="continuous"'),
        *([f"  <sysid reference={quoteattr(link)}{own_words}/>"] if kept else []),
    ]


def _steering(wheel: Wheel) -> list[str]:
    link, limits = f"{wheel.name}_steering_link", wheel.angle_limits
    joint = _joint(BASE, link, (*wheel.position, wheel.height), wheel.heading, "0 0 1")
    kind = "continuous" if limits is None else "revolute"
    if limits is not None:
        low, high = limits
        free = f'{_NO_LIMIT} velocity="1000000.0"'
        joint.append(f'    <limit lower="{low!r}" upper="{high!r}" {free}/>')
    properties = wheel_properties(wheel.model_copy(update={"heading": 0.0, "angle": 0.0}))
    middle = np.array([-wheel.offset, wheel.side, 0.0])
    mass = _inertial(_share(properties, FORK, middle)) if properties is not None else []
    return [
        *_element("link", link, mass),
        *_element("joint", f"{wheel.name}_steering", joint, f' type="{kind}"'),
    ]


def _share(properties: MassProperties, share: float, centre: Array) -> MassProperties:
    """A share of a wheel's mass and inertia, so that all shares together are the wheel's."""
    return MassProperties(share * properties.mass, centre, share * properties.tensor)


def _joint(parent: str, child: str, place: Sequence[float], heading: float, axis: str) -> list[str]:
    return [
        f"    <parent link={quoteattr(parent)}/>",
        f"    <child link={quoteattr(child)}/>",
        f'    <origin xyz="{_numbers(place)}" rpy="0 0 {heading + 0.0!r}"/>',
        f'    <axis xyz="{axis}"/>',
    ]


def _element(tag: str, name: str, inner: Sequence[str], more: str = "") -> list[str]:
    return [f"  <{tag} name={quoteattr(name)}{more}>", *inner, f"  </{tag}>"]


def _shape(geometry: str, at: Sequence[float], rpy: str = "0 0 0") -> list[str]:
    """The same shape to be seen and to be hit."""
    lines = []
    for part in ("visual", "collision"):
        lines += [
            f"    <{part}>",
            f'      <origin xyz="{_numbers(at)}" rpy="{rpy}"/>',
            f"      <geometry>{geometry}</geometry>",
            f"    </{part}>",
        ]
    return lines


def _inertial(properties: MassProperties) -> list[str]:
    t = properties.tensor.tolist()
    entries = {
        "ixx": t[0][0],
        "ixy": t[0][1],
        "ixz": t[0][2],
        "iyy": t[1][1],
        "iyz": t[1][2],
        "izz": t[2][2],
    }
    words = " ".join(f'{name}="{value!r}"' for name, value in entries.items())
    return [
        "    <inertial>",
        f'      <origin xyz="{_numbers(properties.centre)}" rpy="0 0 0"/>',
        f'      <mass value="{properties.mass!r}"/>',
        f"      <inertia {words}/>",
        "    </inertial>",
    ]


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(v) + 0.0) for v in values)  # + 0.0: no -0.0
