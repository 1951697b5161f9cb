"""The model description of a unit: FMI 2.0.4 and 3.0, co-simulation."""

import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from xml.sax.saxutils import quoteattr

from sysid.export.c.names import apart
from sysid.export.templates import fill, plain
from sysid.version import __version__


class Role(Enum):
    """What a variable is for: causality, variability and initial value in words of the standard."""

    INPUT = 'causality="input" variability="discrete"'
    OUTPUT = 'causality="output" variability="discrete" initial="calculated"'
    LOCAL = 'causality="local" variability="discrete" initial="calculated"'
    """Computed as outputs are, of interest to people and not to other units."""
    FIXED = 'causality="parameter" variability="fixed" initial="exact"'
    TUNABLE = 'causality="parameter" variability="tunable" initial="exact"'
    TIME = 'causality="independent" variability="continuous"'

    @property
    def in_c(self) -> str:
        """The constant in C."""
        return f"FMU_{Role.OUTPUT.name if self is Role.LOCAL else self.name}"


_COMPUTED = (Role.OUTPUT, Role.LOCAL, Role.TIME)


@dataclass(frozen=True)
class Variable:
    """One variable of a unit; its value reference is its place in the list.

    Attributes:
        name: as a person knows it.
        unit: of its values, empty for none.
        start: first value of what is set from outside.
        boolean: whether it is yes or no, else a number.
        may_be_nan: whether an input may say that nothing was read.
        depends: of an output: places of the inputs of the same instant on which it depends; None
            where that may be all.
    """

    name: str
    role: Role
    unit: str = ""
    words: str = ""
    start: float = 0.0
    boolean: bool = False
    may_be_nan: bool = False
    depends: tuple[int, ...] | None = None

    @property
    def started(self) -> bool:
        """Whether its first value is set from outside."""
        return self.role not in _COMPUTED


@dataclass(frozen=True)
class Unit:
    """A sampled model as a unit.

    Attributes:
        name: of the model, and of its files.
        sample_time: [s].
        variables: in the order of their value references; names are unique.
        sources: C files and headers by name, those of the standard aside.
        code: C that goes with the table of variables: ``fmu_state``, ``fmu_begin``, ``fmu_outputs``
            and ``fmu_advance``.
    """

    name: str
    sample_time: float
    variables: tuple[Variable, ...]
    sources: Mapping[str, str]
    code: str
    words: str = ""

    @property
    def guid(self) -> str:
        """Identifies this unit by its content."""
        text = "".join(f"{n}\n{self.sources[n]}" for n in sorted(self.sources))
        text += f"{__version__}{self.name}{float(self.sample_time)!r}{self.variables!r}{self.code}"
        return f"{{{hashlib.sha256(text.encode('utf-8')).hexdigest()[:32]}}}"

    @property
    def compiled(self) -> list[str]:
        """Names of its C files."""
        return sorted(n for n in self.sources if n.endswith(".c"))


def named_apart(variables: Iterable[Variable]) -> tuple[Variable, ...]:
    """The variables with names that differ: the second ``speed`` is ``speed_2``."""
    every = tuple(variables)
    names = apart(plain(v.name) or "value" for v in every)
    return tuple(replace(v, name=n) for v, n in zip(every, names, strict=True))


def model_description(unit: Unit, version: str) -> str:
    """modelDescription.xml of FMI 2.0 or 3.0.

    Args:
        version: its template, ``fmi2`` or ``fmi3``.
    """
    return fill(
        f"fmu/{version}.xml",
        unit=unit,
        units=sorted({plain(v.unit) for v in unit.variables if plain(v.unit)}),
        dimensions=_DIMENSIONS,
        outputs=[(k, v) for k, v in enumerate(unit.variables) if v.role is Role.OUTPUT],
        about=_about,
        start=_start,
        depends=_depends,
    )


def _about(attribute: str, text: str) -> str:
    return f" {attribute}={quoteattr(plain(text))}" if text else ""


_NOT_FINITE = {"nan": "NaN", "inf": "INF", "-inf": "-INF"}
"""What is no finite number, as XML writes it."""


def _start(v: Variable) -> str:
    if not v.started:
        return ""
    if v.boolean:
        return f' start="{"true" if v.start else "false"}"'
    value = repr(float(v.start)) if math.isfinite(v.start) else _NOT_FINITE[str(float(v.start))]
    return f' start="{value}"'


def _depends(v: Variable, first: int) -> str:
    """On which inputs an output depends, counted from ``first``; nothing where that may be all."""
    if v.depends is None:
        return ""
    kinds = f' dependenciesKind="{" ".join(["dependent"] * len(v.depends))}"' if v.depends else ""
    return f' dependencies="{" ".join(str(k + first) for k in v.depends)}"{kinds}'


_DIMENSIONS = {
    "s": 's="1"',
    "ms": 's="1" factor="0.001"',
    "us": 's="1" factor="1e-06"',
    "µs": 's="1" factor="1e-06"',
    "m": 'm="1"',
    "m/s": 'm="1" s="-1"',
    "m/s²": 'm="1" s="-2"',
    "rad": 'rad="1"',
    "rad/s": 'rad="1" s="-1"',
    "rad/s²": 'rad="1" s="-2"',
    "1/s": 's="-1"',
    "N": 'kg="1" m="1" s="-2"',
    "N m": 'kg="1" m="2" s="-2"',
    "Nm": 'kg="1" m="2" s="-2"',
    "A": 'A="1"',
    "V": 'kg="1" m="2" s="-3" A="-1"',
    "W": 'kg="1" m="2" s="-3"',
    "K": 'K="1"',
    "kg": 'kg="1"',
}
"""Units by their powers of SI units; others have a name only."""
