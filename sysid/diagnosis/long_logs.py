"""Long logs: effects are searched on evenly spread pieces of them, and judged on all samples."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid.data.checks.integral import integrates
from sysid.data.facts import LogFacts
from sysid.data.record import PIECES, Array, Record, shortened
from sysid.diagnosis.base_model import Base
from sysid.diagnosis.diagnosis import Trace
from sysid.diagnosis.gap import Gap
from sysid.diagnosis.samples import inspect_samples
from sysid.diagnosis.search.prepared import prepare
from sysid.diagnosis.search.selection import CandidateModel, Selection
from sysid.diagnosis.session import DiagnosisSession

SEARCHED = 6_000
"""Samples that effects are searched on: a choice that was tried on a motor at 1 kHz and a propeller
at 100 Hz only."""

SHORTEST, RISES = 300, 10.0
"""Samples of a piece at least, of which 90 are held out and can be whitened, and times to 63 % in
one: many short pieces meet more levels of the command than a few long ones."""

LONG = 10_000
"""Samples from which a log is searched in pieces."""


def pieces_of(records: Sequence[Record]) -> tuple[Record, ...]:
    """``SEARCHED`` samples of long records, as pieces that know what went before them.

    How long a machine has run and how far it has turned by then is what a battery that empties, a
    motor that warms and a ripple over the angle depend on.
    """
    total = sum(map(len, records))
    if total <= LONG:
        return tuple(records)
    slowest = max(s.time_constant or np.inf for s in LogFacts(tuple(records)).speeds)
    shortest = max(SHORTEST, RISES * slowest / records[0].dt)
    pieces = []
    for r in records:
        turned = np.vstack([np.zeros((1, r.ny)), np.cumsum(r.y, axis=0) * r.dt])
        samples = max(len(r) * SEARCHED // total, 1)
        for piece in shortened((r,), samples, max(int(samples / shortest), PIECES)):
            k = round((piece.t0 - r.t0) / r.dt)
            pieces.append(replace(piece, since=np.append(k * r.dt, turned[k])))
    return tuple(pieces)


@dataclass(frozen=True, eq=False)
class InFull:
    """Both models on all samples of long logs."""

    gap: Gap
    traces: tuple[Trace, ...]
    sentence: str


@dataclass(frozen=True, eq=False)
class Searched:
    """What effects are searched on: the logs, or pieces of long ones.

    Attributes:
        facts, holdout_facts: of it; None without validation logs.
        whole: what judges the models on all samples where pieces are searched: the validation logs,
            or those that the pieces were taken from. Empty where the search sees all samples.
    """

    facts: LogFacts
    holdout_facts: LogFacts | None
    whole: tuple[Record, ...]

    @cached_property
    def _weights(self) -> tuple[Array, ...]:
        """0 where a measurement was lost, repeated or searched on, (N, ny) a record."""
        read = inspect_samples(LogFacts(self.whole)).weights
        pieces = self.facts.records if self.holdout_facts is None else ()
        return tuple(w * _outside(r, pieces) for r, w in zip(self.whole, read, strict=True))

    def judged(self, session: DiagnosisSession, selection: Selection) -> InFull:
        """Free runs of the original and the augmented model over whole logs."""
        before = _runs(session.base, session.base.model, self.whole)
        after = before
        if selection.selected:
            after = _runs(session.base, selection.final, self.whole)
        each = tuple(zip(self.whole, before, after, self._weights, strict=True))
        traces = tuple(
            Trace(r, a, b, "held-out", np.asarray(w.max(axis=1) > 0.0, dtype=np.float64))
            for r, a, b, w in each
        )
        old = [np.where(w > 0.0, r.y - a, np.nan) for r, a, _, w in each]
        new = [np.where(w > 0.0, r.y - b, np.nan) for r, _, b, w in each]
        pieces, counted = self.facts.records, int(sum(t.counted.sum() for t in traces))
        others = "the other" if self.holdout_facts is None else "all"
        return InFull(
            session.gap_of(old, new),
            traces,
            f"Effects were searched on {sum(map(len, pieces))} samples in {len(pieces)} pieces; "
            f"held-out errors are of {others} {counted} samples.",
        )


def searched_on(
    estimation: Sequence[Record], holdout: Sequence[Record] | None, given: bool
) -> Searched:
    """The logs, or pieces of long ones.

    Args:
        given: whether a model is given; without one, rates of positions are few already.
    """
    if not given and integrates(estimation):
        pieces, judging = tuple(estimation), tuple(holdout or ())
    else:
        pieces, judging = pieces_of(estimation), pieces_of(holdout or ())
    cut = (*pieces, *judging) != (*estimation, *(holdout or ()))
    whole = tuple(holdout or estimation) if cut else ()
    return Searched(LogFacts(pieces), LogFacts(judging) if judging else None, whole)


def _outside(record: Record, pieces: Sequence[Record]) -> Array:
    """1 for samples of a record in none of its pieces, (N, 1)."""
    outside = np.ones((len(record), 1))
    for p in pieces:
        k = round((p.t0 - record.t0) / record.dt)
        if p.sha256 == record.sha256 and 0 <= k < len(record):
            outside[k : k + len(p)] = 0.0
    return outside


def _runs(base: Base, candidate: CandidateModel, whole: Sequence[Record]) -> tuple[Array, ...]:
    """Free runs of a candidate over whole records, (N, tracks) each."""
    search = base.search
    of = {r.sha256: k for r, k in zip(search.holdout, search.logs.holdout, strict=True)}
    logs = [of.get(r.sha256, 0) for r in whole]
    data = prepare(
        [base.driven(r) for r in whole], search.scales, search.delay, None, logs, search.later
    )
    q = search.in_phase(candidate.q, candidate.effects)
    return data.split(search.model.run(q[None], data)[0])
