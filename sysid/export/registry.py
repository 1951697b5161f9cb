"""The registry of exporters: every format by its name, imported when asked for."""

from collections.abc import Sequence
from importlib import import_module

from sysid.errors import UsageError
from sysid.export.base import Exporter
from sysid.extensions import loaded, points, unusable

GROUP = "sysid.exporters"
"""The entry-point group in which other packages name a class of theirs."""

BUILT_IN = {
    "json": "base:PackageOnly",
    "c": "c.exporter:C",
    "fmu": "fmu.exporter:Fmu",
    "fmu3": "fmu.exporter:Fmu3",
    "ros": "ros.exporter:Ros",
}
"""Module and class of the exporters that come with the package."""

DEFAULT = ("json", "c")
"""The default formats."""


def names() -> tuple[str, ...]:
    """Every format that can be asked for, the built-in ones first; nothing is imported."""
    return tuple(dict.fromkeys((*BUILT_IN, *points(GROUP))))


def exporter(name: str) -> Exporter:
    """The exporter of a format."""
    if name in BUILT_IN:
        module, built_in = BUILT_IN[name].split(":")
        built: Exporter = getattr(import_module(f"sysid.export.{module}"), built_in)()
        return built
    if name not in points(GROUP):
        raise UsageError(f"there is no format {name!r}; choose from {', '.join(names())}")
    point = points(GROUP)[name]
    cls = loaded(point, "format")
    if not (isinstance(cls, type) and issubclass(cls, Exporter)):
        raise unusable(point, "format", "is no Exporter")
    other: Exporter = cls()
    return other


def chosen(formats: Sequence[str]) -> tuple[Exporter, ...]:
    """The exporters of these formats, each once."""
    wanted = [f.strip().lower() for f in formats if f.strip()]
    if not wanted:
        raise UsageError(f"no format is named; choose from {', '.join(names())}")
    return tuple(exporter(name) for name in dict.fromkeys(wanted))
