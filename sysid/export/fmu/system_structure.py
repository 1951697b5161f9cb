"""SystemStructure.ssd: the connections between the units of a robot (SSP 1.0)."""

from collections.abc import Iterator

from sysid.export.fmu.description import Unit
from sysid.export.fmu.loop_units import LoopUnits
from sysid.export.templates import fill
from sysid.robot.mission.loop import Loop


def system_structure(units: LoopUnits, plant: Unit, loop: Loop) -> str:
    """The units of a loop, their connections, and where the plant starts.

    Tools take it as it lies beside the units, or zipped with them as ``.ssp``.
    """
    instances = [(name, plant) for name in units.wiring.plants]
    instances += [(u.name, u) for u in (units.controller, units.vehicle)]
    return fill(
        "fmu/SystemStructure.ssd",
        instances=instances,
        starts=units.wiring.starts,
        connections=_connections(units),
        timeout=loop.timeout,
        step=loop.plant.dt,
    )


def _connections(units: LoopUnits) -> Iterator[tuple[str, str, str, str]]:
    """(from unit, variable, to unit, variable)."""
    for p in units.wiring.commands:
        yield "controller", p.name, p.plant, p.at
    for p in units.wiring.speeds:
        known = {v.name for v in units.controller.variables}
        if p.name in known:
            yield p.plant, p.at, "controller", p.name
        yield p.plant, p.at, "vehicle", p.name
