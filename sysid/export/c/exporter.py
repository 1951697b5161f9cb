"""The format ``c``: a header, the plant and a program that checks it."""

from collections.abc import Mapping
from typing import ClassVar

from sysid.export.base import Exporter, Source
from sysid.export.c.source import c_sources

_USAGE = """In C99, without heap or globals (`c/plant.h`, `c/plant.c`); the self-test prints its
largest relative error:

```
cd c && cc -std=c99 -O2 -o selftest plant.c selftest.c -lm && ./selftest
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
        return c_sources(source.model, source.selftest, source.name)

    def usage(self) -> str:
        """How to build the self-test."""
        return _USAGE
