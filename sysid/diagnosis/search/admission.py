"""Admissible candidates: parameters away from null values and bounds; and the test for ties."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.search.evidence import difference
from sysid.diagnosis.search.full_model import FullModel, ModelParameter
from sysid.diagnosis.search.prepared import Logs
from sysid.diagnosis.search.selection import CandidateModel
from sysid.effects.base import Place, StartsFrom
from sysid.effects.catalogue import CHANGED, about
from sysid.effects.sensor import MOST_SAMPLED
from sysid.fitting.holdout import Errors

SLOWER = 5.0
"""Time constants of the core after which its own response has ended (to 1 %)."""


def beyond_sampling(model: FullModel, id: str, q: Array) -> NDArray[np.bool_]:
    """Tracks on which an effect is later than sampling itself makes it, (tracks,)."""
    beyond = np.ones(model.tracks, dtype=bool)
    if about(id).hints.beyond_sampling:
        for k in model.of(id):
            i = model.parameters[k].track
            if i >= 0:
                beyond[i] = q[k] > sampled(model, k, q)
    return beyond


def sampled(model: FullModel, slot: int, q: Array) -> float:
    """How late sampling itself may make an effect's parameter [s]; 0 of one that is not a time.

    Beside another delay or lag of the track a part of a sample is what that one's law misses.
    """
    p = model.parameters[slot]
    if not about(p.owner).hints.beyond_sampling or p.track < 0:
        return 0.0
    others = [e.id for e in model.effects if e.hints.beyond_sampling and e.id != p.owner]
    beside = (k for other in others for k in model.of(other))
    late = any(
        model.parameters[k].track == p.track and q[k] != model.parameters[k].null for k in beside
    )
    return (1.0 if late else MOST_SAMPLED) * model.dt


def on_bound(p: ModelParameter, value: float) -> bool:
    """Whether a parameter ended on a bound of the search that is not its null value."""
    at = p.lower if value - p.lower < p.upper - value else p.upper
    return _at(p, value, at) and at != p.null


def _at(p: ModelParameter, value: float, target: float) -> bool:
    """Whether a parameter ended at a place, against its range, its usual size and the place."""
    near = min(1e-3 * (p.upper - p.lower), 0.01 * (p.usual or p.scale))
    return abs(value - target) < min(near, 0.5 * abs(target) or near)


def admissible(model: FullModel, origin: Array, candidate: CandidateModel) -> bool:
    """Whether the newest effect's parameters are away from their null and from their bounds."""
    id = candidate.effects[-1]
    own_parameters = [k for k in candidate.free if model.parameters[k].owner == id]
    gains = [k for k in candidate.free if model.parameters[k].name == "gain"]
    anew = id == CHANGED.id or any(
        about(e).hints.starts_from is StartsFrom.SIGNS for e in candidate.effects
    )
    if not anew:  # else the base says nothing of the core
        moved = np.abs(candidate.q[gains] / origin[gains])
        # a base that a weight holds answers with nearly none of the gain, or against it
        held = any(about(e).place is Place.TORQUE and about(e).waves for e in candidate.effects)
        if np.any(moved < RULE.least_gain) or (not held and np.any(moved > RULE.most_gain)):
            return False
    if not own_parameters:
        return True  # no number of its own is searched: it is read off the data, or the core's are
    if not beyond_sampling(model, id, candidate.q).any():
        return False
    if about(id).hints.gathers and not _slower(model, candidate, own_parameters):
        return False
    if ended(model, id, candidate).any():
        return False
    return any(candidate.q[k] != model.parameters[k].null for k in own_parameters)


def ended(model: FullModel, id: str, candidate: CandidateModel) -> NDArray[np.bool_]:
    """Tracks on which a free parameter of an effect ends on a bound, or where it does nothing, that
    is no value of the effect, (tracks,)."""
    tracks = np.zeros(model.tracks, dtype=bool)
    for k in (k for k in candidate.free if model.parameters[k].owner == id):
        p, value, first = model.parameters[k], candidate.q[k], about(id).parameters[0].name
        at_end = on_bound(p, value) and not p.of.at_limit
        if p.null in (p.lower, p.upper) and _at(p, value, p.null):
            at_end = p.name == first and not p.of.at_null
        if at_end:
            tracks[p.track if p.track >= 0 else slice(None)] = True
    return tracks


def _slower(model: FullModel, candidate: CandidateModel, own: Sequence[int]) -> bool:
    """Whether an effect that comes on slowly does so by time constants well beyond the core's: near
    these it bends its response, whatever the unit of time."""
    core = model.time_constants(candidate.q)
    own = [k for k in own if model.parameters[k].of.unit == "s"]
    return all(candidate.q[k] >= SLOWER * core[max(model.parameters[k].track, 0)] for k in own)


def tied(best: CandidateModel, other: CandidateModel, logs: Logs | None = None) -> bool:
    """Whether the data cannot distinguish two models.

    One log that can is enough, unless another one says the opposite: of a short run that was made
    to distinguish them, a long log that cannot would leave nothing.
    """
    a, b = best.effects[-1], other.effects[-1]
    known = b in about(a).hints.ties or a in about(b).hints.ties
    if _close(best.errors, other.errors, known):
        if logs is None or len(set(logs.estimation)) < 2:
            return True
        parts = [_of_log(best.errors, other.errors, logs, k) for k in sorted(set(logs.estimation))]
        distinguished = any(
            not _close(best_of_log, other_of_log, known) for best_of_log, other_of_log in parts
        )
        return not distinguished or any(
            not _close(other_of_log, best_of_log, known) for best_of_log, other_of_log in parts
        )
    return False


def _close(best: Errors, other: Errors, known: bool) -> bool:
    """Whether errors of two models differ by little, or by chance, in favour of the first."""
    t, ratio = difference(best, other)
    return ratio < (RULE.known_tie if known else RULE.tie) or (
        t < RULE.t and ratio < RULE.chance_tie
    )


def _of_log(a: Errors, b: Errors, logs: Logs, k: int) -> tuple[Errors, Errors]:
    """The errors of two models on one log."""

    def only(errors: Errors) -> Errors:
        parts = zip(
            (errors.estimation, errors.holdout), (logs.estimation, logs.holdout), strict=True
        )
        a, b = (tuple(e for e, i in zip(p, of, strict=True) if i == k) for p, of in parts)
        return Errors(a, b)

    return only(a), only(b)
