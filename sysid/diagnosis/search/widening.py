"""Effects tried on further tracks, where something else may have hidden them."""

from dataclasses import replace

import numpy as np

from sysid.diagnosis.policies import BUDGET, VERDICT
from sysid.diagnosis.search.batched_search import refined
from sysid.diagnosis.search.candidates import CandidateSearch
from sysid.diagnosis.search.selection import CandidateModel
from sysid.diagnosis.search.starts import free_indices
from sysid.effects.catalogue import about


def on_more_tracks(search: CandidateSearch, candidate: CandidateModel) -> CandidateModel | None:
    """The candidate model with each of its effects on all tracks whose errors are above the noise.

    An effect is kept on the tracks that it serves. Where two act on a track, neither may serve
    before the other is there: each then starts from what it does on another track.

    Args:
        search: whose data.
        candidate: a set of effects.

    Returns:
        The wider set fitted to the end; None where there is nothing to widen.
    """
    model = search.model
    rms = np.sqrt(sum(candidate.errors.mean_squares()) / 2.0)
    above_noise = rms > VERDICT.residual_to_noise * search.data.noise
    q, free, touched = candidate.q.copy(), list(candidate.free), candidate.touched.copy()
    for id in candidate.effects:
        e = about(id)
        if e.shared or e.couples:
            continue
        each = [
            [k for k in model.of(id) if model.parameters[k].track == i] for i in range(model.tracks)
        ]
        serves = [bool(set(parameters) & set(candidate.free)) for parameters in each]
        for i in range(model.tracks):
            if serves[i] or not above_noise[i] or not any(serves):
                continue
            like = serves.index(True)
            for k, other in zip(each[i], each[like], strict=True):
                parameter, like_parameter = model.parameters[k], model.parameters[other]
                value = candidate.q[other] * parameter.scale / like_parameter.scale
                q[k] = float(np.clip(value, parameter.lower, parameter.upper))
            free += free_indices(model, e, q, [i])
            touched[i] = True
    if len(free) == len(candidate.free):
        return None
    refit, _ = refined(model, q[None], [free], search.data, BUDGET.polish)
    wide = search.evaluate(candidate.effects, refit[0], free, touched)
    return replace(wide, excluded=candidate.excluded)
