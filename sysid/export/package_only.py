"""The format ``json``: the package alone."""

from collections.abc import Mapping
from typing import ClassVar

from sysid.export.base import Exporter, Source


class PackageOnly(Exporter):
    """``plant.json``, ``selftest.csv`` and ``README.md``; see ``sysid.plant.package``."""

    name: ClassVar[str] = "json"
    title: ClassVar[str] = "further file"

    def files(self, source: Source) -> Mapping[str, str | bytes]:
        return {}
