"""The links and joints of a URDF, as poses in the frame of its base."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array
from sysid.errors import DataError
from sysid.vehicle.frames import rotation
from sysid.vehicle.wheels.body import Inertia, MassProperties
from sysid.vehicle.wheels.xml_source import XmlElement

MOVING = ("continuous", "revolute", "prismatic", "floating", "planar")


@dataclass(frozen=True, eq=False)
class Pose:
    """A frame in the base's: where its origin lies (3,) [m], and its axes as columns (3, 3)."""

    place: Array
    axes: Array

    def then(self, inner: "Pose") -> "Pose":
        """The frame that lies so in this one."""
        return Pose(self.place + self.axes @ inner.place, self.axes @ inner.axes)

    def placed(self, inside: MassProperties) -> MassProperties:
        """Mass properties in this frame, in that of the base."""
        centre = self.place + self.axes @ inside.centre
        return replace(inside, centre=centre, tensor=self.axes @ inside.tensor @ self.axes.T)


BASE = Pose(np.zeros(3), np.eye(3))


@dataclass(frozen=True, eq=False)
class Shape:
    """A box, cylinder or sphere of a link.

    Attributes:
        kind: box, cylinder or sphere.
        lengths: size x, y, z; radius and length; or radius [m].
        pose: in the frame of the link.
    """

    kind: str
    lengths: tuple[float, ...]
    pose: Pose


@dataclass(frozen=True, eq=False)
class Joint:
    """What holds a link.

    Attributes:
        name, kind: of the joint; kind as the URDF calls its type.
        origin: of the child's frame in the parent's, at position 0.
        axis: unit vector in the child's frame, (3,).
        limits: least and largest position [rad or m], None where there are none.
        velocity: largest speed [rad/s or m/s].
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Pose
    axis: Array
    limits: tuple[float, float] | None
    velocity: float | None
    line: int


class Robot:
    """The tree of links under the element ``robot``.

    Raises:
        DataError: it is no tree, or an element lacks what it must have.
    """

    def __init__(self, top: XmlElement, file: str) -> None:
        self.file = file
        if top.tag != "robot":
            raise self.wrong(top.line, f"the file holds <{top.tag}>, not <robot>: give a URDF")
        if any(tag.startswith("xacro:") for tag in (c.tag for c in top.children)):
            raise self.wrong(top.line, "this is xacro: expand it first, xacro FILE > robot.urdf")
        self.top = top
        self.name = top.attributes.get("name", "robot")
        self.links: Mapping[str, XmlElement] = self._named(top.all("link"))
        joints = self._named(top.all("joint"))
        self.joints = [self._joint(name, element) for name, element in joints.items()]
        self.root = self._root()

    def wrong(self, line: int, sentence: str) -> DataError:
        """The sentence with its place in the file."""
        return DataError(f"{self.file}:{line}: {sentence}")

    def below(self, link: str) -> Iterator[Joint]:
        """Joints that hang on a link."""
        return (j for j in self.joints if j.parent == link)

    def shapes(self, link: str) -> list[Shape]:
        """What a link is made of: its collision shapes, after them its visual ones."""
        element = self.links[link]
        shapes = []
        for part in (*element.all("collision"), *element.all("visual")):
            geometry = part.first("geometry")
            shapes += [
                Shape(inner.tag, self._lengths(inner), self._origin(part))
                for inner in (geometry.children if geometry else ())
                if inner.tag in ("box", "cylinder", "sphere")
            ]
        return shapes

    def properties(self, link: str) -> MassProperties | None:
        """Mass, centre and tensor of a link in its own frame; None where it has no mass."""
        inertial = self.links[link].first("inertial")
        mass = inertial.first("mass") if inertial else None
        if inertial is None or mass is None:
            return None
        value = self._number(mass, "value")
        if value < 0:
            raise self.wrong(mass.line, f"link {link} has a mass of {value:g} kg: give one above 0")
        if value == 0:
            return None
        entries = inertial.first("inertia")
        tensor = np.zeros((3, 3))
        if entries is not None:
            names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
            xx, xy, xz, yy, yz, zz = (self._number(entries, n, 0.0) for n in names)
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            try:
                Inertia.of(tensor)
            except ValueError as error:
                said = str(error.errors()[0]["msg"]) if hasattr(error, "errors") else str(error)
                said = said.removeprefix("Value error, ")
                raise self.wrong(entries.line, f"of link {link} {said}") from None
        return self._origin(inertial).placed(MassProperties(value, np.zeros(3), tensor))

    def _named(self, elements: list[XmlElement]) -> dict[str, XmlElement]:
        by_name: dict[str, XmlElement] = {}
        for element in elements:
            name = element.attributes.get("name", "")
            if not name:
                raise self.wrong(element.line, f'this {element.tag} has no name: add name="…"')
            if name in by_name:
                raise self.wrong(
                    element.line, f"a second {element.tag} is called {name}: rename one of them"
                )
            by_name[name] = element
        return by_name

    def _joint(self, name: str, element: XmlElement) -> Joint:
        kind = element.attributes.get("type", "")
        if kind not in (*MOVING, "fixed"):
            raise self.wrong(
                element.line,
                f"joint {name} has the type {kind!r}: the types are fixed, {', '.join(MOVING)}",
            )
        ends = []
        for role in ("parent", "child"):
            end = element.first(role)
            link = end.attributes.get("link", "") if end else ""
            if link not in self.links:
                what = f"the {role} link {link!r}, which is not there" if link else f"no {role}"
                raise self.wrong(element.line, f"joint {name} names {what}: correct the name")
            ends.append(link)
        given = element.first("axis")
        axis = np.array(self._vector(given, "xyz", (1.0, 0.0, 0.0)) if given else (1.0, 0.0, 0.0))
        size = float(np.linalg.norm(axis))
        if size == 0:
            raise self.wrong(element.line, f"the axis of joint {name} has no direction")
        limit = element.first("limit")
        low, high = (self._number(limit, k, 0.0) for k in ("lower", "upper")) if limit else (0, 0)
        velocity = self._number(limit, "velocity", 0.0) if limit else 0.0
        return Joint(
            name, kind, ends[0], ends[1], self._origin(element), axis / size,
            (low, high) if low < high else None, velocity if velocity > 0 else None, element.line,
        )  # fmt: skip

    def _root(self) -> str:
        children = [j.child for j in self.joints]
        twice = next((j for j in self.joints if children.count(j.child) > 1), None)
        if twice is not None:
            raise self.wrong(twice.line, f"link {twice.child} hangs on two joints: keep one")
        roots = [name for name in self.links if name not in children]
        if len(roots) != 1:
            what = f"the links {', '.join(roots)} hang on no joint" if roots else "no link is free"
            raise self.wrong(self.top.line, f"{what}: a robot has one base, join all others to it")
        reached = {roots[0]}
        for _ in self.joints:
            reached |= {j.child for j in self.joints if j.parent in reached}
        loose = next((name for name in self.links if name not in reached), None)
        if loose is not None:
            raise self.wrong(
                self.links[loose].line, f"link {loose} hangs on a ring of joints: cut the ring"
            )
        return roots[0]

    def _origin(self, element: XmlElement) -> Pose:
        origin = element.first("origin")
        if origin is None:
            return BASE
        place = self._vector(origin, "xyz", (0.0, 0.0, 0.0))
        roll, pitch, yaw = self._vector(origin, "rpy", (0.0, 0.0, 0.0))
        return Pose(np.array(place), rotation(roll, pitch, yaw))

    def _lengths(self, shape: XmlElement) -> tuple[float, ...]:
        if shape.tag == "box":
            lengths = self._vector(shape, "size", None)
        else:
            names = ("radius", "length") if shape.tag == "cylinder" else ("radius",)
            lengths = tuple(self._number(shape, name) for name in names)
        if min(lengths) <= 0:
            raise self.wrong(
                shape.line, f"a {shape.tag} has a length of {min(lengths):g} m: give one above 0"
            )
        return lengths

    def _vector(
        self, element: XmlElement, name: str, default: tuple[float, ...] | None
    ) -> tuple[float, ...]:
        text = element.attributes.get(name)
        if text is None and default is not None:
            return default
        values = [self.number(element, word, name) for word in (text or "").split()]
        if len(values) != 3:
            raise self.wrong(element.line, f'{name}="{text or ""}" is not three numbers')
        return tuple(values)

    def _number(self, element: XmlElement, name: str, default: float | None = None) -> float:
        text = element.attributes.get(name)
        if text is None and default is not None:
            return default
        return self.number(element, text or "", name)

    def number(self, element: XmlElement, word: str, name: str) -> float:
        """A word of an element as a finite number."""
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.wrong(
                element.line, f"{name} of <{element.tag}> is {word!r}: give a finite number"
            )
        return value
