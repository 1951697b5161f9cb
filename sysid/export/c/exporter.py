"""The format ``c``: a header, the plant and its self-test."""

from collections.abc import Mapping
from typing import ClassVar

from sysid.export.base import Exporter, Source
from sysid.export.c.build import arduino_files, build_files
from sysid.export.c.fields import numbers
from sysid.export.c.loop.sources import loop_sources
from sysid.export.c.precision import DOUBLE, in_single, single
from sysid.export.c.report import LoopFacts, report
from sysid.export.c.source import plant_sources
from sysid.export.c.step import c_step
from sysid.export.templates import fill

_USAGE = """In C99, without heap or globals (`c/plant.h`, `c/plant.c`); the self-test prints its
largest relative error:

```
cd c && make && ./selftest      # or: cc -std=c99 -O2 -o selftest plant.c selftest.c -lm
```
"""


class C(Exporter):
    """``plant.h``, ``plant.c`` and ``selftest.c``."""

    name: ClassVar[str] = "c"
    title: ClassVar[str] = "C code"

    def files(self, source: Source) -> Mapping[str, str | bytes]:
        """The sources.

        Raises:
            ModelError: the plant cannot be written as C.
        """
        precision = DOUBLE if source.double else single(source.model)
        step = c_step(source.model)
        files = plant_sources(source.model, step, source.selftest, source.name, precision.plant)
        extra: dict[str, str] = {}
        facts = None
        if source.loop is not None:
            made = loop_sources(source.loop, precision)
            facts = LoopFacts(made.blocks, source.loop.control.period, made.not_again)
            files |= made.files
            extra = arduino_files(source.loop, files, made.blocks)
        files |= build_files(files) | extra
        files["simulink/plant_sfun.c"] = fill("c/plant_sfun.c", numbers=numbers(step.parameters))
        files["report.md"] = report(source.model, step, precision, facts)
        if precision.double:
            return files
        return {n: in_single(t) if n.endswith((".c", ".h")) else t for n, t in files.items()}

    def usage(self) -> str:
        return _USAGE
