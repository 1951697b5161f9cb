"""Effects of a node on tracks that did not show them, because something else there hid them."""

from dataclasses import replace

import numpy as np

from sysid.diagnosis.policies import BUDGET, VERDICT
from sysid.diagnosis.search.batched_search import refined
from sysid.diagnosis.search.candidates import CandidateSearch
from sysid.diagnosis.search.named_sets import Node
from sysid.diagnosis.search.starts import free_slots
from sysid.effects.catalogue import about


def on_more_tracks(search: CandidateSearch, node: Node) -> Node | None:
    """The node with each of its effects on all tracks whose errors are above the noise.

    An effect is kept on the tracks that it serves. Where two act on a track, neither may serve
    before the other is there: each then starts from what it does on another track.

    Args:
        search: whose data.
        node: a set of effects.

    Returns:
        The wider set fitted to the end; None where there is nothing to widen.
    """
    model = search.model
    rms = np.sqrt(sum(node.errors.mean_squares()) / 2.0)
    loud = rms > VERDICT.loud * search.data.noise
    q, free, touched = node.q.copy(), list(node.free), node.touched.copy()
    for id in node.effects:
        e = about(id)
        if e.shared or e.couples:
            continue
        of_track = [
            [k for k in model.of(id) if model.slots[k].track == i] for i in range(model.tracks)
        ]
        serves = [bool(set(slots) & set(node.free)) for slots in of_track]
        for i in range(model.tracks):
            if serves[i] or not loud[i] or not any(serves):
                continue
            like = serves.index(True)
            for k, other in zip(of_track[i], of_track[like], strict=True):
                mine, theirs = model.slots[k], model.slots[other]
                value = node.q[other] * mine.scale / theirs.scale
                q[k] = float(np.clip(value, mine.lower, mine.upper))
            free += free_slots(model, e, q, [i])
            touched[i] = True
    if len(free) == len(node.free):
        return None
    found, _ = refined(model, q[None], [free], search.data, BUDGET.polish)
    wide = search.node(node.effects, found[0], free, touched)
    return replace(wide, excluded=node.excluded)
