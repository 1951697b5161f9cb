"""Output sensitivities: ∂ŷ/∂q over the free parameters, on the records of a search."""

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.selection import CandidateModel


def sensitivities(
    search: ForwardSelection, candidate: CandidateModel, holdout: bool = False
) -> tuple[Array, ...]:
    """∂ŷ/∂q over the free parameters of a candidate model, (N, ny, n) a record, by forward
    differences.

    Args:
        search: the search around the model.
        candidate: where the slopes are taken.
        holdout: on the held-out records instead of the estimation records.
    """
    model, data = search.model, search.holdout_data if holdout else search.data
    batch = np.repeat(candidate.q[None], len(candidate.free) + 1, axis=0)
    shifts = []
    for row, k in enumerate(candidate.free, start=1):
        parameter = model.parameters[k]
        shift = (
            -parameter.shift
            if candidate.q[k] + parameter.shift > parameter.upper
            else parameter.shift
        )
        batch[row, k] += shift
        shifts.append(shift)
    runs = model.run(batch, data)
    whole = (runs[1:] - runs[0]) / np.array(shifts)[:, None, None]
    whole = np.nan_to_num(whole, posinf=0.0, neginf=0.0)
    return data.split(np.moveaxis(whole, 0, 2))
