"""Two lags of first order in a row change places: the transfer function is the same.

Which of both is the motor's shows only beside an effect that acts between them, as friction does.
"""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.named_sets import Node
from sysid.diagnosis.search.supermodel import SuperModel
from sysid.effects.catalogue import CHANGED, about


def lags_of(model: SuperModel, node: Node) -> tuple[int, ...]:
    """Slots of a node's lags that may change places with the core's, which has one."""
    if model.order != 1:
        return ()
    return tuple(
        k
        for id in node.effects
        if id != CHANGED.id and about(id).exchanges
        for k in model.of(id)
        if model.slots[k].name == about(id).exchanges and _can(model, node, k)
    )


def _can(model: SuperModel, node: Node, lag: int) -> bool:
    """Whether a lag is estimated and longer than none, beside a core that is estimated, too."""
    track = model.slots[lag].track
    if track < 0 or lag not in node.free or node.q[lag] <= 0.0:
        return False
    pole = model.place["core", "f1", track]
    return pole in node.free and bool(-1.0 < node.q[pole] < 0.0)


def exchanged(model: SuperModel, q: Array, lags: Sequence[int]) -> Array:
    """Numbers with which lags and the core's time constants have changed places, (slots,)."""
    out = q.copy()
    for k in lags:
        slot = model.slots[k]
        pole = model.place["core", "f1", slot.track]
        out[k] = np.clip(-model.dt / np.log(-q[pole]), slot.lower, slot.upper)
        out[pole] = -np.exp(-model.dt / q[k])
    return out
