"""One more effect: every effect of the catalogue added to a set, fitted and scored."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sysid.data.facts import LogFacts
from sysid.data.record import Array, Record
from sysid.diagnosis.policies import BUDGET, ENDLESS, RULE
from sysid.diagnosis.search.admission import admissible, beyond_sampling, ended
from sysid.diagnosis.search.batched_search import best_tracks, search, slopes
from sysid.diagnosis.search.evidence import (
    Evidence,
    compare_errors,
    effective_samples,
    likelihood,
)
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.lags import exchanged, lags_of
from sysid.diagnosis.search.prepared import Data, logs_of, prepare
from sysid.diagnosis.search.refinement import between_levels, edges_of, refined
from sysid.diagnosis.search.screen import screened
from sysid.diagnosis.search.selection import CandidateModel, ScoredCandidate
from sysid.diagnosis.search.starts import free_indices, starts_of
from sysid.effects.base import Effect, StartsFrom, Wave
from sysid.effects.by_log import BY_LOG, parameter_of_log
from sysid.effects.catalogue import LEVEL, about
from sysid.fitting.holdout import Errors


class CandidateSearch:
    """The search for one more effect on one system.

    Args:
        level: whether a constant load belongs to the base.
        weights: weights of the samples of both parts, (N, tracks) a record; all 1 when None.
        needed: what the held-out error must fall below, as a share of before.
        fixed_core: whether the base is given and stays as it is.
        later: samples by which each of several inputs acts later than ``delay``.
    """

    def __init__(
        self,
        model: FullModel,
        estimation: Sequence[Record] | LogFacts,
        holdout: Sequence[Record] | LogFacts,
        scales: Array,
        delay: int,
        level: bool = False,
        weights: tuple[Sequence[Array], Sequence[Array]] | None = None,
        needed: float = RULE.held_out,
        fixed_core: bool = False,
        later: tuple[int, ...] = (),
    ) -> None:
        self.model, self.level, self.needed = model, level, needed
        self.scales, self.delay, self.later = scales, delay, later
        known, known_holdout = LogFacts.of(estimation), LogFacts.of(holdout)
        self.estimation, self.holdout = known.records, known_holdout.records
        fitted, judged = weights if weights is not None else (None, None)
        self.logs = logs_of(self.estimation, self.holdout)
        self.data = prepare(known, scales, delay, fitted, self.logs.estimation, later)
        self.holdout_data = prepare(known_holdout, scales, delay, judged, self.logs.holdout, later)
        owners = ("core", LEVEL.id) if level else ("core",)
        core = tuple(k for k, s in enumerate(model.parameters) if s.owner in owners)
        self.core = () if fixed_core else core
        self.origin = model.null
        self.stepwise = {s.owner for s in model.parameters if s.of.stepwise}

    def holding(self, id: str) -> Self:
        """The same search around a base that holds an effect."""
        search = copy(self)
        search.core = (*self.core, *self.model.of(id))
        return search

    def base(self, starts: Array) -> CandidateModel:
        """The base fitted from given values of all parameters, (batch, parameters)."""
        q, cost = search(self.model, starts, [self.core] * len(starts), self.data, BUDGET.polish)
        return self.evaluate((), best_tracks(self.model, q, cost), self.core)

    def evaluate(
        self,
        effects: tuple[str, ...],
        q: Array,
        free: Sequence[int],
        touched: NDArray[np.bool_] | None = None,
    ) -> CandidateModel:
        """A candidate model with its errors on both parts."""
        touched = np.ones(self.model.tracks, dtype=bool) if touched is None else touched
        if edges_of(self.model, free):
            q = between_levels(self.model, q, free, self.data, self.holdout_data)
        errors = Errors(
            self._errors(q, self.data), self._errors(self.in_phase(q, effects), self.holdout_data)
        )
        return CandidateModel(effects, q, tuple(free), errors, touched)

    def simulated(self, at: CandidateModel, holdout: bool = False) -> tuple[Array, ...]:
        """Free runs of a candidate model, (N, ny) a record of a part."""
        if holdout:
            q = self.in_phase(at.q, at.effects)
            return self.holdout_data.split(self.model.run(q, self.holdout_data)[0])
        return self.data.split(self.model.run(at.q, self.data)[0])

    def fitted(
        self, like: CandidateModel, q: Array | None = None, free: Sequence[int] | None = None
    ) -> CandidateModel:
        """A candidate model fitted to the end, from other values of all parameters if given."""
        q, free = like.q if q is None else q, like.free if free is None else free
        refit, _ = refined(self.model, q[None], [free], self.data, BUDGET.polish)
        return self.evaluate(like.effects, refit[0], free, like.touched)

    def slopes(self, at: CandidateModel, holdout: bool = False) -> tuple[Array, ...]:
        """∂ŷ/∂q over the free parameters of a candidate model, (N, ny, n) a record of a part."""
        data = self.holdout_data if holdout else self.data
        return data.split(slopes(self.model, at.q, at.free, data))

    def _errors(self, q: Array, data: Data) -> tuple[Array, ...]:
        """Errors of a run, NaN where a sample does not count, infinite where it has no end."""
        errors = data.y - self.model.run(q, data)[0]
        errors = np.where(np.abs(errors) < ENDLESS, errors, np.inf)
        return data.split(np.where(data.weight > 0.0, errors, np.nan))

    def in_phase(self, q: Array, effects: Sequence[str]) -> Array:
        """Parameters with the held-out logs' own values: the phase of a wave, gains and loads."""
        if self.holdout == self.estimation:
            return q
        own = [
            self.model.index[id, parameter_of_log(k), i]
            for id in BY_LOG
            for k in self.logs.validation
            for i in range(self.model.tracks)
            if id in effects
        ]
        if own:
            q = search(self.model, q[None], [own], self.holdout_data, BUDGET.more_steps)[0][0]
        for id in effects:
            waves = about(id).waves
            if waves:
                q = self._turned(q, id, waves)
        return q

    def _turned(self, q: Array, id: str, waves: Sequence[Wave]) -> Array:
        """The wave of an effect, one a law, in the phase of the held-out record."""
        rows = np.repeat(q[None], BUDGET.phases, axis=0)
        turn = 2.0 * np.pi * np.arange(BUDGET.phases) / BUDGET.phases
        for wave, i in product(waves, range(self.model.tracks)):
            a, b = (self.model.index[id, name, i] for name in (wave.cosine, wave.sine))
            rows[:, a] = q[a] * np.cos(turn) - q[b] * np.sin(turn)
            rows[:, b] = q[a] * np.sin(turn) + q[b] * np.cos(turn)
        runs = self.model.run(rows, self.holdout_data)
        return best_tracks(self.model, rows, self.holdout_data.squared_error(runs))

    def candidates(
        self, model: CandidateModel, effects: Sequence[Effect], most: int = BUDGET.shortlist
    ) -> list[ScoredCandidate]:
        """Every effect added to a candidate model, the most promising fitted in full, most likely
        first.

        All starts are screened without a fit; of the effects that then lead, the best start of each
        law takes some steps, and those that still lead are fitted to the end, of which each keeps
        one law.
        """
        errors = np.nan_to_num(self.data.y - self.model.run(model.q, self.data)[0])
        now = np.sum((self.data.weight * errors) ** 2, axis=0)
        batch: list[Array] = []
        owners: list[Effect] = []
        for e in effects:
            if e.id in model.effects or (self.level and e.hints.level):
                continue
            rows = starts_of(self.model, e, model.q, errors, self.data, not self.core)
            batch += rows
            owners += [e] * len(rows)
        if not batch:
            return []
        starts, tried = self._screened(model, np.array(batch), owners)
        q, cost = self._search(model, starts, tried, BUDGET.more_steps)
        laws = self._by_law(starts, tried)
        tried = [tried[rows[0]] for rows in laws]
        q = np.array([self._joined(q[r], cost[r], e) for r, e in zip(laws, tried, strict=True)])
        cost = self.data.squared_error(self.model.run(q, self.data))
        kept = self._shortlist(model, tried, cost, now, most)
        if not kept:
            return []
        chosen = [tried[k] for k in kept]
        far = range(BUDGET.leading if model.effects else len(kept))
        full, _ = self._search(model, q[kept], chosen, BUDGET.full_steps, far)
        models = [self._trimmed(model, e, full[k]) for k, e in enumerate(chosen)]
        samples = common_samples(models)
        judged = [self.scored(model, n, len(effects), samples) for n in models]
        return sorted(_simplest(judged), key=lambda j: -j.score)

    def _screened(
        self, model: CandidateModel, batch: Array, owners: Sequence[Effect]
    ) -> tuple[Array, list[Effect]]:
        """The best start of each law of the effects that the screen puts first, and the same with
        what the model estimates moved along.

        A core that is found anew is no small change: such starts are searched instead.
        """
        screen = screened(self.model, model.q, model.free, batch, self.data)
        cost = screen.cost
        anew = [k for k, e in enumerate(owners) if e.hints.starts_from is StartsFrom.SIGNS]
        if anew:
            batch[anew], cost[anew] = self._search(
                model, batch[anew], [owners[k] for k in anew], BUDGET.full_steps
            )
        least: dict[str, float] = {}
        for e, value in zip(owners, np.sum(np.log(cost + 1e-300), axis=1).tolist(), strict=True):
            least[e.id] = min(value, least.get(e.id, np.inf))
        leading = sorted(least, key=lambda id: least[id])[: BUDGET.screened]
        wanted = {*leading, *(t for id in leading[:2] for t in about(id).hints.ties)}
        wanted |= {owners[k].id for k in anew}
        lags = lags_of(self.model, model)
        starts: list[Array] = []
        tried: list[Effect] = []
        for rows in self._by_law(batch, owners):
            e = owners[rows[0]]
            of_law = np.min(np.sum(np.log(cost[rows] + 1e-300), axis=1))
            if e.id not in wanted or of_law > least[e.id] + self.model.tracks * np.log(BUDGET.law):
                continue
            ranked = (
                (cost, screen.at_start) if e.hints.starts_from is not StartsFrom.SIGNS else (cost,)
            )
            some = [self._joined(batch[rows], by[rows], e) for by in ranked]
            if len(ranked) > 1:
                some.append(self._along(model, some[1], screen.moved[rows], ranked[1][rows]))
                run = self.data.squared_error(self.model.run(np.array(some), self.data))
                some = [some[k] for k in np.argsort(run.sum(axis=1))[:2]]
            some += [exchanged(self.model, row, lags) for row in some[:1]] if lags else []
            starts += some
            tried += [e] * len(some)
        return np.array(starts), tried

    def _along(self, model: CandidateModel, q: Array, moved: Array, cost: Array) -> Array:
        """A start with what the model estimates moved as its screen says, track by track.

        Args:
            moved, cost: of the starts that ``q`` was put together from.
        """
        out = q.copy()
        for at, change in zip(model.free, moved.T, strict=True):
            p = self.model.parameters[at]
            of_track = cost.sum(axis=1) if p.track < 0 else cost[:, p.track]
            out[at] = p.within(q[at] + change[int(np.argmin(of_track))])
        return out

    def _by_law(self, batch: Array, owners: Sequence[Effect]) -> list[list[int]]:
        """Items by effect and law: one effect after the other, of each the simplest law first."""
        ways = [(e.id, self._law(e, row)) for e, row in zip(owners, batch, strict=True)]
        ids = list(dict.fromkeys(e.id for e in owners))
        groups = sorted(dict.fromkeys(ways), key=lambda w: (ids.index(w[0]), w[1]))
        return [[k for k, w in enumerate(ways) if w == way] for way in groups]

    def scored(
        self,
        rest: CandidateModel,
        model: CandidateModel,
        tried: int,
        samples: Array | None = None,
    ) -> ScoredCandidate:
        """A candidate against the model that it was tried on."""
        samples = common_samples([model]) if samples is None else samples
        evidence = self.evidence(rest, model, tried, samples)
        return ScoredCandidate(model, evidence, self.likelihood(rest, model, samples))

    def _shortlist(
        self, model: CandidateModel, tried: Sequence[Effect], cost: Array, now: Array, most: int
    ) -> list[int]:
        """Which of the effects that took their first steps are fitted in full, the likeliest first.

        Args:
            now: without them, (tracks,).
            most: effects at most, besides those that are alike.
        """
        promising = [k for k in range(len(tried)) if np.any(cost[k] < BUDGET.promising * now)]
        order = sorted(promising, key=lambda k: float(np.sum(np.log(cost[k] + 1e-300))))
        leading = list(dict.fromkeys(tried[k].id for k in order))
        alike = [t for id in leading[:2] for t in about(id).hints.ties]
        if not model.effects:
            alike += [tried[k].id for k in promising if tried[k].id in self.stepwise]
        wanted = (*leading[:most], *alike)
        sums = cost.sum(axis=1)
        least: dict[str, float] = {}
        for e, cost_sum in zip(tried, sums.tolist(), strict=True):
            least[e.id] = min(cost_sum, least.get(e.id, np.inf))
        kept = [
            k for k, e in enumerate(tried) if e.id in wanted and sums[k] <= BUDGET.law * least[e.id]
        ]
        return sorted(kept, key=lambda k: (wanted.index(tried[k].id), k))

    def _law(self, e: Effect, q: Array) -> int:
        """Which law of an effect an item has chosen; 0 where the effect has but one."""
        law = e.law(self.model.chosen(e, q))
        return 0 if law is None else e.laws.index(law)

    def _search(
        self,
        model: CandidateModel,
        q: Array,
        owners: Sequence[Effect],
        steps: int,
        unknown: Sequence[int] = (),
    ) -> tuple[Array, Array]:
        every = range(self.model.tracks)
        free = [
            (*model.free, *free_indices(self.model, e, row, every))
            for e, row in zip(owners, q, strict=True)
        ]
        if self.stepwise & set(model.effects):  # found already, and polished when kept
            free = [tuple(k for k in f if not self.model.parameters[k].of.stepwise) for f in free]
        if steps < BUDGET.full_steps:
            return search(self.model, q, free, self.data, steps, BUDGET.coarse)
        return refined(self.model, q, free, self.data, steps, BUDGET.coarse, unknown)

    def _joined(self, q: Array, cost: Array, e: Effect) -> Array:
        """The best start; track by track where the effect is each track's own."""
        if e.shared or e.couples:
            return np.asarray(q[int(np.argmin(cost.sum(axis=1)))])
        return best_tracks(self.model, q, cost)

    def _trimmed(self, before: CandidateModel, e: Effect, q: Array) -> CandidateModel:
        """The effect kept on the tracks that it serves; the others stay as they were."""
        free_on = partial(free_indices, self.model, e, q)
        effects = (*before.effects, e.id)
        free = (*before.free, *free_on(range(self.model.tracks)))
        if self.model.inputs > self.model.tracks:
            q, free = self._at_inputs(before, e, q, free)
        model = self.evaluate(effects, q, free)
        if e.shared or self.model.tracks == 1:
            return model
        samples = effective_samples(model.errors.estimation)
        (v0, _), (v1, _) = before.errors.mean_squares(), model.errors.mean_squares()
        cost = len(free_on([0])) * np.log(samples)
        gain = samples * np.log((v0 + 1e-300) / (v1 + 1e-300))
        served = (gain > cost) & (v1 < RULE.own_part * v0)
        if self.model.joined(q, before.free):
            served &= self._needed_itself(before, e, q, v1)
        served &= beyond_sampling(self.model, e.id, q)
        if not (served & (at_end := ended(self.model, e.id, model))).all():
            served &= ~at_end
        if served.all() or not served.any():
            return replace(model, touched=served if served.any() else model.touched)
        of_others = [
            k for k, p in enumerate(self.model.parameters) if p.track >= 0 and not served[p.track]
        ]
        out = q.copy()
        out[of_others] = before.q[of_others]
        free = (*before.free, *free_on(np.flatnonzero(served).tolist()))
        if self.model.coupled(out, free):  # what one track loses, the other feels
            return self.fitted(replace(model, touched=served), out, free)
        return self.evaluate(effects, out, free, served)

    def _at_inputs(
        self, before: CandidateModel, e: Effect, q: Array, free: tuple[int, ...]
    ) -> tuple[Array, tuple[int, ...]]:
        """The effect kept at those of several inputs of one output where the error needs it."""
        every = self.model.parameters
        for i in self.model.sides(e) if len(self.model.sides(e)) > 1 else ():
            rest = tuple(k for k in free if every[k].owner != e.id or every[k].side != i)
            if not any(every[k].owner == e.id for k in rest):
                break
            out = q.copy()
            own = [k for k in self.model.of(e.id) if every[k].side == i]
            out[own] = before.q[own]
            out = search(self.model, out[None], [rest], self.data, BUDGET.more_steps)[0][0]
            runs = self.model.run(np.array([q, out]), self.data)
            now, without = self.data.squared_error(runs).sum(axis=1)
            if not now < RULE.own_part * without:
                q, free = out, rest
        return q, free

    def _needed_itself(
        self, before: CandidateModel, e: Effect, q: Array, least: Array
    ) -> NDArray[np.bool_]:
        """Tracks whose error grows without the effect's parameters of their own, (tracks,).

        Tracks that feel each other may both have gained from the effect on one of them.
        """
        without = np.repeat(q[None], self.model.tracks, axis=0)
        for i, row in enumerate(without):
            own = [k for k in self.model.of(e.id) if self.model.parameters[k].track == i]
            row[own] = before.q[own]
        counts = np.maximum(np.sum(self.data.weight > 0.0, axis=0), 1)
        squares = self.data.squared_error(self.model.run(without, self.data)) / counts
        return np.asarray(least < RULE.own_part * np.diag(squares))

    def likelihood(self, before: CandidateModel, after: CandidateModel, samples: Array) -> float:
        """Penalised likelihood ratio over both parts, in units of BIC; positive is better."""
        added = len(after.free) - len(before.free)
        return likelihood(before.errors, after.errors, added, samples)

    def best_of(self, base: CandidateModel, models: Sequence[CandidateModel]) -> CandidateModel:
        """The likeliest of several sets against the base; the first of equals."""
        samples = common_samples(models)
        return models[int(np.argmax([self.likelihood(base, n, samples) for n in models]))]

    def evidence(
        self,
        before: CandidateModel,
        after: CandidateModel,
        tried: int,
        samples: Array | None = None,
    ) -> Evidence:
        """Evidence for the effects that ``after`` adds."""
        samples = effective_samples(after.errors.estimation) if samples is None else samples
        added, pair = len(after.free) - len(before.free), (before.errors, after.errors)
        return compare_errors(*pair, added, tried, after.touched, samples, self.needed)

    def admissible(self, model: CandidateModel) -> bool:
        """Whether the newest effect's parameters are physical (see ``admission``)."""
        return admissible(self.model, self.origin, model)

    def without(self, model: CandidateModel, id: str, track: int | None = None) -> CandidateModel:
        """The candidate model without one of its effects, or without it on one track, fitted
        again."""
        own = self.model.of(id)
        removed = [k for k in own if track in (None, self.model.parameters[k].track)]
        q = model.q.copy()
        q[removed] = self.origin[removed]
        rest = tuple(i for i in model.effects if i != id or track is not None)
        every = np.ones(self.model.tracks, dtype=bool)
        plain = replace(model, effects=rest, touched=every)
        return self.fitted(plain, q, tuple(k for k in model.free if k not in removed))


def _simplest(judged: Sequence[ScoredCandidate]) -> list[ScoredCandidate]:
    """One law of each effect: the first, or a later one that clearly pays for its parameters."""
    simplest: dict[str, ScoredCandidate] = {}
    for j in judged:
        now = simplest.get(j.id)
        if now is None or j.score > now.score - RULE.bic:
            simplest[j.id] = j
    return list(simplest.values())


def common_samples(models: Sequence[CandidateModel]) -> Array:
    """Effective sample size of the candidate model that leaves the least, (tracks,)."""
    least = min(models, key=lambda n: float(np.sum(np.log(sum(n.errors.mean_squares()) + 1e-300))))
    return effective_samples(least.errors.estimation)
