"""Slopes of a model's readings with respect to its free numbers, on the records of a search."""

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.named_sets import Node
from sysid.diagnosis.search.naming import NamingSearch


def slopes(search: NamingSearch, node: Node, held: bool = False) -> tuple[Array, ...]:
    """∂ŷ/∂q over the free slots of a node, (N, ny, n) a record, by forward differences.

    Args:
        search: the search around the model.
        node: where the slopes are taken.
        held: on the held-out records instead of the estimation records.
    """
    model, data = search.model, search.held_data if held else search.data
    lanes = np.repeat(node.q[None], len(node.free) + 1, axis=0)
    shifts = []
    for row, k in enumerate(node.free, start=1):
        slot = model.slots[k]
        shift = -slot.shift if node.q[k] + slot.shift > slot.upper else slot.shift
        lanes[row, k] += shift
        shifts.append(shift)
    runs = model.run(lanes, data)
    whole = (runs[1:] - runs[0]) / np.array(shifts)[:, None, None]
    whole = np.nan_to_num(whole, posinf=0.0, neginf=0.0)
    return data.split(np.moveaxis(whole, 0, 2))
