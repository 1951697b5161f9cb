"""modelDescription.xml of a unit (FMI 2.0.4, co-simulation)."""

from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from sysid.version import __version__


@dataclass(frozen=True)
class Variable:
    """One variable of a unit; its value reference is its place in the list.

    Attributes:
        name: unique.
        causality: ``input``, ``output`` or ``parameter``.
        unit: of its values, empty for none.
        words: what it is.
        start: first value; of outputs there is none.
        tunable: whether a parameter may change during a run.
    """

    name: str
    causality: str
    unit: str = ""
    words: str = ""
    start: float | None = None
    tunable: bool = False

    def xml(self, at: int) -> str:
        """Its element."""
        variability = "tunable" if self.tunable else "fixed"
        kinds = {
            "input": 'causality="input" variability="discrete"',
            "output": 'causality="output" variability="discrete" initial="calculated"',
            "parameter": f'causality="parameter" variability="{variability}" initial="exact"',
        }
        unit = f" unit={quoteattr(self.unit)}" if self.unit else ""
        start = "" if self.start is None else f' start="{self.start!r}"'
        words = f" description={quoteattr(self.words)}" if self.words else ""
        return (
            f'    <ScalarVariable name={quoteattr(self.name)} valueReference="{at}"{words} '
            f"{kinds[self.causality]}>\n      <Real{unit}{start}/>\n    </ScalarVariable>"
        )


@dataclass(frozen=True)
class Unit:
    """What a unit says of itself.

    Attributes:
        name: of the model, and of its files.
        guid: that its code must know, too.
        sample_time: [s].
        variables: in the order of their value references.
        sources: names of the C files to compile.
        words: what it is.
    """

    name: str
    guid: str
    sample_time: float
    variables: tuple[Variable, ...]
    sources: tuple[str, ...]
    words: str = ""

    def xml(self) -> str:
        """modelDescription.xml."""
        units = sorted({v.unit for v in self.variables if v.unit})
        outputs = [k for k, v in enumerate(self.variables, 1) if v.causality == "output"]
        unknowns = [f'      <Unknown index="{k}"/>' for k in outputs]
        return "\n".join(
            [
                '<?xml version="1.0" encoding="UTF-8"?>',
                f'<fmiModelDescription fmiVersion="2.0" modelName={quoteattr(self.name)} '
                f'guid="{self.guid}" description={quoteattr(self.words)} '
                f'generationTool="sysid {__version__}" variableNamingConvention="flat" '
                'numberOfEventIndicators="0">',
                f"  <CoSimulation modelIdentifier={quoteattr(self.name)} "
                'canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true">',
                *_listed("SourceFiles", [f"<File name={quoteattr(n)}/>" for n in self.sources]),
                "  </CoSimulation>",
                *(_units(units)),
                '  <LogCategories>\n    <Category name="logStatusError"/>\n  </LogCategories>',
                f'  <DefaultExperiment startTime="0.0" stepSize="{self.sample_time!r}"/>',
                "  <ModelVariables>",
                *(v.xml(k) for k, v in enumerate(self.variables)),
                "  </ModelVariables>",
                "  <ModelStructure>",
                *_structure("Outputs", unknowns),
                *_structure("InitialUnknowns", unknowns),
                "  </ModelStructure>",
                "</fmiModelDescription>",
                "",
            ]
        )


def _listed(name: str, elements: Sequence[str]) -> list[str]:
    return [f"    <{name}>", *(f"      {e}" for e in elements), f"    </{name}>"]


def _structure(name: str, unknowns: Sequence[str]) -> list[str]:
    return [f"    <{name}>", *unknowns, f"    </{name}>"] if unknowns else []


def _units(names: Sequence[str]) -> list[str]:
    if not names:
        return []
    each = [f"    <Unit name={quoteattr(n)}/>" for n in names]
    return ["  <UnitDefinitions>", *each, "  </UnitDefinitions>"]
