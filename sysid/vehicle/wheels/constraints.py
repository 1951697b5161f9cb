"""Rolling and sliding constraints of all wheels, and their rank.

J1 ξ = J2 ω    every wheel rolls                     (thesis 2.17)
C1 ξ = 0       no fixed or steerable wheel slides    (thesis 2.19)
C1c ξ = C2c φ̇  a caster's axis moves sideways as far as the caster turns

with ξ = (Vx, Vy, ψ̇) of the body frame. After Campion, Bastin and D'Andréa-Novel (1996), with
angles derived anew: the printed signs of α and β do not give (2.13).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.vehicle.wheels.wheel import Wheel

Angles = Mapping[str, float]
"""Steering angles by name of the wheel [rad]; wheels that are not named keep theirs."""

RANK_TOLERANCE = 1e-3
"""Share of the largest singular value below which a constraint adds nothing to the others. Rows are
made dimensionless by the size of the vehicle, so that it stands for directions that differ by some
1 mrad (0.06°): less than the play of a steering and the third decimal of an angle in a file."""


@dataclass(frozen=True)
class Scale:
    """The place and size of a set of wheels: makes twists comparable and results invariant.

    z = (velocity of the centre, ℓ ψ̇) is a twist in m/s throughout, and |z| the root of the mean
    square of the wheels' velocities.

    Attributes:
        x, y: the mean place of the wheels [m].
        length: ℓ, the root of the mean square of their distances from it [m]; of a vehicle whose
            wheels stand in one place, their radius.
    """

    x: float
    y: float
    length: float

    @classmethod
    def of(cls, wheels: Sequence[Wheel]) -> "Scale":
        places = np.array([w.position for w in wheels])
        centre = places.mean(axis=0)
        spread = math.sqrt(float(((places - centre) ** 2).sum(axis=1).mean()))
        radius = max(w.r for w in wheels)
        # wheels on one axis stand apart by less than a thousandth of their radius
        length = spread if spread > RANK_TOLERANCE * radius else radius
        return cls(float(centre[0]), float(centre[1]), length)

    @property
    def matrix(self) -> Array:
        """T, (3, 3), with ξ = T z."""
        per = 1.0 / self.length
        return np.array([[1.0, 0.0, self.y * per], [0.0, 1.0, -self.x * per], [0.0, 0.0, per]])

    def scaled(self, twist: Array) -> Array:
        """Z of a twist ξ, (3,) [m/s]."""
        vx, vy, wz = map(float, twist)
        return np.array([vx - wz * self.y, vy + wz * self.x, wz * self.length])


@dataclass(frozen=True, eq=False)
class Constraints:
    """The constraint matrices of a vehicle at given steering angles.

    Attributes:
        J1: (N, 3), a row a wheel.
        J2: (N, N), diagonal [m].
        C1: (Nf + Ns, 3), rows of the fixed and steerable wheels in their order.
        C1c: (Nc, 3), rows of the casters.
        C2c: (Nc, Nc), diagonal: the casters' offsets [m].
        rank: of C1, 0 to 3.
    """

    J1: Array
    J2: Array
    C1: Array
    C1c: Array
    C2c: Array
    rank: int


def constraints(wheels: Sequence[Wheel], angles: Angles | None = None) -> Constraints:
    """The constraint matrices of wheels at steering angles (the present ones unless given)."""
    at = angles or {}
    casters = [w for w in wheels if w.kind == "caster"]
    rows = rows_of([w.sliding_row(at.get(w.name)) for w in wheels if w.constrains])
    return Constraints(
        J1=rows_of([w.rolling_row(at.get(w.name)) for w in wheels]),
        J2=np.diag([w.rolling_radius for w in wheels]),
        C1=rows,
        C1c=rows_of([w.sliding_row(at.get(w.name)) for w in casters]),
        C2c=np.diag([w.offset for w in casters]).reshape(len(casters), len(casters)),
        rank=rank(rows, Scale.of(wheels)),
    )


def rows_of(rows: Sequence[Sequence[float]]) -> Array:
    """Rows as a matrix, (n, 3), n = 0 included."""
    return np.array(rows, dtype=np.float64).reshape(len(rows), 3)


def rank(rows: Array, scale: Scale) -> int:
    """Number of independent constraints among rows (n, 3), within :data:`RANK_TOLERANCE`."""
    if not len(rows):
        return 0
    sizes = np.linalg.svd(rows @ scale.matrix, compute_uv=False)
    return int((sizes > RANK_TOLERANCE * sizes[0]).sum())


def free_motions(rows: Array, scale: Scale) -> Array:
    """Twists that rows (n, 3) allow, as an orthonormal basis of scaled twists z, (3, 3 − rank)."""
    if not len(rows):
        return np.eye(3)
    _, _, right = np.linalg.svd(rows @ scale.matrix)
    allowed: Array = right[rank(rows, scale) :].T
    return allowed
