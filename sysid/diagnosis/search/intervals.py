"""Likelihood intervals of parameters for which gradients give no standard error.

At the edge of a dead zone or a gap the error is a staircase in the parameter, and σ²(JᵀJ)⁻¹ is
meaningless. So the parameter is fixed at values around its estimate, all others are refitted, and
the interval holds the values with

    Σ_i n_i ln(V_i/V_i⁰) ≤ c

V_i the mean squared error of output i, n_i its effective samples. c is the 95 % point of χ² with
one degree of freedom or, where the run jumps, of a threshold (Hansen 2000, Econometrica 68, 575).
"""

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.policies import BUDGET
from sysid.diagnosis.search.batched_search import search
from sysid.diagnosis.search.ensemble_sampler import sample_ensemble
from sysid.diagnosis.search.evidence import effective_samples
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.full_model import NO_LIMIT
from sysid.diagnosis.search.selection import CandidateModel, Interval
from sysid.effects.catalogue import about
from sysid.fitting.profile import LEVEL, NORMAL, End

THRESHOLD = 7.35
"""95 % point of the likelihood ratio of a parameter at which the run jumps."""

FIRST = 2.0**-7
"""How far from its estimate a parameter is held first, in units of its typical size."""

TRIALS, GROWTH, CLOSE = 14, 2.0, 1.06
"""Values held on a side, the largest step from one to the next, and how well an end is then known:
the others follow larger steps too slowly, and an interval would end too early."""

FITTED = 4
"""Steps of the other parameters at every value held."""

LOWER = 0.5
"""A value held that raises the likelihood by more than this was the better estimate all along."""

REPEATS = 4
"""So many times at most the estimate moves to a better one; the walk around it begins anew."""

UNCERTAIN = 4.0
"""A parameter that slopes put fewer standard errors away from doing nothing is asked the
likelihood: where a run bends with the parameter, the two differ by such factors."""

BETWEEN_SAMPLES = 0.03
"""Standard error of a delay in samples that no log lowers: a board takes a command over at some
instant of its own period, and beside a further lag the mean over a sample stands for what acts in
it. Delays of 1.2 and 0.8 samples before a lag were found 0.03 and 0.06 of a sample too long."""

SAME_RUN = 1e-9
"""Runs that differ by less than this share of the speed do not depend on the parameter."""


def intervals_of(
    base: ForwardSelection, candidate: CandidateModel, uncertain: Sequence[int] = ()
) -> tuple[CandidateModel, dict[int, Interval]]:
    """Intervals of the parameters that effects free and slopes cannot judge, by parameter.

    Args:
        uncertain: parameters that are asked, too, although the run changes smoothly with them.

    Returns:
        (the candidate model, moved where a value held explains more than its own; intervals).
    """
    intervals: dict[int, Interval] = {}
    sampled: dict[int, Interval] = {}
    for left in reversed(range(REPEATS + 1)):
        parameters = _profiled(base, candidate, uncertain)
        if not parameters:
            return candidate, {}
        ragged = _ragged(base, parameters, candidate)
        walk = _Walk(base, candidate, [k for k in parameters if k not in ragged])
        if ragged and not sampled:  # once: walkers go far, wherever they begin
            sampled, best = sample_ensemble(base, candidate, ragged, walk.joined)
            walk.remember(best)
        found, better = walk.out(to_the_end=not left)
        intervals = sampled | found
        if better is None:
            break
        candidate = better
    return candidate, {k: _as_sampled(base, candidate, k, i) for k, i in intervals.items()}


def _as_sampled(
    base: ForwardSelection, candidate: CandidateModel, k: int, interval: Interval
) -> Interval:
    """An interval that holds its estimate, and what sampling leaves open of a delay."""
    value, late = float(candidate.q[k]), about(base.model.parameters[k].owner).hints.beyond_sampling
    by = NORMAL * BETWEEN_SAMPLES * base.model.dt if late else 0.0
    return interval.holding(value).widened(value, by)


def _ragged(
    base: ForwardSelection, parameters: Sequence[int], candidate: CandidateModel
) -> tuple[int, ...]:
    """Slots of a track with an effect whose likelihood no search descends: beside it none does."""
    model = base.model
    rough = {p.track for p in (model.parameters[k] for k in parameters) if p.rough}
    together = bool(rough) and (-1 in rough or model.joined(candidate.q, candidate.free))
    return tuple(k for k in parameters if together or model.parameters[k].track in rough)


def _profiled(
    base: ForwardSelection, candidate: CandidateModel, uncertain: Sequence[int]
) -> tuple[int, ...]:
    """Free parameters in which a run has jumps or kinks, and the uncertain ones."""
    every = base.model.parameters
    own = [k for k in candidate.free if every[k].owner in candidate.effects]
    return tuple(k for k in own if every[k].without_gradient or k in uncertain)


class _Walk:
    """Outwards from the estimate of every parameter, both ways at once.

    An item holds the parameters of one name on all tracks, where tracks do not feel each other.
    """

    def __init__(
        self, base: ForwardSelection, candidate: CandidateModel, parameters: Sequence[int]
    ) -> None:
        self.base, self.candidate, self.model = base, candidate, base.model
        self.tracks = range(self.model.tracks)
        self.samples = effective_samples(candidate.errors.estimation)
        self.cost = base.data.squared_error(self.model.run(candidate.q[None], base.data))[0]
        self.best = np.zeros(self.model.tracks)
        self.best_row = candidate.q.copy()
        self.moves = self._seen(parameters)
        self.joined = self.model.joined(candidate.q, candidate.free)
        names: dict[tuple[object, ...], list[int]] = {}
        for k in self.moves:
            s = self.model.parameters[k]
            names.setdefault((s.owner, s.name, k if self.joined else -1), []).append(k)
        self.unseen = [k for k in parameters if k not in self.moves]
        self.batch = [(tuple(group), side) for group in names.values() for side in (-1.0, 1.0)]

    def _change(self, row: Array) -> Array:
        """n ln(V/V⁰) of each track, (tracks,)."""
        cost = self.base.data.squared_error(self.model.run(row[None], self.base.data))[0]
        return self._changes(cost)

    def _changes(self, cost: Array) -> Array:
        return np.asarray(self.samples * np.log((cost + 1e-300) / (self.cost + 1e-300)))

    def _seen(self, parameters: Sequence[int]) -> list[int]:
        """Slots on which the run depends anywhere between their bounds and null values."""
        if not parameters:
            return []
        rows = np.repeat(self.candidate.q[None], 3 * len(parameters), axis=0)
        for j, k in enumerate(parameters):
            s = self.model.parameters[k]
            rows[3 * j : 3 * j + 3, k] = (s.lower, s.upper, s.null)
        data = self.base.data
        runs = self.model.run(rows, data) * (data.weight > 0.0)
        here = self.model.run(self.candidate.q, data)[0] * (data.weight > 0.0)
        size = np.max(np.abs(here)) + 1e-300
        apart = np.max(np.abs(np.nan_to_num(runs - here)), axis=(1, 2)).reshape(len(parameters), -1)
        return [k for k, a in zip(parameters, apart, strict=True) if np.max(a) > SAME_RUN * size]

    def _level(self, k: int) -> float:
        p = self.model.parameters[k]
        return THRESHOLD if p.of.jumps or p.of.stepwise else LEVEL

    def out(self, to_the_end: bool) -> tuple[dict[int, Interval], CandidateModel | None]:
        """Every parameter's interval, and a better estimate where one was met.

        Args:
            to_the_end: whether the walk goes on where a better estimate is met; else it ends there.
        """
        rows = [self.candidate.q.copy() for _ in self.batch]
        ends = [{k: self._beginning(k, side) for k in group} for group, side in self.batch]
        better = None
        for _ in range(TRIALS):
            open_ends = [
                {k: end for k, end in item_ends.items() if end.distance is not None}
                for item_ends in ends
            ]
            if not any(open_ends):
                break
            for i, known in self._tried(open_ends, rows).items():
                ends[i] |= known
            if not to_the_end and (better := self.better()) is not None:
                break
        better = better or self.better()
        unseen = {k: Interval(None, None, visited=False) for k in self.unseen}
        both: dict[int, dict[float, float | None]] = {k: {} for k in self.moves}
        for (_, side), item_ends in zip(self.batch, ends, strict=True):
            for k, end in item_ends.items():
                known = np.isfinite(end.outside)
                both[k][side] = float(self.candidate.q[k]) + side * end.outside if known else None
        return unseen | {k: self._closed(k, v[-1.0], v[1.0]) for k, v in both.items()}, better

    def _beginning(self, k: int, side: float) -> End:
        s, value = self.model.parameters[k], float(self.candidate.q[k])
        room = s.upper - value if side > 0 else value - s.lower
        return End.beginning(FIRST * max(abs(value), s.scale), room, self._level(k), CLOSE, GROWTH)

    def _closed(self, k: int, low: float | None, high: float | None) -> Interval:
        """Open ends become the bounds; towards a null value at infinity they stay open."""
        s = self.model.parameters[k]
        low = low if low is not None or s.null < -NO_LIMIT else s.lower
        high = high if high is not None or s.null > NO_LIMIT else s.upper
        return Interval(low, high)

    def _tried(
        self, open_ends: Sequence[Mapping[int, End]], rows: list[Array]
    ) -> dict[int, dict[int, End]]:
        """Hold parameters where ends are asked for, fit the others; what the ends then know, by
        item.

        Args:
            open_ends: ends of each item.
            rows: the outermost fit of each item within its interval; moved outwards.
        """
        at = [i for i, own in enumerate(open_ends) if own]
        trials, free = [], []
        for i in at:
            group, side = self.batch[i]
            row = rows[i].copy()
            for k, end in open_ends[i].items():
                row[k] = self.candidate.q[k] + side * (end.distance or 0.0)
            trials.append(row)
            free.append(tuple(k for k in self.candidate.free if k not in group))
        fitted, cost = search(
            self.model, np.array(trials), free, self.base.data, FITTED, BUDGET.coarse
        )
        ratio = self._changes(cost)
        new_ends: dict[int, dict[int, End]] = {i: {} for i in at}
        for i, row, change in zip(at, fitted, ratio, strict=True):
            for k, end in open_ends[i].items():
                track = self.model.parameters[k].track
                whole = self.joined or track < 0
                rise = float(np.sum(change)) if whole else float(change[track])
                self._remember(row, change, None if whole else track)
                new_ends[i][k] = end.with_rise(rise)
                if rise <= end.level:
                    own = [
                        j for j, s in enumerate(self.model.parameters) if whole or s.track == track
                    ]
                    rows[i][own] = row[own]
        return new_ends

    def _remember(self, row: Array, change: Array, track: int | None) -> None:
        """Keep what explains more than the estimate."""
        if track is None:
            if np.sum(change) < np.sum(self.best):
                self.best, self.best_row = change.copy(), row.copy()
        elif change[track] < self.best[track]:
            moved = [j for j, s in enumerate(self.model.parameters) if s.track == track]
            self.best[track] = change[track]
            self.best_row[moved] = row[moved]

    def remember(self, row: Array) -> None:
        """Keep what explains more than the estimate, found elsewhere."""
        change = self._change(row)
        for track in [None] if self.joined else list(self.tracks):
            self._remember(row, change, track)

    def better(self) -> CandidateModel | None:
        """The candidate at a value that explains clearly more than its own, if there was one."""
        if np.sum(self.best) > -LOWER:
            return None
        better = self.base.fitted(self.candidate, self.best_row)
        return better if np.sum(self._change(better.q)) < -LOWER else None
