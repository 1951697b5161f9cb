"""Offsets of a fit: what is removed first, and whether an offset is estimated with θ."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.operating_point import OperatingPoint, Origin
from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.structures.base import Structure, counts_from_zero, lacks_constant
from sysid.structures.continuous.structure import ContinuousStructure


@dataclass(frozen=True, eq=False)
class Offsets:
    """How one fit deals with the offsets of its data.

    Attributes:
        detrend: what is removed before the fit.
        origin: what these numbers are.
        estimated: by output, whether a constant is estimated with the parameters of a linear
            structure; the offset it stands for is added to ``detrend`` afterwards.
        y_error: standard errors of removed output offsets, empty where they are no estimates.
        at_rest: whether ``detrend`` is where the log rests at its head.
        unseen: whether zero is kept only because no offset is seen in an ARX.
        why: why so, as the end of a sentence.
    """

    detrend: Detrend
    origin: Origin = Origin.ZERO
    estimated: tuple[bool, ...] = ()
    y_error: tuple[float, ...] = ()
    at_rest: bool = False
    unseen: bool = False
    why: str = ""

    @staticmethod
    def none(nu: int, ny: int, why: str = "") -> "Offsets":
        """Nothing is removed and nothing estimated."""
        return Offsets(Detrend.none(nu, ny), why=why)

    @staticmethod
    def of_detrend(detrend: Detrend) -> "Offsets":
        """Offsets that are known: they are removed, and nothing is estimated."""
        return Offsets(detrend, OperatingPoint.of_detrend(detrend).origin)

    @staticmethod
    def refit(detrend: Detrend, point: OperatingPoint, ny: int) -> "Offsets":
        """The same treatment for another fit of the same structure, e.g. to part of the data."""
        return Offsets(
            detrend, point.origin, (True,) * ny if point.estimated else (), point.y_error,
            why=point.why,
        )  # fmt: skip

    @property
    def operating_point(self) -> OperatingPoint:
        """The offset of a model with which nothing was estimated."""
        return OperatingPoint(self.origin, (), self.y_error, 0, self.why)

    def for_structure(self, structure: Structure, records: Sequence[Record]) -> "Offsets":
        """What these offsets mean to one structure.

        A physical structure counts from the channels' own zeros. Nonlinear ones with an offset of
        their own do, too, because what they describe (the edges of a dead zone, the terms of an
        equation) is about these zeros; those that begin a free run from past outputs are moved
        where zero is no place the data come near. Products of past signals are the least alike
        about the means, so that the choice among them is best conditioned (Marquardt 1980, JASA).
        """
        nu, ny = structure.nu, structure.ny
        if structure.traits.physical:
            return Offsets.none(nu, ny)
        if self.unseen and isinstance(structure, ContinuousStructure):
            # of a plant with dead time an ARX sees little, and here the starts depend on it
            return replace(self, origin=Origin.ESTIMATED, estimated=(True,) * ny, why="")
        chosen = self.origin in (Origin.MEANS, Origin.LINES)
        if structure.traits.linear or chosen or self.origin is Origin.ZERO:
            return self
        if counts_from_zero(structure):
            if lacks_constant(structure):
                return Offsets.none(nu, ny, lacks_constant(structure))
            return Offsets(Detrend.none(nu, ny), Origin.INSIDE)
        if self.at_rest:
            return replace(self, origin=Origin.REST, estimated=())
        if structure.traits.chooses_products:
            return Offsets(Detrend.means(records), Origin.MEANS)
        u, y = ([getattr(r, side) for r in records] for side in ("u", "y"))
        moved = Detrend(_where_far(u), _where_far(y))
        return Offsets(moved, Origin.INSIDE)


def _where_far(values: Sequence[Array]) -> Array:
    """The means of channels whose values all lie on one side of zero, zero for the others."""
    joined = np.concatenate(values)
    low, high = joined.min(axis=0), joined.max(axis=0)
    return np.where((low <= 0.0) & (high >= 0.0), 0.0, joined.mean(axis=0))
