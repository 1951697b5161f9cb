"""Two first-order lags in series can be exchanged: the transfer function is the same.

Which of both is the motor's shows only beside an effect that acts between them, as friction does.
"""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.selection import CandidateModel
from sysid.effects.catalogue import CHANGED, about


def lags_of(model: FullModel, candidate: CandidateModel) -> tuple[int, ...]:
    """Slots of a candidate model's lags that may change places with the core's, which has one."""
    if model.order != 1:
        return ()
    return tuple(
        k
        for id in candidate.effects
        if id != CHANGED.id and about(id).hints.exchanges
        for k in model.of(id)
        if model.parameters[k].name == about(id).hints.exchanges and _can(model, candidate, k)
    )


def _can(model: FullModel, candidate: CandidateModel, lag: int) -> bool:
    """Whether a lag is estimated and longer than none, beside a core that is estimated, too."""
    track = model.parameters[lag].track
    if track < 0 or lag not in candidate.free or candidate.q[lag] <= 0.0:
        return False
    pole = model.index["core", "f1", track]
    return pole in candidate.free and bool(-1.0 < candidate.q[pole] < 0.0)


def exchanged(model: FullModel, q: Array, lags: Sequence[int]) -> Array:
    """Parameters with lags and the core's time constants exchanged, (parameters,)."""
    out = q.copy()
    for k in lags:
        parameter = model.parameters[k]
        pole = model.index["core", "f1", parameter.track]
        if not (q[k] > 0.0 and -1.0 < q[pole] < 0.0):
            continue
        out[k] = np.clip(-model.dt / np.log(-q[pole]), parameter.lower, parameter.upper)
        out[pole] = -np.exp(-model.dt / q[k])
    return out
