"""The model description of a unit: FMI 2.0.4 and 3.0, co-simulation."""

import hashlib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from xml.sax.saxutils import quoteattr

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


_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]+")


def plain(text: str) -> str:
    """Text without what XML, or a name of the standard, cannot hold: lines become blanks."""
    return _CONTROL.sub(" ", text).strip()


def named_apart(variables: Iterable[Variable]) -> tuple[Variable, ...]:
    """The variables with names that differ: the second ``speed`` is ``speed_2``."""
    taken: set[str] = set()
    renamed = []
    for variable in variables:
        base = plain(variable.name) or "value"
        name, k = base, 2
        while name in taken:
            name, k = f"{base}_{k}", k + 1
        taken.add(name)
        renamed.append(replace(variable, name=name))
    return tuple(renamed)


def xml_2(unit: Unit) -> str:
    """modelDescription.xml of FMI 2.0."""
    outputs = [
        f'      <Unknown index="{k}"{_depends(v, 1)}/>'
        for k, v in enumerate(unit.variables, 1)
        if v.role is Role.OUTPUT
    ]
    initial = [re.sub(r" dependencies.*?\"(?=/>)", "", line) for line in outputs]
    sources = [f"      <File name={quoteattr(n)}/>" for n in ("fmi2.c", *unit.compiled)]
    return _joined(
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="2.0" modelName={quoteattr(unit.name)} '
        f'guid="{unit.guid}" description={quoteattr(plain(unit.words))} '
        f'generationTool="sysid {__version__}" variableNamingConvention="flat" '
        'numberOfEventIndicators="0">',
        f"  <CoSimulation modelIdentifier={quoteattr(unit.name)} "
        'canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true" '
        'canSerializeFMUstate="true" canNotUseMemoryManagementFunctions="true">',
        *_inside("SourceFiles", sources, "    "),
        "  </CoSimulation>",
        *_units(unit),
        '  <LogCategories>\n    <Category name="logStatusError"/>\n  </LogCategories>',
        f'  <DefaultExperiment startTime="0.0" stepSize="{float(unit.sample_time)!r}"/>',
        *_inside("ModelVariables", _variables_2(unit), "  "),
        "  <ModelStructure>",
        *_inside("Outputs", outputs, "    "),
        *_inside("InitialUnknowns", initial, "    "),
        "  </ModelStructure>",
        "</fmiModelDescription>",
    )


def xml_3(unit: Unit) -> str:
    """modelDescription.xml of FMI 3.0."""
    of_outputs = [(k, v) for k, v in enumerate(unit.variables) if v.role is Role.OUTPUT]
    return _joined(
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="3.0" modelName={quoteattr(unit.name)} '
        f'instantiationToken="{unit.guid}" description={quoteattr(plain(unit.words))} '
        f'generationTool="sysid {__version__}" variableNamingConvention="flat">',
        f"  <CoSimulation modelIdentifier={quoteattr(unit.name)} "
        'canHandleVariableCommunicationStepSize="true" canGetAndSetFMUState="true" '
        'canSerializeFMUState="true"/>',
        *_units(unit),
        '  <LogCategories>\n    <Category name="logStatusError"/>\n  </LogCategories>',
        f'  <DefaultExperiment startTime="0.0" stepSize="{float(unit.sample_time)!r}"/>',
        *_inside("ModelVariables", _variables_3(unit), "  "),
        "  <ModelStructure>",
        *(f'    <Output valueReference="{k}"{_depends(v, 0)}/>' for k, v in of_outputs),
        *(f'    <InitialUnknown valueReference="{k}"/>' for k, _ in of_outputs),
        "  </ModelStructure>",
        "</fmiModelDescription>",
    )


def build_description(unit: Unit) -> str:
    """sources/buildDescription.xml of FMI 3.0: what is to be compiled."""
    return _joined(
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<fmiBuildDescription fmiVersion="3.0">',
        f"  <BuildConfiguration modelIdentifier={quoteattr(unit.name)}>",
        '    <SourceFileSet language="C99">',
        *(f"      <SourceFile name={quoteattr(n)}/>" for n in ("fmi3.c", *unit.compiled)),
        "    </SourceFileSet>",
        "  </BuildConfiguration>",
        "</fmiBuildDescription>",
    )


def _variables_2(unit: Unit) -> Iterator[str]:
    for k, v in enumerate(unit.variables):
        if v.role is Role.TIME:  # of no use here, and readers ask for its start
            continue
        kind = "Boolean" if v.boolean else "Real"
        about = f" unit={quoteattr(plain(v.unit))}" if v.unit else ""
        words = f" description={quoteattr(plain(v.words))}" if v.words else ""
        yield (
            f'    <ScalarVariable name={quoteattr(v.name)} valueReference="{k}"{words} '
            f"{v.role.value}>\n      <{kind}{about}{_start(v)}/>\n    </ScalarVariable>"
        )


def _variables_3(unit: Unit) -> Iterator[str]:
    for k, v in enumerate(unit.variables):
        kind = "Boolean" if v.boolean else "Float64"
        about = f" unit={quoteattr(plain(v.unit))}" if v.unit else ""
        words = f" description={quoteattr(plain(v.words))}" if v.words else ""
        yield (
            f'    <{kind} name={quoteattr(v.name)} valueReference="{k}"{words} '
            f"{v.role.value}{about}{_start(v)}/>"
        )


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


def _inside(name: str, lines: Iterable[str], indent: str) -> list[str]:
    kept = list(lines)
    return [f"{indent}<{name}>", *kept, f"{indent}</{name}>"] if kept else []


def _joined(*lines: str) -> str:
    return "\n".join([*lines, ""])


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


def _units(unit: Unit) -> list[str]:
    names: Sequence[str] = sorted({plain(v.unit) for v in unit.variables if plain(v.unit)})
    each = []
    for name in names:
        base = _DIMENSIONS.get(name)
        inner = f"<BaseUnit {base}/>" if base else ""
        each.append(f"    <Unit name={quoteattr(name)}>{inner}</Unit>")
    return _inside("UnitDefinitions", each, "  ")
