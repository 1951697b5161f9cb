"""Output sensitivities: ∂ŷ/∂q over the free parameters, on the records of a search."""

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.selection import CandidateModel


def sensitivities(
    search: ForwardSelection, at: CandidateModel, holdout: bool = False
) -> tuple[Array, ...]:
    """∂ŷ/∂q over the free parameters of a candidate model, (N, ny, n) a record, by forward
    differences.

    Args:
        search: the search around the model.
        at: where the slopes are taken.
        holdout: on the held-out records instead of the estimation records.
    """
    model, data = search.model, search.holdout_data if holdout else search.data
    batch = np.repeat(at.q[None], len(at.free) + 1, axis=0)
    shifts = []
    for row, k in enumerate(at.free, start=1):
        p = model.parameters[k]
        shift = -p.shift if at.q[k] + p.shift > p.upper else p.shift
        batch[row, k] += shift
        shifts.append(shift)
    runs = model.run(batch, data)
    whole = (runs[1:] - runs[0]) / np.array(shifts)[:, None, None]
    whole = np.nan_to_num(whole, posinf=0.0, neginf=0.0)
    return data.split(np.moveaxis(whole, 0, 2))
