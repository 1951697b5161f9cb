"""The formats ``fmu`` and ``fmu3``: units of FMI 2.0 and 3.0 for co-simulation."""

from collections.abc import Mapping
from typing import ClassVar

from sysid.export.base import Exporter, Source
from sysid.export.fmu.archive import FMI_2, FMI_3, Version, archive, headers
from sysid.export.fmu.description import Unit
from sysid.export.fmu.loop_replay import loop_replays
from sysid.export.fmu.loop_units import loop_units
from sysid.export.fmu.plant_unit import plant_unit
from sysid.export.fmu.system_structure import system_structure

_USAGE = """For co-simulation (`{folder}/plant.fmu`, FMI {number}): inputs and outputs are those
above, a step is a multiple of the sample time. Parameters `start_0` … are where the states begin,
as changes from rest; with start_settled the plant begins in steady motion under its first inputs.
"""


class Fmu(Exporter):
    """``plant.fmu`` of FMI 2.0, and what drives it."""

    name: ClassVar[str] = "fmu"
    title: ClassVar[str] = "FMU"
    version: ClassVar[Version] = FMI_2

    def files(self, source: Source) -> Mapping[str, str | bytes]:
        """The units.

        Raises:
            ModelError: FMPy is not installed, or the plant cannot be written as C.
        """
        headers()  # asked first: the sentence about what is missing must not wait
        units: list[Unit] = [plant_unit(source)]
        files: dict[str, str | bytes] = {}
        if source.loop is not None:
            made = loop_units(source.loop, source.name)
            units += [made.controller, made.vehicle]
            for name, rows in loop_replays(source.loop, made).items():
                files[f"{name}.csv"] = rows.text()
            files["SystemStructure.ssd"] = system_structure(made, units[0], source.loop)
        return files | {f"{u.name}.fmu": archive(u, self.version) for u in units}

    def usage(self) -> str:
        return _USAGE.format(folder=self.name, number=self.version.number)


class Fmu3(Fmu):
    """The same of FMI 3.0."""

    name: ClassVar[str] = "fmu3"
    title: ClassVar[str] = "FMU of FMI 3.0"
    version: ClassVar[Version] = FMI_3
