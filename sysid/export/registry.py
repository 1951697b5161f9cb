"""The registry of exporters: every format by its name, imported when asked for."""

from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import entry_points

from sysid.errors import ModelError, UsageError
from sysid.export.base import Exporter

GROUP = "sysid.exporters"
"""The entry-point group in which other packages name a class of theirs."""

BUILT_IN = {"json": "package_only:PackageOnly", "c": "c.exporter:C"}
"""Module and class of the exporters that come with the package."""

DEFAULT = ("json", "c")
"""What is written where nobody says what."""


def names() -> tuple[str, ...]:
    """Every format that can be asked for, the built-in ones first; nothing is imported."""
    return tuple(dict.fromkeys((*BUILT_IN, *(p.name for p in entry_points(group=GROUP)))))


def exporter(name: str) -> Exporter:
    """The exporter of a format.

    Raises:
        UsageError: there is none of that name.
        ModelError: it belongs to another package and cannot be imported.
    """
    if name in BUILT_IN:
        module, built_in = BUILT_IN[name].split(":")
        found: Exporter = getattr(import_module(f"sysid.export.{module}"), built_in)()
        return found
    point = next(iter(entry_points(group=GROUP, name=name)), None)
    if point is None:
        raise UsageError(f"there is no format {name!r}; choose from {', '.join(names())}")
    try:
        other: Exporter = point.load()()
    except (ImportError, AttributeError, TypeError) as error:
        raise ModelError(
            f"the format {name} cannot be used: {point.value} cannot be imported ({error}); "
            "mend or remove the package that registers it"
        ) from None
    return other


def chosen(formats: Sequence[str]) -> tuple[Exporter, ...]:
    """The exporters of these formats, each once.

    Raises:
        UsageError: none is named, or one does not exist.
    """
    wanted = [f.strip().lower() for f in formats if f.strip()]
    if not wanted:
        raise UsageError(f"no format is named; choose from {', '.join(names())}")
    return tuple(exporter(name) for name in dict.fromkeys(wanted))
