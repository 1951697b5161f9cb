"""The body on the wheels, and mass, centre and inertia of all of it."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from sysid.data.record import Array
from sysid.data.yaml_files.problems import sentence_at
from sysid.data.yaml_files.settings import Coordinate, Positive, Settings

Moment = Annotated[float, Field(ge=-1e9, le=1e9)]
Vector = Annotated[tuple[Coordinate, Coordinate, Coordinate], Field(strict=False)]
Lengths = Annotated[tuple[Positive, Positive, Positive], Field(strict=False)]

_ROUNDING = 1e-6
"""Share by which printed moments of inertia may miss what no body can miss."""


class Inertia(Settings):
    """A tensor of inertia about the centre of mass, along the axes of the body frame [kg m²].

    Off-diagonal entries are those of the tensor, as in a URDF: ixy = −∫xy dm.
    """

    ixx: Moment
    iyy: Moment
    izz: Moment
    ixy: Moment = 0.0
    ixz: Moment = 0.0
    iyz: Moment = 0.0

    @model_validator(mode="after")
    def _of_some_body(self) -> "Inertia":
        """Every body's principal moments are positive, and none exceeds the sum of the others."""
        low, middle, high = np.linalg.eigvalsh(self.tensor)
        if low <= 0:
            raise ValueError(
                f"the inertia has a principal moment of {low:.4g} kg m², which no body has: "
                "check the signs and sizes of its entries"
            )
        if high > (low + middle) * (1.0 + _ROUNDING):
            raise ValueError(
                f"the inertia has principal moments of {low:.4g}, {middle:.4g} and {high:.4g} "
                "kg m², of which the largest exceeds the sum of the others, which no body has: "
                "check its entries"
            )
        return self

    @property
    def tensor(self) -> Array:
        """The matrix, (3, 3)."""
        xx, yy, zz, xy, xz, yz = self.ixx, self.iyy, self.izz, self.ixy, self.ixz, self.iyz
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @classmethod
    def of(cls, tensor: Array) -> Self:
        """The entries of a symmetric matrix, (3, 3)."""
        t = np.asarray(tensor).tolist()
        entries = {"ixx": t[0][0], "iyy": t[1][1], "izz": t[2][2]}
        return cls(**entries, ixy=t[0][1], ixz=t[0][2], iyz=t[1][2])


class Body(Settings):
    """The rigid body that the wheels carry.

    Attributes:
        size: length, width and height of the box around it [m].
        at: x, y, z of the middle of that box in the body frame [m].
        mass: without the wheels [kg].
        mass_centre: x, y, z of its centre of mass [m]; the middle of the box unless given.
        inertia: about its centre of mass; that of a solid box of this mass unless given.
    """

    size: Lengths | None = None
    at: Vector = (0.0, 0.0, 0.0)
    mass: Positive | None = None
    mass_centre: Vector | None = None
    inertia: Inertia | None = None

    @model_validator(mode="before")
    @classmethod
    def _vectors(cls, value: Any) -> Any:
        for key, form in (("size", "length, width, height"), ("at", "x, y, z")):
            vector = value.get(key) if isinstance(value, dict) else None
            if vector is not None and not (isinstance(vector, list | tuple) and len(vector) == 3):
                raise sentence_at((key,), f"{key} needs three lengths: write {key}: [{form}]")
        return value


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass, centre of mass and inertia of one rigid body.

    Attributes:
        mass: [kg].
        centre: (3,) in the body frame [m].
        tensor: (3, 3) about the centre [kg m²].
    """

    mass: float
    centre: Array
    tensor: Array

    def share(self, part: float) -> "MassProperties":
        """A part of mass and inertia here; all parts together are the whole."""
        return replace(self, mass=part * self.mass, tensor=part * self.tensor)


def combined(parts: Iterable[MassProperties]) -> MassProperties:
    """Several bodies as one: I = Σ (I_k + m_k (d² 1 − d dᵀ)), d from the common centre."""
    given = tuple(parts)
    mass = sum(p.mass for p in given)
    centre = sum((p.mass * p.centre for p in given), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for part in given:
        d = part.centre - centre
        tensor = tensor + part.tensor + part.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return MassProperties(mass, centre, tensor)


def box_inertia(mass: float, size: tuple[float, float, float]) -> Array:
    """The tensor of a solid box, (3, 3) [kg m²]: m/12 (b² + h²) about x, and so on."""
    squares = np.square(size)
    return mass / 12.0 * np.diag(squares.sum() - squares)


def cylinder_inertia(mass: float, radius: float, length: float, axis: Array) -> Array:
    """The tensor of a solid cylinder with a unit axis, (3, 3) [kg m²].

    m r²/2 about the axis, m (3 r² + l²)/12 about any line across it.
    """
    across = mass * (3.0 * radius**2 + length**2) / 12.0
    tensor: Array = across * np.eye(3) + (mass * radius**2 / 2.0 - across) * np.outer(axis, axis)
    return tensor
