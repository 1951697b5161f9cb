"""The next effect beside a lag that ties with another one, of the actuator or of the sensor.

What acts between them, as friction does, shows which of both it is; beside the wrong one it looks
like something else.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnosis.search.candidates import CandidateSearch, common_samples
from sysid.diagnosis.search.selection import CandidateModel, ScoredCandidate
from sysid.effects.base import Effect
from sysid.effects.catalogue import CHANGED, about

CLEARLY = 10.0
"""Beside the other lag an effect has to explain more by this much, in units of BIC."""


def beside_either(
    search: CandidateSearch, model: CandidateModel, effects: Sequence[Effect]
) -> tuple[list[ScoredCandidate], dict[str, CandidateModel]]:
    """Effects tried on a candidate model, and on the one with the other lag where there is one.

    Returns:
        (each effect where it explains more, the most likely first; the candidate model it was tried
        on, by id).
    """
    judged = search.candidates(model, effects)
    other = with_other_lag(search, model)
    if other is None:
        return judged, {j.id: model for j in judged}
    tried = [(model, j) for j in judged] + [(other, j) for j in search.candidates(other, effects)]
    if not tried:
        return [], {}
    samples = common_samples([j.model for _, j in tried])
    best: dict[str, tuple[CandidateModel, ScoredCandidate]] = {}
    for rest, j in tried:
        evidence = search.evidence(rest, j.model, len(effects), samples)
        scored = ScoredCandidate(j.model, evidence, search.likelihood(rest, j.model, samples))
        if j.id not in best or scored.score > best[j.id][1].score + CLEARLY:
            best[j.id] = rest, scored
    ordered = sorted(best.values(), key=lambda b: -b[1].score)
    return [j for _, j in ordered], {j.id: rest for rest, j in ordered}


def with_other_lag(search: CandidateSearch, candidate: CandidateModel) -> CandidateModel | None:
    """A candidate model whose newest effect, a lag, is the other lag that could not be
    distinguished from it.

    None where the newest effect is no such lag.
    """
    newest = candidate.effects[-1] if candidate.effects else CHANGED.id
    name = "" if newest == CHANGED.id else about(newest).exchanges
    others = [id for id in candidate.excluded if name and id in about(newest).ties]
    others = [id for id in others if about(id).exchanges]
    if not others:
        return None
    model = search.model
    other, q, moved = others[0], candidate.q.copy(), {}
    for k in model.of(newest):
        if model.parameters[k].name == name:
            there = model.index[other, about(other).exchanges, model.parameters[k].track]
            q[there], q[k] = (
                np.clip(q[k], model.parameters[there].lower, model.parameters[there].upper),
                0.0,
            )
            moved[k] = there
    free = tuple(sorted(moved.get(k, k) for k in candidate.free))
    effects = (*candidate.effects[:-1], other)
    excluded = tuple(newest if id == other else id for id in candidate.excluded)
    return replace(search.evaluate(effects, q, free, candidate.touched), excluded=excluded)
