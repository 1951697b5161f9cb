"""What may be named: numbers away from their null and their bounds; and what is a tie."""

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.search.evidence import difference
from sysid.diagnosis.search.logs import Logs
from sysid.diagnosis.search.named_sets import Node
from sysid.diagnosis.search.numbers import Slot
from sysid.diagnosis.search.supermodel import SuperModel
from sysid.effects.base import StartsFrom
from sysid.effects.catalogue import CHANGED, about
from sysid.effects.sensor import MOST_SAMPLED
from sysid.fitting.holdout import Errors


def beyond_sampling(model: SuperModel, id: str, q: Array) -> NDArray[np.bool_]:
    """Tracks on which an effect is later than sampling itself makes it, (tracks,).

    Beside another delay or lag a part of a sample is what that one's law misses.
    """
    found = np.ones(model.tracks, dtype=bool)
    if not about(id).beyond_sampling:
        return found
    others = [e.id for e in model.effects if e.beyond_sampling and e.id != id]
    late = np.zeros(model.tracks, dtype=bool)
    for slot, value in ((model.slots[k], q[k]) for other in others for k in model.of(other)):
        if slot.track >= 0:
            late[slot.track] |= value != slot.null
    for k in model.of(id):
        i = model.slots[k].track
        if i >= 0:
            found[i] = q[k] > (1.0 if late[i] else MOST_SAMPLED) * model.dt
    return found


def on_bound(slot: Slot, value: float) -> bool:
    """Whether a number ended on a bound of the search that is not its null value."""
    at = slot.lower if value - slot.lower < slot.upper - value else slot.upper
    return _at(slot, value, at) and at != slot.null


def _at(slot: Slot, value: float, place: float) -> bool:
    """Whether a number ended at a place, against its range and its usual size."""
    return abs(value - place) < min(1e-3 * (slot.upper - slot.lower), 0.01 * slot.scale)


def admissible(model: SuperModel, origin: Array, node: Node) -> bool:
    """Whether the newest effect's numbers are away from their null and from their bounds."""
    id = node.effects[-1]
    mine = [k for k in node.free if model.slots[k].owner == id]
    gains = [k for k in node.free if model.slots[k].name == "gain"]
    anew = id == CHANGED.id or any(about(e).starts_from is StartsFrom.SIGNS for e in node.effects)
    if not anew:  # else the base says nothing of the core
        moved = np.abs(node.q[gains] / origin[gains])
        if np.any((moved < RULE.least_gain) | (moved > RULE.most_gain)):
            return False
    if not mine:
        return True  # no number of its own is searched: it is read off the data, or the core's are
    if not beyond_sampling(model, id, node.q).any():
        return False
    first = about(id).parameters[0].name
    numbers = {p.name: p for p in about(id).parameters}
    inside = []
    for k in mine:
        slot = model.slots[k]
        value = node.q[k]
        ended = on_bound(slot, value) and not numbers[slot.name].at_limit
        at_null = _at(slot, value, slot.null)
        if slot.null in (slot.lower, slot.upper) and at_null:
            ended = slot.name == first and not numbers[slot.name].at_null
        inside.append((not ended, abs(value - slot.null) > 0.02 * slot.scale))
    return all(a for a, _ in inside) and any(b for _, b in inside)


def tied(best: Node, other: Node, logs: Logs | None = None) -> bool:
    """Whether the data cannot tell two models apart.

    One log that can is enough, unless another one says the opposite: of a short run that was made
    to tell them apart, a long log that cannot would leave nothing.
    """
    a, b = best.effects[-1], other.effects[-1]
    known = b in about(a).ties or a in about(b).ties
    if _close(best.errors, other.errors, known):
        if logs is None or len(set(logs.estimation)) < 2:
            return True
        parts = [_of_log(best.errors, other.errors, logs, k) for k in sorted(set(logs.estimation))]
        told = any(not _close(mine, theirs, known) for mine, theirs in parts)
        return not told or any(not _close(theirs, mine, known) for mine, theirs in parts)
    return False


def _close(best: Errors, other: Errors, known: bool) -> bool:
    """Whether errors of two models differ by little, or by chance, in favour of the first."""
    t, ratio = difference(best, other)
    return ratio < (RULE.known_tie if known else RULE.tie) or (
        t < RULE.t and ratio < RULE.chance_tie
    )


def _of_log(mine: Errors, theirs: Errors, logs: Logs, k: int) -> tuple[Errors, Errors]:
    """The errors of two models on one log."""

    def only(errors: Errors) -> Errors:
        parts = zip((errors.estimation, errors.held), (logs.estimation, logs.held), strict=True)
        a, b = (tuple(e for e, i in zip(p, of, strict=True) if i == k) for p, of in parts)
        return Errors(a, b)

    return only(mine), only(theirs)
