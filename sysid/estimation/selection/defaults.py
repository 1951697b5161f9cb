"""The structures that are fitted where the user names none."""

from collections.abc import Mapping, Sequence
from typing import Any

from sysid.data.record import Record
from sysid.errors import UsageError
from sysid.fitting.options import FitOptions
from sysid.structures.registry import structure_class, structure_classes

Grid = Sequence[Mapping[str, Any]]
"""Orders to try."""


def default_structures(with_inputs: bool) -> tuple[str, ...]:
    """What is fitted to a log with or without inputs when the user names nothing."""
    known = structure_classes().items()
    return tuple(
        n for n, c in known if c.traits.by_default and c.traits.takes_inputs is with_inputs
    )


def usual_orders(records: Sequence[Record], options: FitOptions) -> Mapping[str, Grid]:
    """Structures that are tried besides where none is named, and their orders.

    None where options of a structure, or of parameters, show that others are meant.
    """
    if options.structure_options or options.fixed or options.bounds or not records[0].nu:
        return {}
    ways = {n: c.traits.default_orders for n, c in structure_classes().items()}
    every = {n: way(records) for n, way in ways.items() if way is not None}
    return {n: orders for n, orders in every.items() if orders}


def structures_for(names: Sequence[str], inputs: Sequence[str]) -> tuple[str, ...]:
    """The structures to fit to a log with these inputs; the usual ones where none is named."""
    chosen = tuple(names) or default_structures(bool(inputs))
    for name in chosen:
        takes = structure_class(name).traits.takes_inputs
        if takes and not inputs:
            raise UsageError(
                f"{name} needs an input but the log has none; choose from "
                f"{', '.join(default_structures(False))}, or name the input column"
            )
        if inputs and not takes:
            raise UsageError(
                f"{name} is for a log without inputs, but this log is read with "
                f"{', '.join(inputs)}; set the input to none, or use arx or armax"
            )
    return chosen
