"""Forward selection of effects between tracks and ground, one at a time, the best first.

An earlier one goes again when a later one has made it needless.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.diagnosis.policies import BUDGET, POSE
from sysid.diagnosis.pose.evidence import apart, evidence_of
from sysid.diagnosis.search.evidence import Evidence
from sysid.effects.base import Length
from sysid.effects.catalogue import effect
from sysid.robot.calibration.ground_fit import (
    Candidate,
    Fitted,
    PoseSearch,
    every_candidate,
    every_slot,
    lags,
    lengths,
)


@dataclass(frozen=True, eq=False)
class Step:
    """An accepted candidate with what it was compared to.

    Attributes:
        claimed: whether it is reported; false where it only accompanies the others.
    """

    candidate: Candidate
    evidence: Evidence
    ties: tuple[Candidate, ...]
    claimed: bool = True


Grown = tuple[list[Step], Fitted, tuple[tuple[str, float], ...]]


def grown(search: PoseSearch) -> Grown:
    """What is accepted one after the other; the likeliest first one may be a stand-in.

    Turns on the spot fall short by slip as by another width, and which it is may show only beside
    what comes after: so the effects that tie with the first are tried in its place, too.
    """
    best = _grown_from(search, "")
    if not best[0]:
        return best
    first = best[0][0].candidate.id
    rivals = effect(first).hints.ties if first else ()
    others = [_grown_from(search, id) for id in rivals]
    return min([best, *(o for o in others if o[0])], key=lambda o: _score(o[1]))


def _grown_from(search: PoseSearch, instead: str) -> Grown:
    """One candidate after the other while the rule accepts; an effect before what it ties with.

    Args:
        instead: effect that comes first; empty for the best one.
    """
    chosen: list[Candidate] = []
    steps: list[Step] = []
    ranking: tuple[tuple[str, float], ...] = ()
    current = base = search.fit(())
    while sum(s.claimed and bool(s.candidate.id) for s in steps) < BUDGET.most_effects:
        rivals = [c for c in every_candidate() if allowed(c, search, chosen)]
        fits = [(c, search.fit([*chosen, c], current)) for c in rivals]
        fits.sort(key=lambda item: _score(item[1]))
        if not steps:
            ranking = _ranking(base, fits)
        rated = judged(search, current, fits)
        if instead and not steps:
            rated = [p for p in rated if p[0].id == instead]
        passed = [p for p in rated if _is_acceptable(*p, search, chosen)]
        if not passed:
            room = BUDGET.most_effects - len(steps) >= 2  # both of the pair
            pair = together(search, current, rated, chosen) if room else None
            if pair is None:
                break
            current = search.fit([*chosen, *(s.candidate for s in pair)])
            steps += pair
            chosen += [s.candidate for s in pair]
            continue
        first = passed[0]
        close = [
            (c, f, e)
            for c, f, e in passed
            if apart(first[1], f) < POSE.tie_std_errors
            or e.t**2 >= POSE.same_gain * first[2].t ** 2
        ]
        best, fitted, evidence = next((p for p in close if p[0].id), first)
        ties = tuple(c for c, _, _ in close if c.id != best.id)
        steps.append(Step(best, evidence, ties, not _short(best, fitted, search)))
        chosen.append(best)
        current = fitted
    for step in steps:
        rest = [c for c in chosen if c is not step.candidate]
        without = search.fit(rest)
        asked_for = evidence_of(without, current, len(every_candidate())).significant
        if not (asked_for and _away(step.candidate, current)):
            chosen, current = rest, without
    kept = [
        replace(s, claimed=s.claimed and not _short(s.candidate, current, search))
        for s in steps
        if s.candidate in chosen
    ]
    return kept, current, ranking


PAIRED = 2
"""Likely effects that are tried together with every other one: a width and its tie, the slip."""


def together(
    search: PoseSearch,
    current: Fitted,
    rated: Sequence[tuple[Candidate, Fitted, Evidence]],
    chosen: Sequence[Candidate],
) -> tuple[Step, Step] | None:
    """Two effects of which neither is proven without the other; None where there are none.

    A turn that falls short by another width and by hard starts, too, predicts no other mission's
    turn by its width alone.
    """
    pairs: list[tuple[float, tuple[Step, Step]]] = []
    likely = [(c, f) for c, f, e in rated if c.id and e.significant and e.t >= POSE.late_t]
    for first, alone in likely[:PAIRED]:
        with_it = [*chosen, first]
        for second in every_candidate():
            if not (second.id and allowed(second, search, with_it)):
                continue
            both = search.fit([*with_it, second], alone)
            other = search.fit([*chosen, second], current)
            fits = [(first, both, other), (second, both, alone)]
            each = [judged(search, without, [(c, f)]) for c, f, without in fits]
            tried = PAIRED * len(every_candidate())
            whole = evidence_of(current, both, tried)
            if all(e and _proven(*e[0], search) for e in each) and whole.accepted:
                pair = Step(first, each[0][0][2], ()), Step(second, each[1][0][2], ())
                pairs.append((_score(both), pair))
    return min(pairs, key=lambda p: p[0])[1] if pairs else None


def _proven(c: Candidate, f: Fitted, e: Evidence, search: PoseSearch) -> bool:
    return _away(c, f) and not _short(c, f, search) and e.accepted and not _late(e)


def judged(
    search: PoseSearch, current: Fitted, fits: Sequence[tuple[Candidate, Fitted]]
) -> list[tuple[Candidate, Fitted, Evidence]]:
    """What speaks for each candidate whose parameters mean something."""
    return [
        (c, f, evidence_of(current, f, len(fits)))
        for c, f in fits
        if not _stuck(c, f) and _large_enough(c, f, search)
    ]


def _stuck(c: Candidate, fitted: Fitted) -> bool:
    """Whether a candidate's parameter ended on a bound, or that of another one which is not
    nothing: what a candidate makes needless goes to its null value, and goes in the end."""
    return any(k in c.slots or fitted.q[k] != every_slot()[k].null for k in fitted.at_bound)


def _away(c: Candidate, fitted: Fitted) -> bool:
    """Whether a candidate's parameters, or one of several, are away from doing nothing."""
    return any(
        abs(fitted.q[k] - every_slot()[k].null) > POSE.min_std_errors * (fitted.std_error(k) or 0.0)
        for k in c.slots
    )


def _is_acceptable(
    c: Candidate, f: Fitted, e: Evidence, search: PoseSearch, chosen: Sequence[Candidate]
) -> bool:
    """Whether the rule accepts a candidate.

    A parameter that what is still missing leaves uncertain may come where it predicts much; in the
    end it must be sure. Of a lag shorter than the sampling leaves open nothing is claimed: it
    accompanies the effects where the likelihood asks for it, so that no effect makes up for it.
    """
    later = bool(chosen)
    if not _away(c, f) and (not e.accepted or _late(e)):
        return False
    if _short(c, f, search):
        return later and e.significant
    return e.accepted and not (later and _late(e)) and _beyond_others(c, search, chosen)


def _short(c: Candidate, f: Fitted, search: PoseSearch) -> bool:
    """Whether a candidate is a lag so short that the sampling may make it."""
    least = POSE.min_lag_samples * search.estimation.tracks[0].dt
    return (c in lags() or c.law.as_lag) and abs(float(f.q[c.slots[0]])) <= least


def _late(evidence: Evidence) -> bool:
    """Whether a later effect gains too little: most small late gains are chance."""
    return evidence.t < POSE.late_t or evidence.ratio >= POSE.late_ratio


def allowed(c: Candidate, search: PoseSearch, chosen: Sequence[Candidate]) -> bool:
    """Both radii and their common scale are two parameters together, not three; and slip at any
    speed is one of them, which only a known radius shows. One law says what way is lost
    while the vehicle speeds up."""
    taken = (*search.always, *chosen)
    if c in taken or (c.law.of_changes and any(x.law.of_changes for x in taken)):
        return False
    radii = [x for x in taken if x.length is Length.RADIUS or x.law.as_radius]
    if c.law.as_radius:
        return search.radius_known and not radii
    return not (c.length is Length.RADIUS and len(radii) == 2)


def _large_enough(c: Candidate, fitted: Fitted, search: PoseSearch) -> bool:
    """Whether a parameter is beyond what a ruler, or the sampling, leaves open."""
    value = abs(float(fitted.q[c.slots[0]]))
    if c.law.of_speed:
        fastest = max(float(np.nanmax(np.abs(t.omega))) for t in search.estimation.tracks)
        return value * fastest > POSE.min_growing_slip
    return not c.law.as_radius or value > POSE.min_slip


def _beyond_others(c: Candidate, search: PoseSearch, chosen: Sequence[Candidate]) -> bool:
    """Whether a law is there whatever does nearly the same is worth: measurements of the pose that
    come late for one with a memory; for slip in straight drive what only shortens turns."""
    if not c.law.parameters:
        return True
    alike = lags() if c.law.as_lag else [x for x in lengths() if x.id]
    beside = [*chosen, *(x for x in alike if x not in (*search.always, *chosen))]
    before = search.fit(beside, search.fit(chosen))
    after = search.fit([*beside, c], before)
    return (
        not _stuck(c, after)
        and _away(c, after)
        and _large_enough(c, after, search)
        and not _short(c, after, search)
        and evidence_of(before, after, len(every_candidate())).accepted
    )


def _score(fitted: Fitted) -> float:
    """N ln V + k ln N, to a digit that no search decides: what is the same thing said in two ways
    (one radius smaller, the other larger, beside radii that are estimated) comes in order."""
    n = sum(e.size for e in (*fitted.white.estimation, *fitted.white.holdout))
    return round(n * math.log(max(fitted.cost, 1e-300)) + len(fitted.free) * math.log(n), 2)


def _ranking(
    base: Fitted, fits: Sequence[tuple[Candidate, Fitted]]
) -> tuple[tuple[str, float], ...]:
    scores: dict[str, float] = {}
    for c, f in fits:
        if c.id:
            scores.setdefault(c.id, 1.0 - math.sqrt(f.cost / base.cost))
    return tuple(scores.items())
