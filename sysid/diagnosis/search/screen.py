"""Which effects could explain the errors of a model, without fitting one of them.

To first order an effect changes the free run by its *signature* s, the run with the effect at one
of its starting values less the run without. Beside it everything that the model estimates moves:

    e ≈ J δ + c s,    c ≥ 0,

with J the slopes of the run in the free parameters. What the regression leaves of ‖e‖² ranks the
starts of all effects for the price of one run each. The angle between two signatures, J projected
out, says whether the log can tell the effects apart (isolability; Isermann, *Fault-Diagnosis
Systems*, 2006, §5).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.policies import ENDLESS
from sysid.diagnosis.search.batched_search import slopes
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import Data

RANK = 1e-9
"""Directions of J that are smaller than this share of the largest say nothing."""


@dataclass(frozen=True, eq=False)
class Screen:
    """What the signatures of some starts leave of a model's errors.

    Attributes:
        cost: squared error that each start leaves, track by track, (starts, tracks).
        at_start: the same with c = 1: the effect as large as it starts.
        signatures: weighted signatures beyond J, (starts, M, tracks).
        moved: changes of the free parameters beside each start, (starts, free parameters).
    """

    cost: Array
    at_start: Array
    signatures: Array
    moved: Array


def screened(model: FullModel, q: Array, free: Sequence[int], rows: Array, data: Data) -> Screen:
    """Starts of effects (starts, parameters) on the model with parameters ``q``."""
    run, *runs = model.run(np.concatenate([q[None], rows]), data)
    J = slopes(model, q, free, data)
    cost, at_start = np.empty((2, len(rows), model.tracks))
    signatures = np.empty((len(rows), *run.shape))
    moved = np.zeros((len(rows), len(free)))
    with np.errstate(over="ignore", invalid="ignore"):
        change = np.nan_to_num(np.array(runs) - run, posinf=0.0, neginf=0.0).clip(-ENDLESS, ENDLESS)
    for i in range(model.tracks):
        weight = data.weight[:, i]
        error = np.nan_to_num(weight * (data.y[:, i] - run[:, i]))
        s = weight * change[:, :, i]
        own = [k for k, at in enumerate(free) if model.parameters[at].track in (i, -1)]
        U, sizes, V = np.linalg.svd(weight[:, None] * J[:, i, own], full_matrices=False)
        if kept := int(np.sum(sizes > RANK * max(float(np.max(sizes, initial=0.0)), 1e-300))):
            U, back = U[:, :kept], V[:kept].T / sizes[:kept]
            moved[:, own] = ((error - s) @ U) @ back.T
            s, error = s - (s @ U) @ U.T, error - U @ (U.T @ error)
        power, along = np.einsum("km,km->k", s, s), s @ error
        at_start[:, i] = np.maximum(error @ error - 2.0 * along + power, 0.0)
        cost[:, i] = error @ error - np.maximum(along, 0.0) ** 2 / np.maximum(power, 1e-300)
        signatures[:, :, i] = s
    return Screen(cost, at_start, signatures, moved)
