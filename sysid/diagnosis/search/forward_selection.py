"""Forward selection: effects of the catalogue are added one at a time, each with its evidence."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnosis.policies import BUDGET, RULE
from sysid.diagnosis.search.admission import ended, tied
from sysid.diagnosis.search.candidates import CandidateSearch, common_samples
from sysid.diagnosis.search.evidence import Evidence, alike
from sysid.diagnosis.search.moves import swapped, together
from sysid.diagnosis.search.redundancy import is_redundant
from sysid.diagnosis.search.selection import (
    CandidateModel,
    ScoredCandidate,
    SelectedEffect,
    Selection,
)
from sysid.effects.base import Effect
from sysid.effects.catalogue import NOT_NAMED, about

CLEARLY = 10.0
"""Beside what ties with an effect the next has to explain more by this much, in units of BIC."""

Progress = Callable[[str, float], None]
"""(what is being done, share of the work done)."""

RequiredRatio = Callable[[CandidateModel], float]
"""What one more effect must bring the held-out error of a model below, as a share of before; 0
where nothing is left to explain."""


class ForwardSelection(CandidateSearch):
    """The search over sets of effects on one system, one effect at a time."""

    def run(
        self,
        base: CandidateModel,
        effects: Sequence[Effect],
        progress: Progress | None = None,
        required: RequiredRatio | None = None,
        needed: float | None = None,
    ) -> Selection:
        """Grow one effect at a time while the rule accepts, then prune.

        Args:
            required: how far one more effect must bring the held-out error of a model down.
            needed: the same for the first one.
        """
        say = progress or (lambda text, share: None)
        required = required or (lambda model: self.needed)
        say("trying every effect", 0.0)
        self.origin = base.q
        judged = self.candidates(base, effects)
        first = tuple((j.id, j.score) for j in judged)
        passed = [j for j in self.passing(judged) if j.evidence.ratio < (needed or self.needed)]
        least = min(needed or self.needed, RULE.in_loop)  # two at once must do more
        starts = self._leaders(passed)
        if not starts and (pair := together(self, base, judged, effects, least)):
            starts = [pair]
        minor = self._minor(judged)
        if not starts:
            return Selection(base, base, (), minor, first)
        best, grown_minor = self._grown(base, starts, effects, say, required)
        for other in self._others(passed, best) if required(best) > 0.0 else ():
            again, minor_again = self._grown(base, [other], effects, say, required)
            # of sets that all leave something, more names are no better answer
            as_plain = len(again.effects) <= len(best.effects) or required(again) == 0.0
            if as_plain and self._likeliest(base, [best, again]):
                best, grown_minor = again, minor_again
        minor = grown_minor if grown_minor is not None else minor
        selected = self.account(base, best, effects, judged)
        say("done", 1.0)
        return Selection(base, best, selected, minor, first)

    def _grown(
        self,
        base: CandidateModel,
        leaders: Sequence[CandidateModel],
        effects: Sequence[Effect],
        say: Progress,
        required: RequiredRatio,
    ) -> tuple[CandidateModel, tuple[tuple[str, Evidence], ...] | None]:
        """A candidate with effects added one at a time, without those that others have made
        needless; and what was minor when it grew no more.

        Args:
            leaders: the likeliest, and what ties with it: the next effect may tell them apart.
        """
        minor, tidied, model = None, 1, leaders[0]
        while len(model.effects) < BUDGET.most_effects and (needed := required(model)) > 0.0:
            if len(model.effects) > tidied:
                tidied = len(model.effects)
                other = swapped(self, base, model, effects)
                if other is not model:
                    model, leaders = other, (other,)
                    continue
            say(f"{', '.join(model.effects)}: looking for more", 0.2 * len(model.effects))
            tried = [self._next(base, one, effects, needed) for one in leaders]
            minor = self._minor(tried[0][1])
            grown = [passed for passed, _ in tried if passed]
            if not grown:
                break
            best = self._likeliest(base, [passed[0].model for passed in grown])
            if self.best_of(base, (model, grown[best][0].model)) is model:
                break
            leaders = self._leaders(grown[best])
            model = self._restarted(base, leaders[0])
            if self.stepwise & set(model.effects[:-1]):  # held while the newest effect was tried
                model = self.fitted(model)
            leaders = (model, *leaders[1:])
        model = self.pruned(base, self.fitted(model))
        wide = self._on_more_tracks(base, model)
        return model if wide is model else self.pruned(base, wide), minor

    def _leaders(self, passed: Sequence[ScoredCandidate]) -> list[CandidateModel]:
        """The likeliest of accepted candidates, and a few that no log can distinguish from it."""
        if not passed:
            return []
        lead, *others = (j.model for j in passed)
        return [lead, *[m for m in others if self.tied(lead, m)][: BUDGET.leaders - 1]]

    def _others(
        self, passed: Sequence[ScoredCandidate], found: CandidateModel
    ) -> list[CandidateModel]:
        """First effects that a set which leaves something does not hold: one of them, less likely
        by itself, may be part of a likelier set."""
        missing = [j.model for j in passed if j.id not in found.effects]
        return missing[: BUDGET.leaders - 1]

    def _likeliest(self, base: CandidateModel, models: Sequence[CandidateModel]) -> int:
        """The first of several candidates, or one that is clearly more likely."""
        samples = common_samples(models)
        scores = [self.likelihood(base, m, samples) for m in models]
        best = int(np.argmax(scores))
        return best if scores[best] > scores[0] + CLEARLY else 0

    def _restarted(self, base: CandidateModel, model: CandidateModel) -> CandidateModel:
        """A candidate, or the same found from the core of the base where that fits better: a core
        that has made up for what was missing may hold the rest where it is."""
        q = model.q.copy()
        core = list(self.core)
        q[core] = base.q[core]
        return self.best_of(base, (model, self.fitted(model, q)))

    def _on_more_tracks(self, base: CandidateModel, model: CandidateModel) -> CandidateModel:
        """A candidate whose effects act on further tracks, too, where that shows beside the others,
        or instead of what acts there alone: one track is found first where it goes further into a
        limit."""
        if self.model.inputs > self.model.tracks:
            return model
        for id in model.effects:
            on = self._on(model, id)
            for i in sorted({*range(self.model.tracks)} - {*on}) if on else ():
                wide = self._also_on(model, id, i)
                evidence = self.evidence(model, wide, 1)
                tried = [wide] * (evidence.significant and evidence.ratio < RULE.own_part)
                if not tried:
                    only = (o for o in model.effects if self._on(model, o) == (i,))
                    instead = [self._also_on(self.without(model, o), id, i) for o in only]
                    tried = [w for w in instead if self._likeliest(base, [model, w])]
                tried = [w for w in tried if not ended(self.model, id, w)[i]]
                if tried:
                    wide = self.best_of(base, tried)
                    model = replace(wide, touched=model.touched | wide.touched)
        return model

    def _also_on(self, model: CandidateModel, id: str, track: int) -> CandidateModel:
        """A candidate with one of its effects on a further track, too, fitted from the numbers that
        it has where it acts."""
        at, every = self.model.index, self.model.parameters
        q, here = model.q.copy(), self._on(model, id)[0]
        own = [k for k in self.model.of(id) if every[k].track == here]
        there = [at[id, every[k].name, track] for k in own]
        for k, n in zip(own, there, strict=True):
            factor = 1.0 if every[k].of.choice else every[n].scale / every[k].scale
            q[n] = every[n].within(q[k] * factor)
        free = [n for k, n in zip(own, there, strict=True) if k in model.free]
        touched = np.arange(self.model.tracks) == track
        return self.fitted(replace(model, touched=touched), q, (*model.free, *free))

    def _on(self, model: CandidateModel, id: str) -> tuple[int, ...]:
        """Tracks on which an effect has free parameters of their own; none where they share it."""
        tracks = {self.model.parameters[k].track for k in self.model.of(id) if k in model.free}
        return tuple(sorted(tracks - {-1}))

    def _next(
        self, base: CandidateModel, model: CandidateModel, effects: Sequence[Effect], needed: float
    ) -> tuple[list[ScoredCandidate], list[ScoredCandidate]]:
        """Effects that may be added to a candidate, likeliest first, and all that were tried."""
        judged = self.candidates(model, effects)
        passed = [
            j
            for j in self.passing(judged)
            if j.evidence.ratio < needed and not is_redundant(base, model, j.model, self.data.noise)
        ]
        return passed, judged

    def passing(self, judged: Sequence[ScoredCandidate]) -> list[ScoredCandidate]:
        """Accepted candidates, the most likely first; nearly equal ones by fewest parameters."""
        passed = [j for j in judged if self._is_acceptable(j)]
        passed = sorted(passed, key=lambda j: -j.score)
        if not passed:
            return []
        top = passed[0]
        close = [
            j
            for j in passed
            if alike(top.model.errors, j.model.errors)
            or (
                j.id in about(top.id).hints.ties
                and about(top.id).hints.rare
                and self.tied(top.model, j.model)
            )
        ]
        lead = min(
            close,
            key=lambda j: (
                about(j.id).couples,  # tracks of their own are simpler than ones that are tied
                len(j.model.free),
                about(j.id).shared,
                about(j.id).hints.rare,
                -j.score,
            ),
        )
        return [lead, *(j for j in passed if j is not lead)]

    def _is_acceptable(self, j: ScoredCandidate) -> bool:
        return j.evidence.accepted and self.admissible(j.model)

    def _minor(self, judged: Sequence[ScoredCandidate]) -> tuple[tuple[str, Evidence], ...]:
        return tuple(
            (j.id, j.evidence)
            for j in judged
            if j.evidence.significant
            and self.needed <= j.evidence.ratio < RULE.minor
            and self.admissible(j.model)
        )

    def pruned(self, base: CandidateModel, model: CandidateModel) -> CandidateModel:
        """Drop effects, and those of single tracks, that the others have made needless."""
        while len(model.effects) > 1:
            of_tracks = [(id, self._on(model, id)) for id in model.effects]
            parts = [(id, at) for id, on in of_tracks for at in (None, *(on if on[1:] else ()))]
            rests = [self.without(model, *part) for part in parts]
            best = self.best_of(base, rests)
            _, at = parts[rests.index(best)]
            touched = np.arange(self.model.tracks) == at
            whole = self._beside(model, best) if at is None else replace(model, touched=touched)
            evidence = self.evidence(best, whole, 1)
            needed = evidence.significant and evidence.ratio < RULE.own_part
            corrects = at is None and is_redundant(base, best, whole, self.data.noise)
            if needed and not corrects:
                break
            model = best
        return model

    def account(
        self,
        base: CandidateModel,
        model: CandidateModel,
        effects: Sequence[Effect],
        first: Sequence[ScoredCandidate],
    ) -> tuple[SelectedEffect, ...]:
        """Each accepted effect against the model without it, and what ties with it there."""
        selected = []
        for id in model.effects:
            rest = base
            if len(model.effects) == 1:
                judged: Sequence[ScoredCandidate] = first
                # one that swapping or pruning has left alone may not be among the first candidates
                first_candidate = next((j for j in first if j.id == id), None)
                in_place = first_candidate or self._in_place(model, base, first, len(effects))
            else:
                likely = {*about(id).hints.ties, *(j.id for j in first[:4])} - {*model.effects} | {
                    id
                }
                others = [e for e in effects if e.id in likely]
                rest = self.without(model, id)
                judged = [  # to the end: what the effect hid of the others moves with it
                    self.scored(rest, self.fitted(j.model), len(others))
                    for j in self.candidates(rest, others, most=4)
                ]
                in_place = self._in_place(model, rest, judged, len(effects))
            ties = tuple(
                j.id
                for j in judged
                if j.id != id
                and j.evidence.rivals(in_place.evidence)
                and j.id not in NOT_NAMED  # what is the same in all logs is a case of it
                and self.admissible(j.model)
                and self.tied(in_place.model, j.model)
            )
            rivals = {id: in_place.model} | {j.id: j.model for j in judged if j.id in (id, *ties)}
            selected.append(
                SelectedEffect(id, in_place.evidence, ties, in_place.model.touched, rivals, rest)
            )
        return tuple(selected)

    def tied(self, best: CandidateModel, other: CandidateModel) -> bool:
        """Whether no log can distinguish two models."""
        return tied(best, other, self.logs)

    def without_effect(self, selection: Selection, id: str) -> Selection:
        """Without one of the accepted effects: what is left is fitted and judged again."""
        (gone,) = (n for n in selection.selected if n.id == id)
        minor = ((id, gone.evidence), *(m for m in selection.minor if m[0] != id))
        if len(selection.selected) == 1:
            return replace(selection, final=selection.base, selected=(), minor=minor, intervals={})
        model = self.without(selection.final, id)
        selected = self.account(selection.base, model, self.model.effects, ())
        return replace(selection, final=model, selected=selected, minor=minor, intervals={})

    def _beside(self, model: CandidateModel, rest: CandidateModel) -> CandidateModel:
        """The candidate with the effect that ``rest`` lacks last, and the tracks it acts on."""
        (id,) = set(model.effects) - set(rest.effects)
        at = [self.model.parameters[k].track for k in self.model.of(id) if model.q[k] != rest.q[k]]
        touched = np.array([i in at or -1 in at for i in range(self.model.tracks)])
        return replace(model, effects=(*rest.effects, id), touched=touched)

    def _in_place(
        self,
        model: CandidateModel,
        rest: CandidateModel,
        judged: Sequence[ScoredCandidate],
        tried: int,
    ) -> ScoredCandidate:
        """The effect that ``rest`` lacks, as it is in the candidate or as found anew.

        Found anew where that explains more; a search from nothing may not find it at all.
        """
        whole = self._beside(model, rest)
        anew = [j for j in judged if j.id == whole.effects[-1]]
        samples = common_samples([whole, *(j.model for j in anew)])
        score = self.likelihood(rest, whole, samples)
        if anew and self.likelihood(rest, anew[0].model, samples) >= score:
            return anew[0]
        return self.scored(rest, whole, tried, samples)
