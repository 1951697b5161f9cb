"""The format ``fmu``: the plant as a unit of FMI 2.0 for co-simulation."""

import hashlib
from collections.abc import Mapping
from importlib.resources import files
from string import Template
from typing import ClassVar

import numpy as np

from sysid.export.base import Exporter, Source
from sysid.export.c.source import c_sources
from sysid.export.c.writing import number
from sysid.export.fmu.archive import archive, headers
from sysid.export.fmu.description import Unit, Variable
from sysid.version import __version__

_USAGE = """For co-simulation (`fmu/plant.fmu`, FMI 2.0): inputs and outputs are those above, a step
is a multiple of the sample time. Parameters `start_0` … are where the states begin, as changes from
rest.
"""


class Fmu(Exporter):
    """``plant.fmu``."""

    name: ClassVar[str] = "fmu"
    title: ClassVar[str] = "FMU"

    def files(self, source: Source) -> Mapping[str, str | bytes]:
        """The unit.

        Raises:
            ModelError: FMPy is not installed, or the plant cannot be written as C.
        """
        headers()  # asked first: the sentence about what is missing must not wait
        return {"plant.fmu": plant_unit(source)}

    def usage(self) -> str:
        """What the unit is."""
        return _USAGE


def plant_unit(source: Source) -> bytes:
    """The plant as a unit."""
    model = source.model
    c = c_sources(model, source.selftest, source.name)
    sources = {n: c[n] for n in ("plant.h", "plant.c")}
    rest = np.asarray(model.detrend.u_offset, dtype=float)
    states = model.structure.n_states(model.theta)
    variables = (
        *(
            Variable(ch.name, "input", ch.unit, "held from one step to the next", float(u))
            for ch, u in zip(model.inputs, rest, strict=True)
        ),
        *(Variable(ch.name, "output", ch.unit, "at this instant") for ch in model.outputs),
        *(
            Variable(f"start_{k}", "parameter", "", "where this state begins, from rest", 0.0)
            for k in range(states)
        ),
    )
    text = "".join(sources[n] for n in sorted(sources)) + repr(variables)
    guid = f"{{{hashlib.sha256(text.encode('utf-8')).hexdigest()[:32]}}}"
    start = ",\n".join(f"    {number(v.start or 0.0)}" for v in variables)
    sources["fmu_model.h"] = _filled(
        "plant_model.h", guid=guid, variables=str(len(variables)), start=start
    )
    sources["fmi2.c"] = _filled("fmi2.c")
    unit = Unit(
        "plant", guid, model.dt, variables, ("fmi2.c", "plant.c"), f"{source.name}, by sysid"
    )
    return archive(unit, sources)


def _filled(template: str, **values: str) -> str:
    text = files("sysid.export.fmu").joinpath("templates", template).read_text(encoding="utf-8")
    return Template(text).substitute(version=__version__, **values)
