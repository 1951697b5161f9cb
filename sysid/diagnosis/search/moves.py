"""Moves of the search beside adding one effect: what else may explain a log as well or better.

Each takes the search and a set of effects; what it returns is judged like any other set.
"""

from collections.abc import Sequence
from dataclasses import replace

from sysid.diagnosis.policies import BUDGET, RULE
from sysid.diagnosis.search.candidates import CandidateSearch
from sysid.diagnosis.search.evidence import alike
from sysid.diagnosis.search.selection import CandidateModel, ScoredCandidate
from sysid.effects.base import Effect
from sysid.effects.catalogue import about


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
