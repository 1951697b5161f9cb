"""A vehicle from a URDF: its wheels are joints that turn freely about a level axis.

A level ``continuous`` joint whose link holds a cylinder round it, or a sphere, is a wheel, called
as its joint. One that hangs on a joint with an upright axis is steerable, or a caster where its
contact trails behind that axis. What stands above the ground, or carries other moving parts, is a
gear. Everything else counts as the body at its zero position.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.vehicle.kinematics import wrap_angle
from sysid.vehicle.wheels.body import Body, Inertia, MassProperties, combined
from sysid.vehicle.wheels.urdf_links import BASE, Joint, Pose, Robot, Shape
from sysid.vehicle.wheels.vehicle import Vehicle
from sysid.vehicle.wheels.wheel import Wheel
from sysid.vehicle.wheels.xml_source import XmlElement, read_xml

TILT = 0.17
"""Sine of 10°: up to there an axis counts as level or upright, as cambered wheels are."""

DECIMALS = 12
"""Decimals of lengths and angles [m, rad] behind which products of rotations only round."""

LEAST_TRAIL = 0.01
"""Share of the radius below which a steered wheel does not trail: casters trail by a fifth of it or
more, angles written as 1.57 shift a contact by a thousandth."""

LIFTED = 0.5
"""Share of its radius by which what turns may stand above the ground and still be a wheel, as those
of a suspension at rest do; gears and pulleys stand higher."""


def read_urdf(path: Path) -> Vehicle:
    """The vehicle that a URDF describes, in the frame of its base link."""
    robot = Robot(read_xml(path), path.name)
    walk = _Walk(robot)
    if not walk.wheels:
        looked = f" ({'; '.join(walk.notes)})" if walk.notes else ""
        raise robot.wrong(
            robot.top.line,
            "no wheel is found: a wheel is a continuous joint with a level axis whose link has a "
            f"cylinder or sphere{looked}",
        )
    try:
        return Vehicle(
            tuple(walk.wheels),
            name=robot.name,
            body=_body(walk.body, walk.boxes),
            friction=_friction(robot),
            notes=tuple(walk.notes),
        )
    except ModelError as error:
        raise robot.wrong(robot.top.line, str(error)) from None


class _Walk:
    """One way through the tree: wheels, the masses of the rest, boxes, and what was passed over."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.wheels: list[Wheel] = []
        self.body: list[MassProperties] = []
        self.boxes: list[tuple[Pose, Shape]] = []
        self.notes: list[str] = []
        self._more = {e.attributes.get("reference", ""): e for e in robot.top.all("sysid")}
        self._masses: list[list[MassProperties]] = []
        self._forks: dict[str, list[MassProperties]] = {}  # by the joint that turns them
        self._visit(robot.root, BASE, None)
        self._leave_lifted()
        self.body += [part for fork in self._forks.values() for part in fork]

    def _visit(self, link: str, pose: Pose, steering: tuple[Joint, Pose] | None) -> None:
        """Count a link to the body, and go on to what hangs on it."""
        properties = self.robot.properties(link)
        if properties is not None:
            carried = self._forks.setdefault(steering[0].name, []) if steering else self.body
            carried.append(pose.placed(properties))
        self.boxes += [(pose, s) for s in self.robot.shapes(link) if s.kind == "box"]
        for joint in self.robot.below(link):
            there = pose.then(joint.origin)
            axis = there.axes @ joint.axis
            upright, level = abs(axis[2]) > math.sqrt(1 - TILT**2), abs(axis[2]) < TILT
            if joint.kind == "continuous" and level and self._is_wheel(joint, there, steering):
                continue
            turns = joint.kind in ("continuous", "revolute") and upright
            if turns and steering is None:
                self._visit(joint.child, there, (joint, there))
            else:
                if joint.kind != "fixed":
                    self.notes.append(f"joint {joint.name} ({joint.kind}) is taken at position 0")
                self._visit(joint.child, there, steering)

    def _is_wheel(self, joint: Joint, pose: Pose, steering: tuple[Joint, Pose] | None) -> bool:
        """Add the wheel of a joint, if its links hold a shape that rolls about its axis."""
        axle = pose.axes @ joint.axis
        links = list(self._rigid(joint.child, pose))
        if any(j.kind != "fixed" for link, _ in links for j in self.robot.below(link)):
            return False
        rolling = [
            (there.then(shape.pose), shape)
            for link, there in links
            for shape in self.robot.shapes(link)
            if shape.kind in ("cylinder", "sphere")
        ]
        rims = [s for s in rolling if rolls(s, axle)]
        shape = max(rims, key=lambda s: s[1].lengths[0], default=None)  # what is inside rolls on it
        if shape is None:
            self.notes.append(
                f"joint {joint.name} turns like a wheel, but its link {joint.child} has no "
                "cylinder or sphere about its axis"
            )
            return False
        given = [(self.robot.properties(link), there) for link, there in links]
        masses = [there.placed(p) for p, there in given if p is not None]
        if steering is not None:
            masses += self._forks.pop(steering[0].name, [])
        self.wheels.append(self._wheel(joint, pose, shape, steering, masses))
        self._masses.append(masses)
        return True

    def _leave_lifted(self) -> None:
        """Count to the body what turns but stands above the ground of the others."""
        ground = min((w.height - w.r for w in self.wheels), default=0.0)
        kept = []
        for wheel, masses in zip(self.wheels, self._masses, strict=True):
            gap = wheel.height - wheel.r - ground
            if gap <= LIFTED * wheel.r:
                kept.append(wheel)
                continue
            self.body += masses
            self.notes.append(
                f"joint {wheel.name} turns {gap:.3g} m above the ground and is no wheel"
            )
        self.wheels = kept

    def _rigid(self, link: str, pose: Pose) -> Iterator[tuple[str, Pose]]:
        yield link, pose
        for joint in self.robot.below(link):
            if joint.kind == "fixed":
                yield from self._rigid(joint.child, pose.then(joint.origin))

    def _wheel(
        self,
        joint: Joint,
        pose: Pose,
        shape: tuple[Pose, Shape],
        steering: tuple[Joint, Pose] | None,
        masses: list[MassProperties],
    ) -> Wheel:
        axle = pose.axes @ joint.axis
        offset = shape[0].place - pose.place
        middle = pose.place + axle * float(offset @ axle)
        heading = math.atan2(-axle[0], axle[1])  # e = axle × z
        lengths, extra = shape[1].lengths, self._more.get(joint.child)
        keys: dict[str, Any] = {
            "name": joint.name,
            "at": middle,
            "r": lengths[0],
            "heading": rounded_angle(heading),
            "width": lengths[1] if len(lengths) > 1 else None,
            "mass": round(sum(p.mass for p in masses), DECIMALS) or None,
            "max_speed": joint.velocity,
        }
        if steering is not None:
            keys |= self._steered(joint, middle, heading, LEAST_TRAIL * lengths[0], steering)
        if extra is not None:
            keys |= self._of_our_own(extra)
        keys["at"] = _rounded(keys["at"])
        try:
            return Wheel(**keys)
        except ValidationError as error:
            said = error.errors()[0]["msg"].removeprefix("Value error, ")
            raise self.robot.wrong(joint.line, f"the wheel of joint {joint.name}: {said}") from None

    def _steered(
        self,
        joint: Joint,
        middle: Array,
        heading: float,
        least: float,
        hinge: tuple[Joint, Pose],
    ) -> dict[str, Any]:
        """Keys of a wheel that hangs on an upright joint; it trails beyond a least distance [m]."""
        steering, there = hinge
        along = np.array([math.cos(heading), math.sin(heading)])
        rest = middle[:2] - there.place[:2]
        trail = round(-float(rest @ along), DECIMALS)
        side = round(float(along[0] * rest[1] - along[1] * rest[0]), DECIMALS)
        keys: dict[str, Any] = {"at": np.array([*there.place[:2], middle[2]])}
        keys |= {"side": side} if side else {}
        if steering.kind == "continuous" and abs(trail) > least:
            return keys | {"kind": "caster", "offset": trail}
        if abs(trail) > least:
            self.notes.append(
                f"wheel {joint.name} is steered and trails {trail:.3g} m behind its steering "
                "axis, which is left out"
            )
        keys["kind"] = "steerable"
        if steering.limits is not None and steering.kind == "revolute":
            turned = there.axes @ steering.axis
            low, high = steering.limits
            keys["angle_limits"] = (low, high) if turned[2] > 0 else (-high, -low)
        return keys

    def _of_our_own(self, extra: XmlElement) -> dict[str, Any]:
        """What a URDF has no place for, and an element ``sysid`` keeps."""
        values: dict[str, Any] = {}
        for key in ("angle", "roller"):
            if key in extra.attributes:
                values[key] = self.robot.number(extra, extra.attributes[key], key)
        return values | ({"kind": "swedish"} if "roller" in values else {})


def rounded_angle(angle: float) -> float:
    """The angle [rad] in (−π, π], rounded so that it reads the same when written and read again."""
    rounded = round(float(wrap_angle(angle)), DECIMALS) + 0.0
    return -rounded if rounded <= -round(math.pi, DECIMALS) else rounded


def rolls(shape: tuple[Pose, Shape], axle: Array) -> bool:
    """Whether a sphere, or a cylinder round the axle."""
    pose, form = shape
    return form.kind == "sphere" or bool(abs(pose.axes[:, 2] @ axle) > math.sqrt(1 - TILT**2))


def _body(parts: list[MassProperties], boxes: list[tuple[Pose, Shape]]) -> Body:
    keys: dict[str, Any] = {}
    if boxes:
        pose, shape = boxes[0]
        there = pose.then(shape.pose)
        size = np.abs(there.axes) @ np.array(shape.lengths)
        keys |= {"size": _rounded(size), "at": _rounded(there.place)}
    if parts:
        whole = combined(parts)
        keys |= {"mass": whole.mass, "mass_centre": _rounded(whole.centre)}
        if np.linalg.eigvalsh(whole.tensor)[0] > 0:  # links may have a mass and no inertia
            keys["inertia"] = Inertia.of(whole.tensor)
    return Body(**keys)


def _rounded(vector: Array) -> tuple[float, ...]:
    return tuple(round(float(v), DECIMALS) + 0.0 for v in vector)  # + 0.0: no -0.0


def _friction(robot: Robot) -> float | None:
    """``mu1`` of the first Gazebo element that has it."""
    for element in robot.top.all("gazebo"):
        mu = element.first("mu1")
        if mu is not None:
            return robot.number(mu, mu.attributes.get("value", mu.text.strip()), "the value")
    return None
