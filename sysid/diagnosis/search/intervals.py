"""Intervals of an effect's numbers by profile likelihood: slopes say nothing where a run jumps.

A dead zone's edge moves no sample until it passes a command; a gap's width moves the instant of a
shock. The error is then a staircase in the number, its slope is zero or anything, and σ²(JᵀJ)⁻¹
with it. So the number is held at values around its estimate, all others are fitted again, and the
interval holds the values with

    Σ_i n_i ln(V_i/V_i⁰) ≤ c

V_i the mean squared error of output i, n_i the samples that its coloured errors are worth. c is the
95 % point of the likelihood ratio: χ² with one degree of freedom, or, for numbers at which the run
itself jumps, that of a threshold (Hansen 2000, Econometrica 68, 575: 7.35).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.policies import BUDGET
from sysid.diagnosis.search.batched_search import refined, search
from sysid.diagnosis.search.evidence import effective_samples
from sysid.diagnosis.search.named_sets import Interval, Node
from sysid.diagnosis.search.naming import NamingSearch
from sysid.diagnosis.search.walkers import Drifted, drifted
from sysid.effects.catalogue import CHANGED, about, effect
from sysid.fitting.profile import LEVEL, NORMAL, End

THRESHOLD = 7.35
"""95 % point of the likelihood ratio of a number at which the run jumps."""

FIRST = 2.0**-7
"""How far from its estimate a number is held first, in units of its typical size."""

TRIALS, GROWTH, CLOSE = 14, 2.0, 1.06
"""Values held on a side, the largest step from one to the next, and how well an end is then known:
the others follow larger steps too slowly, and an interval would end too early."""

FITTED = 4
"""Steps of the other numbers at every value held."""

LOWER = 0.5
"""A value held that raises the likelihood by more than this was the better estimate all along."""

REPEATS = 2
"""So many times at most the estimate moves to a better one."""

ENDLESS = 100.0
"""A null value beyond this stands for no limit at all."""

DOUBTED = 4.0
"""A number that slopes put fewer standard errors away from doing nothing is asked the likelihood:
where a run bends with the number, the two differ by such factors."""

BETWEEN_SAMPLES = 0.03
"""Standard error of a delay in samples that no log lowers: a board takes a command over at some
instant of its own period, and beside a further lag the mean over a sample stands for what acts in
it. Delays of 1.2 and 0.8 samples before a lag were found 0.03 and 0.06 of a sample too long."""

SAME_RUN = 1e-9
"""Runs that differ by less than this share of the speed do not depend on the number."""


def intervals_of(
    base: NamingSearch, node: Node, doubted: Sequence[int] = ()
) -> tuple[Node, dict[int, Interval]]:
    """Intervals of the numbers that effects free and slopes cannot judge, by slot.

    Args:
        base: the search around the model.
        node: the model with its effects.
        doubted: slots that are asked, too, although the run changes smoothly with them.

    Returns:
        (the node, moved where a value held explains more than its own; intervals).
    """
    found: dict[int, Interval] = {}
    walked: Drifted | None = None
    for _ in range(REPEATS + 1):
        slots = _profiled(base, node, doubted)
        if not slots:
            return node, {}
        ragged = _ragged(base, slots, node)
        walk = _Walk(base, node, [k for k in slots if k not in ragged])
        if ragged and walked is None:  # once: walkers go far, wherever they begin
            walked = drifted(base, node, ragged, walk.joined)
            walk.remember(walked.best)
        found = ({} if walked is None else walked.intervals) | walk.intervals()
        better = walk.better()
        if better is None:
            break
        node = better
    return node, {k: _as_sampled(base, node, k, i) for k, i in found.items()}


def _as_sampled(base: NamingSearch, node: Node, k: int, interval: Interval) -> Interval:
    """An interval that holds its estimate, and what sampling leaves open of a delay."""
    value = float(node.q[k])
    held = interval.holding(value)
    if not about(base.model.slots[k].owner).beyond_sampling:
        return held
    return held.widened(value, NORMAL * BETWEEN_SAMPLES * base.model.dt)


def _ragged(base: NamingSearch, slots: Sequence[int], node: Node) -> tuple[int, ...]:
    """Slots of a track with an effect whose likelihood no search descends: beside it none does."""
    model = base.model
    rough = {
        model.slots[k].track
        for k in slots
        if any(p.stepwise for p in effect(model.slots[k].owner).parameters)
    }
    together = bool(rough) and (-1 in rough or model.joined(node.q, node.free))
    return tuple(k for k in slots if together or model.slots[k].track in rough)


def _profiled(base: NamingSearch, node: Node, doubted: Sequence[int]) -> tuple[int, ...]:
    """Free slots of numbers with which a run changes by jumps or kinks, and those doubted."""
    found = []
    for k in node.free:
        slot = base.model.slots[k]
        if slot.owner in node.effects and slot.owner != CHANGED.id:
            (p,) = (p for p in effect(slot.owner).parameters if p.name == slot.name)
            if p.kinks or p.stepwise or p.jumps or k in doubted:
                found.append(k)
    return tuple(found)


class _Walk:
    """Outwards from the estimate of every number, both ways at once.

    A lane holds the numbers of one name on all tracks, where tracks do not feel each other.
    """

    def __init__(self, base: NamingSearch, node: Node, slots: Sequence[int]) -> None:
        self.base, self.node, self.model = base, node, base.model
        self.tracks = range(self.model.tracks)
        self.samples = effective_samples(node.errors.estimation)
        self.cost = self._cost(node.q[None])[0]
        self.best = np.zeros(self.model.tracks)
        self.best_row = node.q.copy()
        self.moves = self._seen(slots)
        self.joined = self.model.joined(node.q, node.free)
        names: dict[tuple[object, ...], list[int]] = {}
        for k in self.moves:
            s = self.model.slots[k]
            names.setdefault((s.owner, s.name, k if self.joined else -1), []).append(k)
        self.unseen = [k for k in slots if k not in self.moves]
        self.lanes = [(tuple(group), side) for group in names.values() for side in (-1.0, 1.0)]

    def _cost(self, rows: Array) -> Array:
        data = self.base.data
        runs = self.model.run(rows, data)
        return np.asarray(np.sum((data.weight * (data.y - runs)) ** 2, axis=1))

    def _seen(self, slots: Sequence[int]) -> list[int]:
        """Slots on which the run depends anywhere between their bounds and null values."""
        if not slots:
            return []
        rows = []
        for k in slots:
            s = self.model.slots[k]
            for value in (s.lower, s.upper, s.null):
                row = self.node.q.copy()
                row[k] = value
                rows.append(row)
        data = self.base.data
        runs = self.model.run(np.array(rows), data) * (data.weight > 0.0)
        own = self.model.run(self.node.q, data)[0] * (data.weight > 0.0)
        size = np.max(np.abs(own)) + 1e-300
        apart = np.max(np.abs(np.nan_to_num(runs - own)), axis=(1, 2)).reshape(len(slots), -1)
        return [k for k, a in zip(slots, apart, strict=True) if np.max(a) > SAME_RUN * size]

    def _level(self, k: int) -> float:
        s = self.model.slots[k]
        (p,) = (p for p in effect(s.owner).parameters if p.name == s.name)
        return THRESHOLD if p.jumps or p.stepwise else LEVEL

    def intervals(self) -> dict[int, Interval]:
        """Every number's interval."""
        rows = [self.node.q.copy() for _ in self.lanes]
        ends = [{k: self._beginning(k, side) for k in group} for group, side in self.lanes]
        for _ in range(TRIALS):
            open_ends = [
                {k: end for k, end in mine.items() if end.distance is not None} for mine in ends
            ]
            if not any(open_ends):
                break
            for i, known in self._tried(open_ends, rows).items():
                ends[i] |= known
        found = {k: Interval(None, None, visited=False) for k in self.unseen}
        both: dict[int, dict[float, float | None]] = {k: {} for k in self.moves}
        for (_, side), mine in zip(self.lanes, ends, strict=True):
            for k, end in mine.items():
                known = np.isfinite(end.outside)
                both[k][side] = float(self.node.q[k]) + side * end.outside if known else None
        return found | {k: self._closed(k, v[-1.0], v[1.0]) for k, v in both.items()}

    def _beginning(self, k: int, side: float) -> End:
        s, value = self.model.slots[k], float(self.node.q[k])
        room = s.upper - value if side > 0 else value - s.lower
        return End.beginning(FIRST * max(abs(value), s.scale), room, self._level(k), CLOSE, GROWTH)

    def _closed(self, k: int, low: float | None, high: float | None) -> Interval:
        """Ends that nothing contradicts are the number's bounds; towards no limit they are open."""
        s = self.model.slots[k]
        low = low if low is not None or s.null < -ENDLESS else s.lower
        high = high if high is not None or s.null > ENDLESS else s.upper
        return Interval(low, high)

    def _tried(
        self, open_ends: Sequence[Mapping[int, End]], rows: list[Array]
    ) -> dict[int, dict[int, End]]:
        """Hold numbers where ends are asked for, fit the others; what the ends then know, by lane.

        Args:
            open_ends: ends of each lane.
            rows: the outermost fit of each lane within its interval; moved outwards.
        """
        at = [i for i, mine in enumerate(open_ends) if mine]
        held, free = [], []
        for i in at:
            group, side = self.lanes[i]
            row = rows[i].copy()
            for k, end in open_ends[i].items():
                row[k] = self.node.q[k] + side * (end.distance or 0.0)
            held.append(row)
            free.append(tuple(k for k in self.node.free if k not in group))
        fitted, cost = search(
            self.model, np.array(held), free, self.base.data, FITTED, BUDGET.coarse
        )
        ratio = self.samples * np.log((cost + 1e-300) / (self.cost + 1e-300))
        found: dict[int, dict[int, End]] = {i: {} for i in at}
        for i, row, change in zip(at, fitted, ratio, strict=True):
            for k, end in open_ends[i].items():
                track = self.model.slots[k].track
                whole = self.joined or track < 0
                rise = float(np.sum(change)) if whole else float(change[track])
                self._remember(row, change, None if whole else track)
                found[i][k] = end.with_rise(rise)
                if rise <= end.level:
                    mine = [j for j, s in enumerate(self.model.slots) if whole or s.track == track]
                    rows[i][mine] = row[mine]
        return found

    def _remember(self, row: Array, change: Array, track: int | None) -> None:
        """Keep what explains more than the estimate."""
        if track is None:
            if np.sum(change) < np.sum(self.best):
                self.best, self.best_row = change.copy(), row.copy()
        elif change[track] < self.best[track]:
            mine = [j for j, s in enumerate(self.model.slots) if s.track == track]
            self.best[track] = change[track]
            self.best_row[mine] = row[mine]

    def remember(self, row: Array) -> None:
        """Keep what explains more than the estimate, found elsewhere."""
        cost = self._cost(row[None])[0]
        change = self.samples * np.log((cost + 1e-300) / (self.cost + 1e-300))
        for track in [None] if self.joined else list(self.tracks):
            self._remember(row, change, track)

    def better(self) -> Node | None:
        """The node at a value that explains clearly more than its own, if there was one."""
        if np.sum(self.best) > -LOWER:
            return None
        q, cost = refined(
            self.model, self.best_row[None], [self.node.free], self.base.data, BUDGET.polish
        )
        if not np.sum(self.samples * np.log((cost[0] + 1e-300) / (self.cost + 1e-300))) < -LOWER:
            return None
        found = self.base.node(self.node.effects, q[0], self.node.free, self.node.touched)
        return replace(found, excluded=self.node.excluded)
