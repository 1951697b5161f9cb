"""The least-squares problems of every structure, as its fit poses them."""

from collections.abc import Sequence

from sysid.data.record import Record
from sysid.fitting.problem import Focus, Initial, Problem
from sysid.structures.augmented.runs import ChainRuns
from sysid.structures.augmented.structure import Augmented
from sysid.structures.base import Structure
from sysid.structures.blocks.errors import ChainErrors
from sysid.structures.blocks.structure import BlockStructure
from sysid.structures.difference_equations.structure import RecursiveStructure
from sysid.structures.grey_box.runs import GreyErrors
from sysid.structures.grey_box.structure import GreyBox
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.linear.searchable import LinearSearch
from sysid.structures.state_space.structure import RealizedStructure


def problems_of(
    structure: Structure,
    records: Sequence[Record],
    focus: Focus,
    initial: Initial = Initial.ZERO,
    stable: bool = False,
) -> tuple[Problem, ...]:
    """The problems that together determine θ."""
    data = [(r.u, r.y) for r in records]
    estimated = initial is not Initial.ZERO
    match structure:
        case PolynomialStructure():
            return LinearSearch(structure).problems(records, focus, initial, stable)
        case RealizedStructure():
            return structure.problems(records, focus, initial, stable)
        case Augmented():
            return (ChainRuns(structure, data),)
        case RecursiveStructure():
            if focus is Focus.SIMULATION:
                return (structure.over_chunks(data, max(len(r) for r in records)),)
            return tuple(structure.one_step(i, data) for i in range(structure.ny))
        case GreyBox():
            return (GreyErrors(structure, data, estimated),)
        case BlockStructure():
            return (ChainErrors(structure.chain, data, estimated),)
    raise AssertionError(f"say here what {structure.name} poses")
