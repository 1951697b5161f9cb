"""Normal pressure of a track on the ground, along the track."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from typing import Any

import numpy as np

from sysid.errors import ModelError
from sysid.vehicle.kinematics import Real


class Distribution(StrEnum):
    """How a track's load is spread along it."""

    UNIFORM = "uniform"
    """The same everywhere."""
    LINEAR = "linear"
    """A trapezoid whose centre is the load's; a triangle from a sixth of the length off the middle
    on, beyond which the light end lifts."""
    WHEELS = "wheels"
    """Peaks under road wheels that share the load as equal springs do."""


@dataclass(frozen=True)
class Pressure:
    """Distribution of a track's load along its length.

    Attributes:
        centre: how far the load's centre lies ahead of the middle of the track [m].
        wheels: number of road wheels, evenly spaced [1].
        depth: A, how far pressure falls between wheels: 0 not at all, 1 to nothing [1].
    """

    distribution: Distribution = Distribution.UNIFORM
    centre: Real = 0.0
    wheels: int = 5
    depth: float = 1.0

    def __post_init__(self) -> None:
        if self.wheels < 1:
            raise ModelError(
                f"a track on {self.wheels} road wheels carries nothing: give 1 or more"
            )
        if not 0.0 <= self.depth <= 1.0:
            raise ModelError(
                f"the pressure's depth between wheels is {self.depth}: give a share from 0 to 1"
            )
        if (
            self.distribution == Distribution.UNIFORM
            and isinstance(self.centre, int | float)
            and self.centre != 0.0
        ):
            raise ModelError(
                f"a uniform pressure has its centre in the middle, not {self.centre} m ahead: "
                "choose linear or wheels"
            )

    @staticmethod
    def triangle(length: float, *, forward: bool) -> "Pressure":
        """The triangle that falls to nothing at one end of a track of that length [m].

        Args:
            length: L [m].
            forward: whether the load is towards the front.
        """
        return Pressure(Distribution.LINEAR, length / 6.0 if forward else -length / 6.0)

    @property
    def mirrored(self) -> "Pressure":
        """The same seen from the other end, for a track that runs backwards."""
        return Pressure(self.distribution, -self.centre, self.wheels, self.depth)

    def check(self, length: float) -> None:
        """Refuse a load that a track of this length [m] cannot carry like this."""
        if self.distribution == Distribution.LINEAR and not abs(self.centre) < 0.5 * length:
            raise ModelError(
                f"the load lies {self.centre} m from the middle of a track of {length} m: it must "
                "lie between its ends"
            )
        most = length * (self.wheels + 1) / (6.0 * self.wheels) if self.wheels > 1 else 0.0
        if self.distribution == Distribution.WHEELS and abs(self.centre) > most:
            raise ModelError(
                f"the load lies {self.centre:.3g} m from the middle of {self.wheels} road wheels "
                f"on {length} m: beyond {most:.3g} m the last one would lift; choose linear"
            )

    def contact(self, length: Real, xp: Any = np) -> tuple[Real, Real]:
        """Where contact begins and ends, from the front of the track [m]."""
        if self.distribution != Distribution.LINEAR:
            return 0.0 * length, length
        touching = xp.minimum(length, 3.0 * (0.5 * length - xp.abs(self.centre)))
        begin = xp.where(self.centre < 0.0, length - touching, 0.0)
        return begin, begin + touching

    def at(self, x: Real, load: Real, length: Real, width: Real, xp: Any = np) -> Real:
        """Normal pressure at a place of the track [Pa], at least 0; its integral is the load.

        uniform: W/(bL);  linear: W/(bL)·(1 + 12 e (L/2 − x)/L²) up to |e| = L/6, then the triangle
        over 3 (L/2 − |e|);  wheel k of n, s_k ahead of the middle:
        W/(bL)·(1 + 12 n² e s_k/((n² − 1) L²))·(1 − A cos(2π n x/L)).

        Args:
            x: from the front of the track, 0 to L [m].
            load: W of this track [N].
            length, width: L and b [m].
        """
        mean = load / (width * length)
        if self.distribution == Distribution.LINEAR:
            begin, end = self.contact(length, xp)
            touching = end - begin
            from_heavy = xp.where(self.centre < 0.0, end - x, x - begin)
            tilt = xp.minimum(1.0, 6.0 * xp.abs(self.centre) / length)
            there = load / (width * touching) * (1.0 + tilt * (1.0 - 2.0 * from_heavy / touching))
            return xp.where((x >= begin) & (x <= end), xp.maximum(there, 0.0), 0.0)
        if self.distribution == Distribution.WHEELS:
            n = self.wheels
            cell = xp.clip(xp.floor(x * n / length), 0.0, n - 1.0)
            ahead = 0.5 * length - (cell + 0.5) * length / n
            tilt = 12.0 * n * n / (n * n - 1.0) * self.centre / length**2 if n > 1 else 0.0
            wave = 1.0 - self.depth * xp.cos(2.0 * math.pi * n * x / length)
            return mean * (1.0 + tilt * ahead) * wave
        return mean + 0.0 * x

    def peak(self, load: Real, length: Real, width: Real, xp: Any = np) -> Real:
        """Largest pressure under the track [Pa]; arguments as of :meth:`at`."""
        mean = load / (width * length)
        if self.distribution == Distribution.LINEAR:
            begin, end = self.contact(length, xp)
            tilt = xp.minimum(1.0, 6.0 * xp.abs(self.centre) / length)
            return load / (width * (end - begin)) * (1.0 + tilt)
        if self.distribution == Distribution.WHEELS:
            most = 1.0
            if self.wheels > 1:
                most = 1.0 + 6.0 * self.wheels * xp.abs(self.centre) / ((self.wheels + 1) * length)
            return mean * most * (1.0 + self.depth)
        return mean

    def smooth_parts(self, length: Real, xp: Any = np) -> list[tuple[Real, Real]]:
        """Stretches of the contact within which the pressure is smooth: (begin, end) [m]."""
        if self.distribution == Distribution.WHEELS:
            edges = [length * k / self.wheels for k in range(self.wheels + 1)]
            return list(itertools.pairwise(edges))
        return [self.contact(length, xp)]


NODES = 24
"""Nodes of a part. An exponential that falls by e⁻⁷² over a part, the steepest that is integrated,
comes out within 1e-11 of its integral, and one wheel's peak within rounding."""


@cache
def _rule() -> tuple[Any, Any]:
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    return nodes, weights


def integrate(
    f: Callable[[Real], tuple[Real, ...]],
    parts: Sequence[tuple[Real, Real]],
    axes: int = 0,
    xp: Any = np,
) -> tuple[Real, ...]:
    """Sums of ∫ f dx over the parts, one for each value of f.

    Args:
        f: takes places x of shape (nodes, parts, …) and gives values of that shape.
        parts: (begin, end) of each [m], numbers or arrays with ``axes`` axes; an empty one adds 0.
        axes: how many axes the arrays have that a single value would be for one run.

    Returns:
        The integrals, without the axes of nodes and parts.
    """
    nodes, weights = (a.reshape((-1,) + (1,) * (axes + 1)) for a in _rule())
    begins, ends = (xp.stack(xp.broadcast_arrays(*side)) for side in zip(*parts, strict=True))
    half = 0.5 * (ends - begins)
    values = f(begins + half * (1.0 + nodes))
    return tuple((half * weights * v).sum(axis=(0, 1)) for v in values)


def axes_of(*values: Real) -> int:
    """The most axes among numbers and arrays."""
    return max(np.ndim(v) for v in values)
