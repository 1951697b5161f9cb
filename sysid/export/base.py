"""The contract of an exporter: what it is given, and what it gives."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from sysid.plant.selftest import SelfTest
from sysid.robot.mission.loop import Loop
from sysid.structures.model import Model


@dataclass(frozen=True, eq=False)
class Source:
    """What an exporter writes a plant from.

    Attributes:
        model: the fitted model; ``model.plant()`` steps it.
        name: what the plant is called.
        description: the content of plant.json without files and hash.
        selftest: rows that every runtime must reproduce from rest.
        loop: the closed loop of a mission around this plant, where what drives it is wanted, too.
        double: whether numbers are to have 8 bytes; else 4.
    """

    model: Model
    name: str
    description: Mapping[str, Any]
    selftest: SelfTest
    loop: Loop | None = None
    double: bool = True


class Exporter(ABC):
    """One form in which a plant is written.

    Attributes:
        name: as users type it, and the folder of its files inside a package.
        title: what its files are, as in "there is no C code".
    """

    name: ClassVar[str]
    title: ClassVar[str]

    @abstractmethod
    def files(self, source: Source) -> Mapping[str, str | bytes]:
        """Its files by name, text or bytes, which are put into the folder ``name`` of the package.

        The same source must give the same files.

        Raises:
            ModelError: this plant cannot be written in this form; the sentence says why.
        """

    def usage(self) -> str:
        """How to use the files, a paragraph of Markdown for the model card."""
        return ""


class PackageOnly(Exporter):
    """``plant.json``, ``selftest.csv`` and ``README.md``; see ``sysid.plant.package``."""

    name: ClassVar[str] = "json"
    title: ClassVar[str] = "further file"

    def files(self, source: Source) -> Mapping[str, str | bytes]:
        return {}
