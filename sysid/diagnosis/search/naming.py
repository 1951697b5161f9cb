"""Naming: which effects of the catalogue are missing, found one at a time with proof."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import Enum, auto

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.policies import BUDGET, RULE, VERDICT
from sysid.diagnosis.search.admission import beyond_sampling, tied
from sysid.diagnosis.search.batched_search import refined
from sysid.diagnosis.search.candidates import CandidateSearch, common_samples
from sysid.diagnosis.search.evidence import Evidence, alike
from sysid.diagnosis.search.named_sets import (
    Judged,
    Named,
    Naming,
    Node,
)
from sysid.diagnosis.search.other_lag import beside_either
from sysid.diagnosis.search.starts import repeats_at_top
from sysid.diagnosis.search.widening import on_more_tracks
from sysid.effects.base import Effect, Place, StartsFrom
from sysid.effects.catalogue import NOT_NAMED, about

Progress = Callable[[str, float], None]
"""(what is being done, share of the work done)."""

RequiredRatio = Callable[[Node], float]
"""What one more effect must bring the held-out error of a model below, as a share of before; 0
where nothing is left to explain."""


class NamingSearch(CandidateSearch):
    """The search over sets of effects on one system, one effect at a time."""

    def run(
        self,
        base: Node,
        effects: Sequence[Effect],
        progress: Progress | None = None,
        required: RequiredRatio | None = None,
        needed: float | None = None,
    ) -> Naming:
        """Grow one effect at a time in a small beam while the rule accepts, then drop.

        Args:
            base: the model before.
            effects: those to try.
            progress: called with what is being done.
            required: how far one more effect must bring the held-out error of a model down.
            needed: the same for the first one.
        """
        say = progress or (lambda text, share: None)
        required = required or (lambda node: self.needed)
        say("trying every effect", 0.0)
        self.origin = base.q
        judged = self.candidates(base, effects)
        first = tuple((j.id, j.score) for j in judged)
        passed = [j for j in self.passing(judged) if j.evidence.ratio < (needed or self.needed)]
        others = [
            j
            for j in passed[1:]
            if j.id not in passed[0].node.excluded and not case_of(passed[0], j)
        ]
        beam = passed[:1] + others[: BUDGET.beam - 1]
        if not beam:
            return Naming(base, base, (), self._minor(judged), first)
        minor = self._minor(judged)
        best, grown_minor = self._grown(base, beam[0].node, effects, say, required)
        minor = grown_minor if grown_minor is not None else minor
        for rival in beam[1:]:
            # the likeliest first effect may be a stand-in: try the next one where much remains
            ours, theirs = self._totals(base, (best, rival.node))
            far_ahead = ours > BUDGET.far_ahead * theirs
            if far_ahead or _little_left(base, best) or required(best) < self.needed:
                break
            say(f"starting from {rival.id} instead", 0.6)
            other, other_minor = self._grown(base, rival.node, effects, say, required)
            if self.best_of(base, (best, other)) is other:
                best, minor = other, other_minor if other_minor is not None else minor
        best = self._with_seen_clip(base, self.polished(best), judged)
        say("dropping and swapping", 0.85)
        best = self.pruned(base, best, effects)
        named = self.account(base, best, effects, judged)
        while len(named) > 1 and (unsound := self._unsound(best, named)):
            # the effect that the others need least; what remains is fitted and judged again
            weakest = max(unsound, key=lambda n: n.evidence.delta_bic)
            best = self.without(best, weakest.id)
            named = self.account(base, best, effects, judged)
        say("done", 1.0)
        return Naming(base, best, named, minor, first)

    def _grown(
        self,
        base: Node,
        node: Node,
        effects: Sequence[Effect],
        say: Progress,
        required: RequiredRatio,
    ) -> tuple[Node, tuple[tuple[str, Evidence], ...] | None]:
        """A node with effects added one at a time; and what was minor when it grew no more."""
        minor, tidied = None, 1
        while len(node.effects) < BUDGET.most_effects and (needed := required(node)) > 0.0:
            if len(node.effects) > tidied:
                tidied = len(node.effects)
                other = self._swapped(base, node, effects)
                if other is not node:
                    node = other
                    continue
            say(f"{', '.join(node.effects)}: looking for more", 0.2 * len(node.effects))
            passed, judged = self._next(base, node, effects, needed)
            minor = self._minor(judged)
            if not passed and (wide := on_more_tracks(self, node)) is not None:
                passed, _ = self._next(base, wide, effects, needed)
            if not passed or self.best_of(base, (node, passed[0].node)) is node:
                break
            node = passed[0].node
            if self.stepwise & set(node.effects[:-1]):  # held while the newest effect was tried
                node = replace(self.polished(node), excluded=node.excluded)
        return node, minor

    def _next(
        self, base: Node, node: Node, effects: Sequence[Effect], needed: float
    ) -> tuple[list[Judged], list[Judged]]:
        """Effects that may be added to a node, the most likely first, and all that were tried."""
        judged, beside = beside_either(self, node, effects)
        passed = [
            j
            for j in self.passing(judged)
            if j.evidence.ratio < needed or self.unrivalled(beside[j.id], j.id, judged)
        ]
        return [j for j in passed if not self.mends(base, beside[j.id], j.node, judged)], judged

    def _swapped(self, base: Node, node: Node, effects: Sequence[Effect]) -> Node:
        """Try look-alikes of the effects accepted so far: a later one may show one of them wrong.

        What could not be told from another at first may well be told beside a second effect; and
        so for the laws of one.
        """
        for id in node.effects[:-1]:
            likely = [
                e
                for e in effects
                if (e.id == id and e.laws)
                or ((id in e.ties or e.id in about(id).ties) and e.id not in node.effects)
            ]
            if not likely:
                continue
            judged = self.candidates(self.without(node, id), likely)
            fits = [j.node for j in judged if self.admissible(j.node)]
            best = self.best_of(base, [node, *fits])
            if best is not node and not alike(best.errors, node.errors):
                order = tuple(best.effects[-1] if e == id else e for e in node.effects)
                node = replace(best, effects=order, excluded=node.excluded)
        return node

    def _with_seen_clip(self, base: Node, best: Node, judged: Sequence[Judged]) -> Node:
        """A clip that is seen in the readings belongs to the model unless it makes it worse.

        It comes first: it needs no inference, and what else is named has to go with it.
        """
        data = self.data
        clipped = [
            repeats_at_top(data.y[data.weight[:, i] > 0.0, i]) for i in range(self.model.tracks)
        ]
        clips = {e.id for e in self.model.effects if e.starts_from is StartsFrom.CLIP_LEVEL}
        seen = next((j for j in judged if j.id in clips and j.evidence.accepted), None)
        if seen is None or not any(clipped):
            return best
        q, id = best.q.copy(), seen.id
        for k in self.model.of(id):
            q[k] = seen.node.q[k]
        rest = tuple(e for e in best.effects if e != id)
        found, _ = refined(self.model, q[None], [best.free], data, BUDGET.polish)
        node = self.node((id, *rest), found[0], best.free)
        return self.best_of(base, (node, best))

    def passing(self, judged: Sequence[Judged]) -> list[Judged]:
        """Accepted candidates, the most likely first; nearly equal ones by fewest numbers."""
        passed = [j for j in judged if self._stands(j)]
        passed = sorted(passed, key=lambda j: -j.score)
        if not passed:
            return []
        top = passed[0]
        close = [
            j
            for j in passed
            if alike(top.node.errors, j.node.errors)
            or case_of(j, top)
            or (j.id in about(top.id).ties and about(top.id).rare and self.tied(top.node, j.node))
        ]
        lead = min(
            close,
            key=lambda j: (
                about(j.id).couples,  # tracks of their own are simpler than ones that are tied
                len(j.node.free),
                about(j.id).shared,
                about(j.id).rare,
                -j.score,
            ),
        )
        ordered = [lead, *(j for j in passed if j is not lead)]
        return [self._with_excluded(j, passed) for j in ordered[: BUDGET.beam]] + ordered[
            BUDGET.beam :
        ]

    def _stands(self, j: Judged) -> bool:
        return j.evidence.accepted and self.admissible(j.node)

    def _with_excluded(self, mine: Judged, passed: Sequence[Judged]) -> Judged:
        same = tuple(
            j.id for j in passed if j.id != mine.id and alike(mine.node.errors, j.node.errors)
        )
        return replace(mine, node=replace(mine.node, excluded=(*mine.node.excluded, *same)))

    def _minor(self, judged: Sequence[Judged]) -> tuple[tuple[str, Evidence], ...]:
        return tuple(
            (j.id, j.evidence)
            for j in judged
            if j.evidence.significant
            and self.needed <= j.evidence.ratio < RULE.minor
            and self.admissible(j.node)
        )

    def best_of(self, base: Node, nodes: Sequence[Node]) -> Node:
        """The likeliest of several sets against the base; the first of equals."""
        scores = self._totals(base, nodes)
        return nodes[int(np.argmax(scores))]

    def _totals(self, base: Node, nodes: Sequence[Node]) -> list[float]:
        """Scores of whole sets against the base, with one effective sample size for all."""
        samples = common_samples(nodes)
        return [self.likelihood(base, n, samples) for n in nodes]

    def pruned(self, base: Node, node: Node, effects: Sequence[Effect]) -> Node:
        """Drop effects that the others have made needless; ``effects`` are those to try."""
        while len(node.effects) > 1:
            rests = [self.without(node, id) for id in node.effects]
            best = self.best_of(base, rests)
            whole = self._beside(node, best)
            evidence = self.evidence(best, whole, 1)
            own = evidence.significant and evidence.ratio < RULE.own_part
            if own and not self.mends(base, best, whole, effects):
                break
            node = best
        return node

    def mends(
        self, base: Node, rest: Node, whole: Node, judged: Sequence[Judged] | Sequence[Effect]
    ) -> bool:
        """Whether the newest effect only mends the formulas of others.

        No formula is all of a machine, and what one leaves looks in part like its look-alikes; what
        two leave may look like anything. So a look-alike that takes little of the gap is none of
        its own, nor is one that takes a part of it and leaves more; nor is a third effect that
        takes less than a minor share, unless that is most of what the others leave or it has no
        rivals.

        Args:
            base: the model before.
            rest: without the effect.
            whole: with it.
            judged: effects tried on ``rest``, or those to try.
        """
        small = takes_little(base, rest, whole)
        most = takes_most_of_rest(rest, whole, self.data.noise)
        if small is Little.IN_PART:
            return not most
        if small is not Little.AMONG_OTHERS:
            return small is Little.LOOK_ALIKE
        if most:
            return False
        return not self.unrivalled(rest, whole.effects[-1], judged)

    def unrivalled(self, rest: Node, id: str, judged: Sequence[Judged] | Sequence[Effect]) -> bool:
        """Whether no other effect comes near this one beside the same model.

        Args:
            rest: the model.
            id: of the effect.
            judged: effects tried on it, or those to try.
        """
        found = [j for j in judged if isinstance(j, Judged)]
        if not found:
            found = self.candidates(rest, [e for e in judged if isinstance(e, Effect)])
        scores = {j.id: j.score for j in found}
        most = max((s for other, s in scores.items() if other != id), default=0.0)
        most, mine = max(most, 0.0), scores.get(id, 0.0)
        return mine > RULE.unrivalled * most and mine - most > -RULE.certain_bic

    def account(
        self, base: Node, node: Node, effects: Sequence[Effect], first: Sequence[Judged]
    ) -> tuple[Named, ...]:
        """Each accepted effect against the model without it, and what ties with it there."""
        named = []
        for id in node.effects:
            rest = base
            if len(node.effects) == 1:
                judged: Sequence[Judged] = first
                # one that a swap or a drop has left alone may not be among the first candidates
                found = next((j for j in first if j.id == id), None)
                mine = found or self._in_place(node, base, first, len(effects))
            else:
                likely = (id, *about(id).ties, *(j.id for j in first[:4]))
                others = [
                    e
                    for e in effects
                    if e.id == id or (e.id in likely and e.id not in node.effects)
                ]
                rest = self.without(node, id)
                judged = self.candidates(rest, others, most=4)
                mine = self._in_place(node, rest, judged, len(effects))
                judged = self._as_far(mine, judged)
            ties = tuple(
                j.id
                for j in judged
                if j.id != id
                and j.evidence.accepted
                and j.id not in NOT_NAMED  # what is the same in all logs is a case of it
                and self.admissible(j.node)
                and self.tied(mine.node, j.node)
            )
            rivals = {id: mine.node} | {j.id: j.node for j in judged if j.id in (id, *ties)}
            named.append(Named(id, mine.evidence, ties, mine.node.touched, rivals, rest))
        return tuple(named)

    def _as_far(self, mine: Judged, judged: Sequence[Judged]) -> Sequence[Judged]:
        """Rivals beside the same numbers as an effect in place, where only those set them apart.

        The numbers of the other effects were fitted beside the one in place, and not beside these.
        """
        anew = next((j for j in judged if j.id == mine.id), mine)
        if anew is mine:
            return judged

        def behind(j: Judged) -> bool:
            same = j.id in about(mine.id).ties and self.tied(anew.node, j.node)
            return same and not self.tied(mine.node, j.node)

        return [self._instead(mine, j) if behind(j) else j for j in judged]

    def _instead(self, mine: Judged, rival: Judged) -> Judged:
        """The rival with the other effects as they stand beside the one in place, if that fits."""
        q = mine.node.q.copy()
        own, theirs = self.model.of(mine.id), self.model.of(rival.id)
        q[list(own)], q[list(theirs)] = self.origin[list(own)], rival.node.q[list(theirs)]
        kept = [k for k in mine.node.free if k not in own]
        free = tuple(sorted({*kept, *(k for k in rival.node.free if k in theirs)}))
        moved = self.polished(replace(rival.node, q=q, free=free))
        moved = replace(moved, excluded=rival.node.excluded)
        return replace(rival, node=self.best_of(rival.node, (rival.node, moved)))

    def tied(self, best: Node, other: Node) -> bool:
        """Whether no log can tell two models apart."""
        return tied(best, other, self.logs)

    def dropped(self, naming: Naming, id: str) -> Naming:
        """Without one of the accepted effects: what is left is fitted and judged again."""
        (gone,) = (n for n in naming.named if n.id == id)
        minor = ((id, gone.evidence), *(m for m in naming.minor if m[0] != id))
        if len(naming.named) == 1:
            return replace(naming, final=naming.base, named=(), minor=minor, intervals={})
        node = self.without(naming.final, id)
        named = self.account(naming.base, node, self.model.effects, ())
        return replace(naming, final=node, named=named, minor=minor, intervals={})

    def _beside(self, node: Node, rest: Node) -> Node:
        """The node with the effect that ``rest`` lacks as its newest, and the tracks it acts on."""
        (id,) = set(node.effects) - set(rest.effects)
        at = [self.model.slots[k].track for k in self.model.of(id) if node.q[k] != rest.q[k]]
        touched = np.array([i in at or -1 in at for i in range(self.model.tracks)])
        return replace(node, effects=(*rest.effects, id), touched=touched)

    def _unsound(self, node: Node, named: Sequence[Named]) -> list[Named]:
        """Effects that may not stand: all where a gain is chance, else delays that have shrunk."""
        if not all(n.evidence.significant for n in named):
            return list(named)
        return [n for n in named if not beyond_sampling(self.model, n.id, node.q).any()]

    def _in_place(self, node: Node, rest: Node, judged: Sequence[Judged], tried: int) -> Judged:
        """The effect that ``rest`` lacks as it stands in the node, or as found anew.

        Found anew where that explains more; a search from nothing may not find it at all.
        """
        whole = self._beside(node, rest)
        anew = [j for j in judged if j.id == whole.effects[-1]]
        samples = common_samples([whole, *(j.node for j in anew)])
        score = self.likelihood(rest, whole, samples)
        if anew and self.likelihood(rest, anew[0].node, samples) >= score:
            return anew[0]
        return Judged(whole, self.evidence(rest, whole, tried, samples), score)


def case_of(mine: Judged, other: Judged) -> bool:
    """Whether the law of an effect is a case of another's that closes hardly more of the gap."""
    more = mine.evidence.ratio**2 - other.evidence.ratio**2
    enough = RULE.mends * (1.0 - other.evidence.ratio**2)
    return mine.id in about(other.id).contains and more < enough


def _little_left(base: Node, best: Node) -> bool:
    """Whether less than a minor share of the gap is left on held-out data, noise included."""
    (_, first), (_, now) = (n.errors.mean_squares() for n in (base, best))
    return bool(np.sum(now) < 0.01 * VERDICT.minor * np.sum(first))


def _look_alike(a: Effect, b: Effect) -> bool:
    """Whether the catalogue lists two effects as a tie, or both bend the command by a curve."""
    curves = all(e.place is Place.COMMAND and not e.states for e in (a, b))
    return curves or a.id in b.ties or b.id in a.ties


class Little(Enum):
    """How an effect takes little of the gap."""

    NO = auto()
    LOOK_ALIKE = auto()
    IN_PART = auto()
    AMONG_OTHERS = auto()


def takes_little(base: Node, rest: Node, whole: Node) -> Little:
    """Whether the newest effect takes little of the gap, beside a look-alike or several others."""
    id = whole.effects[-1]
    others = [e for e in rest.effects if e not in NOT_NAMED]
    alike = any(_look_alike(about(id), about(other)) for other in others)
    if id in NOT_NAMED or not (alike or len(others) > 1):
        return Little.NO
    first, now, then = (n.errors.mean_squares()[1][whole.touched] for n in (base, rest, whole))
    taken, gap = now - then, first - then
    if alike and np.any(taken >= RULE.mends * gap):
        return Little.NO if np.any(taken >= RULE.look_alike * gap) else Little.IN_PART
    if not alike and np.any(taken >= 0.01 * VERDICT.minor * gap):
        return Little.NO
    return Little.LOOK_ALIKE if alike else Little.AMONG_OTHERS


def takes_most_of_rest(rest: Node, whole: Node, noise: Array) -> bool:
    """Whether the newest effect takes most of what the others leave above the noise of an output.

    Args:
        rest: without the effect.
        whole: with it.
        noise: of each output, (ny,).
    """
    now, then = (n.errors.mean_squares()[1] for n in (rest, whole))
    at = whole.touched
    left = (now - noise**2)[at]
    return bool(np.any((left > 0.0) & ((now - then)[at] > RULE.of_rest * left)))
