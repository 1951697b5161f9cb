"""SystemStructure.ssd: the connections between the units of a robot (SSP 1.0)."""

from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

from sysid.export.fmu.description import Role, Unit
from sysid.export.fmu.loop_units import LoopUnits
from sysid.robot.mission.loop import Loop
from sysid.version import __version__

_NAMESPACES = " ".join(
    f'xmlns:{short}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for short, name in (("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"))
)

_OSP = 'xmlns:osp="http://opensimulationplatform.com/SSP/OSPAnnotations"'
"""Of what libcosim reads beside the standard: its step."""


def system_structure(units: LoopUnits, plant: Unit, loop: Loop) -> str:
    """The units of a loop, their connections, and where the plant starts.

    Tools take it as it lies beside the units, or zipped with them as ``.ssp``.
    """
    wiring = units.wiring
    instances = [(name, plant) for name in wiring.plants]
    instances += [(u.name, u) for u in (units.controller, units.vehicle)]
    components = [line for name, unit in instances for line in _component(name, unit, units)]
    connections = [
        f'      <ssd:Connection startElement="{a}" startConnector={quoteattr(x)} '
        f'endElement="{b}" endConnector={quoteattr(y)}/>'
        for a, x, b, y in _connections(units)
    ]
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<ssd:SystemStructureDescription {_NAMESPACES} {_OSP} name="robot" version="1.0" '
            f'generationTool="sysid {__version__}">',
            '  <ssd:System name="robot">',
            "    <ssd:Elements>",
            *components,
            "    </ssd:Elements>",
            "    <ssd:Connections>",
            *connections,
            "    </ssd:Connections>",
            "  </ssd:System>",
            f'  <ssd:DefaultExperiment startTime="0.0" stopTime="{float(loop.timeout)!r}">',
            "    <ssd:Annotations>",
            '      <ssc:Annotation type="com.opensimulationplatform">',
            "        <osp:Algorithm>",
            f'          <osp:FixedStepAlgorithm baseStepSize="{float(loop.plant.dt)!r}"/>',
            "        </osp:Algorithm>",
            "      </ssc:Annotation>",
            "    </ssd:Annotations>",
            "  </ssd:DefaultExperiment>",
            "</ssd:SystemStructureDescription>",
            "",
        ]
    )


def _component(name: str, unit: Unit, units: LoopUnits) -> Iterator[str]:
    kinds = {Role.INPUT: "input", Role.OUTPUT: "output"}
    yield (
        f'      <ssd:Component name="{name}" source="{unit.name}.fmu" '
        'type="application/x-fmu-sharedlibrary">'
    )
    yield "        <ssd:Connectors>"
    for v in unit.variables:
        if v.role in kinds:
            kind = "Boolean" if v.boolean else "Real"
            yield (
                f'          <ssd:Connector name={quoteattr(v.name)} kind="{kinds[v.role]}">'
                f"<ssc:{kind}/></ssd:Connector>"
            )
    yield "        </ssd:Connectors>"
    starts = [(at, value) for instance, at, value in units.wiring.starts if instance == name]
    if starts:
        yield "        <ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>"
        yield '          <ssv:ParameterSet version="1.0" name="start"><ssv:Parameters>'
        for at, value in starts:
            yield (
                f"            <ssv:Parameter name={quoteattr(at)}>"
                f'<ssv:Real value="{value!r}"/></ssv:Parameter>'
            )
        yield "          </ssv:Parameters></ssv:ParameterSet>"
        yield "        </ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"
    yield "      </ssd:Component>"


def _connections(units: LoopUnits) -> Iterator[tuple[str, str, str, str]]:
    """(from unit, variable, to unit, variable)."""
    for p in units.wiring.commands:
        yield "controller", p.name, p.plant, p.at
    for p in units.wiring.speeds:
        known = {v.name for v in units.controller.variables}
        if p.name in known:
            yield p.plant, p.at, "controller", p.name
        yield p.plant, p.at, "vehicle", p.name
