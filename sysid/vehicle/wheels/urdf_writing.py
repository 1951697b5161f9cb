"""A vehicle as a URDF: a box on cylinders, with masses, inertia tensors and friction.

Steering angles and rollers, for which a URDF has no place, stand in elements ``sysid``, which other
programs pass over.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from sysid.data.record import Array
from sysid.vehicle.wheels.body import MassProperties
from sysid.vehicle.wheels.vehicle import FORK, Vehicle, wheel_properties, wheel_width
from sysid.vehicle.wheels.wheel import Wheel

BASE = "base_link"

_NO_LIMIT = 1e6
"""URDF asks for a limit of effort wherever there is another limit; 0 would block the joint."""

_LEVEL = (0.0, 0.0, 0.0)


def urdf_text(vehicle: Vehicle) -> str:
    """The vehicle as the text of a URDF file; :func:`load_vehicle` reads it back.

    Masses that only the whole has are shared out as in :meth:`Vehicle.with_masses`; parts without
    a known mass have no inertia, and a simulator will ask for it.
    """
    whole = vehicle.with_masses()
    lines = _base(whole)
    for wheel in whole.wheels:
        lines += _wheel(wheel)
    if vehicle.friction is not None:
        grip = [f"<mu{k}>{vehicle.friction!r}</mu{k}>" for k in (1, 2)]
        for wheel in whole.wheels:
            lines += _element("gazebo", grip, reference=_link(wheel))
    return "\n".join(['<?xml version="1.0"?>', *_element("robot", lines, name=vehicle.name), ""])


def _element(tag: str, inner: Sequence[str] = (), **attributes: Any) -> list[str]:
    """An element as lines; numbers unrounded, none of them −0."""

    def words(value: Any) -> str:
        if isinstance(value, Iterable) and not isinstance(value, str):
            return " ".join(map(words, value))
        return value if isinstance(value, str) else repr(float(value) + 0.0)

    head = tag + "".join(f" {name}={quoteattr(words(v))}" for name, v in attributes.items())
    return [f"<{head}>", *(f"  {line}" for line in inner), f"</{tag}>"] if inner else [f"<{head}/>"]


def _link(wheel: Wheel) -> str:
    return f"{wheel.name}_link"


def _base(vehicle: Vehicle) -> list[str]:
    body, inner = vehicle.body, []
    if body.size is not None:
        inner = _shape(_element("box", size=body.size), body.at)
    properties = vehicle.body_properties()
    inner += _inertial(properties, properties.centre) if properties is not None else []
    return _element("link", inner, name=BASE)


def _wheel(wheel: Wheel) -> list[str]:
    """A link and its joint, on a steered wheel behind one more of each."""
    link, parent, lines, heading = _link(wheel), BASE, list[str](), wheel.heading
    place: Sequence[float] = (*wheel.position, wheel.height)
    if wheel.kind in ("steerable", "caster"):
        parent, lines = f"{wheel.name}_steering_link", _steering(wheel)
        place, heading = (-wheel.offset, wheel.side, 0.0), 0.0
    cylinder = _element("cylinder", radius=wheel.r, length=wheel_width(wheel))
    shape = _shape(cylinder, (0.0, 0.0, 0.0), (math.pi / 2, 0.0, 0.0))  # its axis along y
    straight = wheel.model_copy(update={"heading": 0.0, "angle": 0.0})
    properties, fork = wheel_properties(straight), FORK if parent != BASE else 0.0
    if properties is not None:
        shape += _inertial(properties.share(1.0 - fork), np.zeros(3))
    joint = _joint(parent, link, place, heading, "0 1 0")
    if wheel.max_speed is not None:
        joint += _element("limit", effort=_NO_LIMIT, velocity=wheel.max_speed)
    kept: dict[str, Any] = {"roller": wheel.roller} if wheel.kind == "swedish" else {}
    kept |= {"angle": wheel.angle} if wheel.angle else {}
    return [
        *lines,
        *_element("link", shape, name=link),
        *_element("joint", joint, name=wheel.name, type="continuous"),
        *(_element("sysid", reference=link, **kept) if kept else []),
    ]


def _steering(wheel: Wheel) -> list[str]:
    link, limits = f"{wheel.name}_steering_link", wheel.angle_limits
    joint = _joint(BASE, link, (*wheel.position, wheel.height), wheel.heading, "0 0 1")
    if limits is not None:
        low, high = limits
        joint += _element("limit", lower=low, upper=high, effort=_NO_LIMIT, velocity=_NO_LIMIT)
    properties = wheel_properties(wheel.model_copy(update={"heading": 0.0, "angle": 0.0}))
    middle = np.array([-wheel.offset, wheel.side, 0.0])
    mass = _inertial(properties.share(FORK), middle) if properties is not None else []
    kind = "continuous" if limits is None else "revolute"
    return [
        *_element("link", mass, name=link),
        *_element("joint", joint, name=f"{wheel.name}_steering", type=kind),
    ]


def _joint(parent: str, child: str, place: Sequence[float], heading: float, axis: str) -> list[str]:
    return [
        *_element("parent", link=parent),
        *_element("child", link=child),
        *_element("origin", xyz=place, rpy=(0.0, 0.0, heading)),
        *_element("axis", xyz=axis),
    ]


def _shape(geometry: list[str], at: Sequence[float], rpy: Sequence[float] = _LEVEL) -> list[str]:
    """The same shape to be seen and to be hit."""
    inner = [*_element("origin", xyz=at, rpy=rpy), *_element("geometry", geometry)]
    return [*_element("visual", inner), *_element("collision", inner)]


def _inertial(properties: MassProperties, centre: Array) -> list[str]:
    pairs = itertools.combinations_with_replacement(range(3), 2)
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    entries: Any = {n: properties.tensor[k] for n, k in zip(names, pairs, strict=True)}
    inner = [
        *_element("origin", xyz=centre, rpy=_LEVEL),
        *_element("mass", value=properties.mass),
        *_element("inertia", **entries),
    ]
    return _element("inertial", inner)
