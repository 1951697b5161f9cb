"""Moves of the search beside adding one effect: what else may explain a log as well or better.

Each takes the search and a set of effects; what it returns is judged like any other set.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnosis.policies import BUDGET, RULE
from sysid.diagnosis.search.candidates import CandidateSearch, common_samples
from sysid.diagnosis.search.evidence import alike
from sysid.diagnosis.search.selection import CandidateModel, ScoredCandidate
from sysid.effects.base import Effect
from sysid.effects.catalogue import about

CLEARLY = 10.0
"""Beside the other lag an effect has to explain more by this much, in units of BIC."""


def together(
    search: CandidateSearch,
    base: CandidateModel,
    judged: Sequence[ScoredCandidate],
    effects: Sequence[Effect],
    needed: float,
) -> CandidateModel | None:
    """Two effects that only help together: the best pair of which neither is accepted alone.

    On four logs of a servo with an arm the weight alone left .93 of the held-out error, friction
    alone .999, both .26.

    Args:
        judged: effects alone, of which those that gain far beyond chance are tried with a second.
    """
    found: list[ScoredCandidate] = []
    strong = [j for j in judged if j.evidence.delta_bic < RULE.certain_bic]
    for first in strong[: BUDGET.pairs]:
        for second in search.candidates(first.model, effects, BUDGET.pairs):
            model = second.model
            touched = first.model.touched | model.touched
            pair = search.scored(base, replace(model, touched=touched), len(effects) ** 2)
            either = (replace(model, effects=e) for e in (model.effects, model.effects[::-1]))
            if pair.evidence.accepted and pair.evidence.ratio < needed:
                found += [pair] * all(map(search.admissible, either))
    return max(found, key=lambda j: j.score).model if found else None


def beside_either(
    search: CandidateSearch, model: CandidateModel, effects: Sequence[Effect]
) -> list[ScoredCandidate]:
    """Effects tried on a candidate model, and on the one with the other lag where there is one.

    Each where it explains more, the most likely first.
    """
    judged = search.candidates(model, effects)
    other = with_other_lag(search, model)
    if other is None:
        return judged
    tried = [(model, j) for j in judged] + [(other, j) for j in search.candidates(other, effects)]
    samples = common_samples([j.model for _, j in tried]) if tried else np.zeros(0)
    best: dict[str, ScoredCandidate] = {}
    for rest, j in tried:
        scored = search.scored(rest, j.model, len(effects), samples)
        if j.id not in best or scored.score > best[j.id].score + CLEARLY:
            best[j.id] = scored
    return sorted(best.values(), key=lambda j: -j.score)


def with_other_lag(search: CandidateSearch, candidate: CandidateModel) -> CandidateModel | None:
    """A candidate model whose newest effect, a lag, is the other lag that ties with it.

    None where the newest effect is no such lag.
    """
    newest, model = candidate.effects[-1], search.model
    name = about(newest).hints.exchanges
    offered = {e.id for e in model.effects}.difference(candidate.effects)
    others = [id for id in about(newest).hints.ties if name and id in offered]
    if not others:
        return None
    other, q, moved = others[0], candidate.q.copy(), {}
    for k in model.of(newest):
        if model.parameters[k].name == name:
            moved[k] = there = model.index[
                other, about(other).hints.exchanges, model.parameters[k].track
            ]
            q[there], q[k] = model.parameters[there].within(q[k]), 0.0
    free = tuple(sorted(moved.get(k, k) for k in candidate.free))
    effects = (*candidate.effects[:-1], other)
    return search.evaluate(effects, q, free, candidate.touched)


def swapped(
    search: CandidateSearch, base: CandidateModel, model: CandidateModel, effects: Sequence[Effect]
) -> CandidateModel:
    """Try look-alikes of the effects accepted so far: a later one may show one of them wrong.

    What could not be distinguished from another at first may be distinguished beside a second
    effect; and so for the laws of one.
    """
    for id in model.effects[:-1]:
        likely = [
            e
            for e in effects
            if (e.id == id and e.laws)
            or ((id in e.hints.ties or e.id in about(id).hints.ties) and e.id not in model.effects)
        ]
        if not likely:
            continue
        judged = search.candidates(search.without(model, id), likely)
        fits = [j.model for j in judged if search.admissible(j.model)]
        best = search.best_of(base, [model, *fits])
        if best is not model and not alike(best.errors, model.errors):
            order = tuple(best.effects[-1] if e == id else e for e in model.effects)
            model = replace(best, effects=order)
    return model
