"""The next effect beside a lag that may as well be another one: of the actuator, or of the sensor.

What acts between them, as friction does, shows which of both it is; beside the wrong one it looks
like something else.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnosis.search.candidates import CandidateSearch, common_samples
from sysid.diagnosis.search.named_sets import Judged, Node
from sysid.effects.base import Effect
from sysid.effects.catalogue import CHANGED, about

CLEARLY = 10.0
"""Beside the other lag an effect has to explain more by this much, in units of BIC."""


def beside_either(
    search: CandidateSearch, node: Node, effects: Sequence[Effect]
) -> tuple[list[Judged], dict[str, Node]]:
    """Effects tried on a node, and on the one with the other lag where there is one.

    Returns:
        (each effect where it explains more, the most likely first; the node it was tried on, by
        id).
    """
    judged = search.candidates(node, effects)
    other = with_other_lag(search, node)
    if other is None:
        return judged, {j.id: node for j in judged}
    tried = [(node, j) for j in judged] + [(other, j) for j in search.candidates(other, effects)]
    if not tried:
        return [], {}
    samples = common_samples([j.node for _, j in tried])
    best: dict[str, tuple[Node, Judged]] = {}
    for rest, j in tried:
        evidence = search.evidence(rest, j.node, len(effects), samples)
        mine = Judged(j.node, evidence, search.likelihood(rest, j.node, samples))
        if j.id not in best or mine.score > best[j.id][1].score + CLEARLY:
            best[j.id] = rest, mine
    ordered = sorted(best.values(), key=lambda b: -b[1].score)
    return [j for _, j in ordered], {j.id: rest for rest, j in ordered}


def with_other_lag(search: CandidateSearch, node: Node) -> Node | None:
    """A node whose newest effect, a lag, is the other lag that could not be told from it.

    None where the newest effect is no such lag.
    """
    own = node.effects[-1] if node.effects else CHANGED.id
    name = "" if own == CHANGED.id else about(own).exchanges
    others = [id for id in node.excluded if name and id in about(own).ties]
    others = [id for id in others if about(id).exchanges]
    if not others:
        return None
    model = search.model
    other, q, moved = others[0], node.q.copy(), {}
    for k in model.of(own):
        if model.slots[k].name == name:
            there = model.place[other, about(other).exchanges, model.slots[k].track]
            q[there], q[k] = np.clip(q[k], model.slots[there].lower, model.slots[there].upper), 0.0
            moved[k] = there
    free = tuple(sorted(moved.get(k, k) for k in node.free))
    effects = (*node.effects[:-1], other)
    excluded = tuple(own if id == other else id for id in node.excluded)
    return replace(search.node(effects, q, free, node.touched), excluded=excluded)
