"""The table of methods: how each family of structures is fitted."""

from collections.abc import Mapping
from importlib import import_module

from sysid.extensions import loaded, points, unusable
from sysid.methods.method import Method
from sysid.structures.base import Structure

METHODS: Mapping[str, str] = {
    "base:Structure": "sysid.methods.search:METHOD",
    "linear.polynomial:PolynomialStructure": "sysid.methods.linear:METHOD",
    "state_space.structure:RealizedStructure": "sysid.methods.realized:METHOD",
    "narx.structure:NarxWavelet": "sysid.methods.narx:METHOD",
    "narmax.structure:NARMAX": "sysid.methods.narmax:METHOD",
    "blocks.structure:BlockStructure": "sysid.methods.blocks:METHOD",
    "grey_box.structure:GreyBox": "sysid.methods.grey_box:METHOD",
    "augmented.structure:Augmented": "sysid.methods.augmented:METHOD",
}
"""Class (below ``sysid.structures``) → its method, imported when asked for."""


def method_of(structure: Structure) -> Method:
    """How a structure is fitted: as the nearest of its classes in the table is.

    A package that brings a structure may bring its method, a ``Method`` under the structure's name
    in the entry-point group ``sysid.methods``.
    """
    cls = type(structure)
    if not cls.__module__.startswith("sysid."):
        point = points("sysid.methods").get(structure.name)
        if point is not None:
            method = loaded(point, "method")
            if not isinstance(method, Method):
                raise unusable(point, "method", "is not a sysid.methods.method.Method")
            return method
    names = (
        f"{c.__module__}:{c.__qualname__}".removeprefix("sysid.structures.") for c in cls.mro()
    )
    module, name = next(METHODS[n] for n in names if n in METHODS).split(":")
    found: Method = getattr(import_module(module), name)
    return found
