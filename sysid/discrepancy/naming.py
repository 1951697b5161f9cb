"""Naming: which effects of the catalogue are missing, found one at a time with proof."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.discrepancy.admission import admissible, tied
from sysid.discrepancy.batched_search import refined, search
from sysid.discrepancy.evidence import (
    PROVEN,
    Errors,
    Evidence,
    alike,
    compare_errors,
    effective_samples,
)
from sysid.discrepancy.named_sets import Judged, Named, Naming, Node
from sysid.discrepancy.starts import free_slots, repeats_at_top, starts_of
from sysid.discrepancy.supermodel import Data, Slot, SuperModel, prepare
from sysid.effects.base import Effect
from sysid.effects.catalogue import about

MOST_EFFECTS = 4
SHORTLIST = 9
FIRST_STEPS, MORE_STEPS, FULL_STEPS = 2, 4, 14
"""Steps of all starts, of the best start of each effect, of the shortlist."""

POLISH = 30
"""Steps of a model that is kept."""

COARSE = 1e-4
"""Gain of a step, as a share of the cost, at which candidates rest."""

BEAM = 2

FAR_AHEAD = 4.0
"""A rival is not grown when the leader's set scores so many times higher."""

LEADING = 4
"""Effects that lead so far are searched with most care where slopes say little."""

PROMISING = 0.95
"""A candidate is fitted in full when its first steps bring some track's cost below this share."""

PHASES = 24
"""Phases of a ripple that are tried on a record of its own."""

Progress = Callable[[str, float], None]
"""(what is being done, share of the work done)."""


class NamingSearch:
    """The search over sets of effects on one system.

    Args:
        model: super-model of the system.
        estimation, held: records.
        scales: full drive of each track's command.
        delay: dead time of the base in samples.
        level: whether a constant load belongs to the base.
        weights: weights of the samples of both parts, (N, tracks) a record; all 1 when None.
        needed: what the held-out error must fall below, as a share of before.
        fixed_core: whether the base is given and stays as it is.
    """

    def __init__(
        self,
        model: SuperModel,
        estimation: Sequence[Record],
        held: Sequence[Record],
        scales: Array,
        delay: int,
        level: bool = False,
        weights: tuple[Sequence[Array], Sequence[Array]] | None = None,
        needed: float = PROVEN,
        fixed_core: bool = False,
    ) -> None:
        self.model, self.level, self.needed = model, level, needed
        self.estimation, self.held = tuple(estimation), tuple(held)
        mine, theirs = weights if weights is not None else (None, None)
        self.data = prepare(self.estimation, scales, delay, mine)
        rows = len(self.data.drive)
        self.held_data = prepare(self.held, scales, delay, theirs, rows)
        owners = ("core", "load-bias") if level else ("core",)
        core = tuple(k for k, s in enumerate(model.slots) if s.owner in owners)
        self.core = () if fixed_core else core
        self.origin = model.null
        self.stepwise = {s.owner for s in model.slots if s.stepwise}

    def base(self, starts: Array) -> Node:
        """The base fitted from given values of all slots, (lanes, slots)."""
        q, cost = search(self.model, starts, [self.core] * len(starts), self.data, POLISH)
        return self.node((), self._best_tracks(q, cost), self.core)

    def _best_tracks(self, q: Array, cost: Array) -> Array:
        """Each track's numbers from the lane that fits it best (tracks do not feel each other)."""
        out = q[int(np.argmin(cost.sum(axis=1)))].copy()
        for i in range(self.model.tracks):
            best = int(np.argmin(cost[:, i]))
            for k, slot in enumerate(self.model.slots):
                if slot.track == i:
                    out[k] = q[best, k]
        return np.asarray(out)

    def node(
        self,
        effects: tuple[str, ...],
        q: Array,
        free: Sequence[int],
        touched: NDArray[np.bool_] | None = None,
    ) -> Node:
        """A node with its errors on both parts."""
        every = np.ones(self.model.tracks, dtype=bool)
        errors = Errors(
            self._errors(q, self.data),
            self._errors(self.in_phase(q, effects), self.held_data),
        )
        return Node(effects, q, tuple(free), errors, every if touched is None else touched)

    def _errors(self, q: Array, data: Data) -> tuple[Array, ...]:
        run = self.model.run(q, data)[0]
        return data.split(np.where(data.weight > 0.0, data.y - run, np.nan))

    def in_phase(self, q: Array, effects: Sequence[str]) -> Array:
        """The ripple's phase belongs to a record: turned to suit the held-out one."""
        if "speed-ripple" not in effects or self.held == self.estimation:
            return q
        rows = np.repeat(q[None], PHASES, axis=0)
        for j in range(PHASES):
            turn = 2.0 * np.pi * j / PHASES
            for i in range(self.model.tracks):
                a = self.model.place["speed-ripple", "cosine", i]
                b = self.model.place["speed-ripple", "sine", i]
                rows[j, a] = q[a] * np.cos(turn) - q[b] * np.sin(turn)
                rows[j, b] = q[a] * np.sin(turn) + q[b] * np.cos(turn)
        data = self.held_data
        runs = self.model.run(rows, data)
        cost = np.sum((data.weight * (data.y - runs)) ** 2, axis=1)
        return self._best_tracks(rows, np.nan_to_num(cost, nan=np.inf))

    def run(
        self,
        base: Node,
        effects: Sequence[Effect],
        progress: Progress | None = None,
        left: Callable[[Node], bool] | None = None,
    ) -> Naming:
        """Grow one effect at a time in a small beam while the rule accepts, then drop.

        Args:
            base: the model before.
            effects: those to try.
            progress: told what is being done.
            left: whether a model leaves anything to explain; growth ends where it does not.
        """
        say = progress or (lambda text, share: None)
        say("trying every effect", 0.0)
        self.origin = base.q
        judged = self.candidates(base, effects)
        first = tuple((j.id, j.score) for j in judged)
        passed = self._passing(judged)
        beam = (
            passed[:1] + [j for j in passed[1:] if j.id not in passed[0].node.excluded][: BEAM - 1]
        )
        if not beam:
            return Naming(base, base, (), self._minor(judged), first)
        minor = self._minor(judged)
        best, grown_minor = self._grown(base, beam[0].node, effects, say, left)
        minor = grown_minor if grown_minor is not None else minor
        for rival in beam[1:]:
            # the likeliest first effect may be a stand-in: try the next one where much is left
            ours, theirs = self._totals(base, (best, rival.node))
            if ours > FAR_AHEAD * theirs or not (left is None or left(best)):
                break
            say(f"starting from {rival.id} instead", 0.6)
            other, other_minor = self._grown(base, rival.node, effects, say, left)
            if self.best_of(base, (best, other)) is other:
                best, minor = other, other_minor if other_minor is not None else minor
        best = self._with_seen_clip(base, self.polished(best), judged)
        say("dropping and swapping", 0.85)
        best = self.pruned(base, best)
        named = self.account(base, best, effects, judged)
        while len(named) > 1 and not all(n.evidence.significant for n in named):
            # the effect that the others need least; what remains is fitted and judged again
            weakest = max(named, key=lambda n: n.evidence.delta_bic)
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
        left: Callable[[Node], bool] | None,
    ) -> tuple[Node, tuple[tuple[str, Evidence], ...] | None]:
        """A node with effects added one at a time; and what was minor when it grew no more."""
        minor, tidied = None, 1
        while len(node.effects) < MOST_EFFECTS and (left is None or left(node)):
            if len(node.effects) > tidied:
                tidied = len(node.effects)
                other = self._swapped(base, node, effects)
                if other is not node:
                    node = other
                    continue
            say(f"{', '.join(node.effects)}: looking for more", 0.2 * len(node.effects))
            judged = self.candidates(node, effects)
            minor = self._minor(judged)
            passed = self._passing(judged)
            if not passed or self.best_of(base, (node, passed[0].node)) is node:
                break
            node = passed[0].node
            if self.stepwise & set(node.effects[:-1]):  # held while the newest effect was tried
                node = replace(self.polished(node), excluded=node.excluded)
        return node, minor

    def _swapped(self, base: Node, node: Node, effects: Sequence[Effect]) -> Node:
        """Earlier effects exchanged for what is like them where a later one has shown them wrong.

        What could not be told from another at first may well be told beside a second effect.
        """
        for id in node.effects[:-1]:
            likely = [e for e in effects if id in e.ties or e.id in about(id).ties]
            likely = [e for e in likely if e.id not in node.effects]
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
        data, id = self.data, "sensor-saturation"
        clipped = [
            repeats_at_top(data.y[data.weight[:, i] > 0.0, i]) for i in range(self.model.tracks)
        ]
        seen = next((j for j in judged if j.id == id and j.evidence.accepted), None)
        if seen is None or not any(clipped):
            return best
        q = best.q.copy()
        for k in self.model.of(id):
            q[k] = seen.node.q[k]
        rest = tuple(e for e in best.effects if e != id)
        found, _ = refined(self.model, q[None], [best.free], data, POLISH)
        node = self.node((id, *rest), found[0], best.free)
        return self.best_of(base, (node, best))

    def polished(self, node: Node) -> Node:
        """The node fitted to the end."""
        q, _ = refined(self.model, node.q[None], [node.free], self.data, POLISH, unknown=(0,))
        return self.node(node.effects, q[0], node.free, node.touched)

    def _passing(self, judged: Sequence[Judged]) -> list[Judged]:
        """Accepted candidates, the most likely first; nearly equal ones by fewest numbers."""
        passed = [j for j in judged if j.evidence.accepted and self.admissible(j.node)]
        passed.sort(key=lambda j: -j.score)
        if not passed:
            return []
        top = passed[0]
        close = [
            j
            for j in passed
            if alike(top.node.errors, j.node.errors)
            or (j.id in about(top.id).ties and about(top.id).rare and tied(top.node, j.node))
        ]
        lead = min(
            close,
            key=lambda j: (len(j.node.free), about(j.id).shared, about(j.id).rare, -j.score),
        )
        ordered = [lead, *(j for j in passed if j is not lead)]
        return [self._with_excluded(j, passed) for j in ordered[:BEAM]] + ordered[BEAM:]

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
            and self.needed <= j.evidence.ratio < 0.98
            and self.admissible(j.node)
        )

    def candidates(
        self, node: Node, effects: Sequence[Effect], most: int = SHORTLIST
    ) -> list[Judged]:
        """Every effect added to a node, the most promising fitted in full, most likely first.

        All starts take a few steps, the best start of each effect some more, and only the effects
        that then lead are fitted to the end.
        """
        errors = np.nan_to_num(self.data.y - self.model.run(node.q, self.data)[0])
        now = np.sum((self.data.weight * errors) ** 2, axis=0)
        lanes: list[Array] = []
        owners: list[Effect] = []
        for e in effects:
            if e.id in (*node.effects, *node.excluded):
                continue
            if self.level and e.id in ("load-bias", "sensor-bias"):
                continue
            for row in starts_of(self.model, e, node.q, errors, self.data, not self.core):
                lanes.append(row)
                owners.append(e)
        q, cost = self._search(node, np.array(lanes), owners, FIRST_STEPS)
        core = [k for k, e in enumerate(owners) if e.id == "unsigned-speed"]
        if core:  # a whole core is found anew, from starts far apart
            q[core], cost[core] = self._search(node, q[core], [owners[k] for k in core], FULL_STEPS)
        tried = list({e.id: e for e in owners}.values())
        rows = [[k for k, e in enumerate(owners) if e.id == t.id] for t in tried]
        starts = [self._joined(q[r], cost[r], t) for r, t in zip(rows, tried, strict=True)]
        q, cost = self._search(node, np.array(starts), tried, MORE_STEPS)
        worth = [k for k in range(len(tried)) if np.any(cost[k] < PROMISING * now)]
        order = sorted(worth, key=lambda k: float(np.sum(np.log(cost[k] + 1e-300))))
        if not order:
            return []
        kept, at = order[:most], {t.id: k for k, t in enumerate(tried)}
        alike = [at[t] for k in kept[:2] for t in about(tried[k].id).ties if t in at]
        if not node.effects:
            alike += [k for k in worth if tried[k].id in self.stepwise]
        kept += [k for k in dict.fromkeys(alike) if k not in kept]
        chosen = [tried[k] for k in kept]
        far = range(LEADING if node.effects else len(kept))
        full, cost = self._search(node, q[kept], chosen, FULL_STEPS, far)
        full = self._from_ties(node, full, cost, chosen)
        nodes = [self._trimmed(node, e, full[k]) for k, e in enumerate(chosen)]
        samples = _common_samples(nodes)
        judged = [
            Judged(
                n,
                self.evidence(node, n, len(effects), samples),
                self._likelihood(node, n, samples),
            )
            for n in nodes
        ]
        return sorted(judged, key=lambda j: -j.score)

    def _search(
        self,
        node: Node,
        q: Array,
        owners: Sequence[Effect],
        steps: int,
        unknown: Sequence[int] = (),
    ) -> tuple[Array, Array]:
        every = range(self.model.tracks)
        free = [(*node.free, *free_slots(self.model, e, every)) for e in owners]
        if self.stepwise & set(node.effects):  # found already, and polished when kept
            free = [tuple(k for k in f if not self.model.slots[k].stepwise) for f in free]
        if steps < FULL_STEPS:
            return search(self.model, q, free, self.data, steps, COARSE)
        return refined(self.model, q, free, self.data, steps, COARSE, unknown)

    def _from_ties(self, node: Node, q: Array, cost: Array, chosen: Sequence[Effect]) -> Array:
        """Effects that are alike searched once more, each from where the other one ended.

        Else the one whose search was slower would look the worse explanation.
        """
        pairs = [
            (k, j)
            for k, a in enumerate(chosen)
            for j, b in enumerate(chosen)
            if k != j and (b.id in a.ties or a.id in b.ties)
        ]
        if not pairs:
            return q
        starts = []
        for k, j in pairs:
            row = q[j].copy()
            theirs = {(s.name, s.track): q[j, i] for i, s in self._slots_of(chosen[j])}
            for i, s in self._slots_of(chosen[k]):
                row[i] = float(np.clip(theirs.get((s.name, s.track), q[k, i]), s.lower, s.upper))
            for i, s in self._slots_of(chosen[j]):
                row[i] = s.null
            starts.append(row)
        again, costs = self._search(
            node, np.array(starts), [chosen[k] for k, _ in pairs], FULL_STEPS
        )
        out, least = q.copy(), cost.copy()
        for (k, _), row, c in zip(pairs, again, costs, strict=True):
            if c.sum() < least[k].sum():
                out[k], least[k] = row, c
        return out

    def _slots_of(self, e: Effect) -> list[tuple[int, Slot]]:
        return [(i, self.model.slots[i]) for i in self.model.of(e.id)]

    def _joined(self, q: Array, cost: Array, e: Effect) -> Array:
        """The best start; track by track where the effect is each track's own."""
        if e.shared or e.id == "cross-coupling":
            return np.asarray(q[int(np.argmin(cost.sum(axis=1)))])
        return self._best_tracks(q, cost)

    def _trimmed(self, before: Node, e: Effect, q: Array) -> Node:
        """The effect kept on the tracks that it serves; the others stay as they were."""
        free = (*before.free, *free_slots(self.model, e, range(self.model.tracks)))
        node = replace(self.node((*before.effects, e.id), q, free), excluded=before.excluded)
        if e.shared or self.model.tracks == 1:
            return node
        samples = effective_samples(node.errors.estimation)
        (v0, _), (v1, _) = before.errors.mean_squares(), node.errors.mean_squares()
        cost = len(free_slots(self.model, e, [0])) * np.log(samples)
        gain = samples * np.log((v0 + 1e-300) / (v1 + 1e-300))
        served = (gain > cost) & (v1 < 0.97 * v0)
        if served.all() or not served.any():
            return replace(node, touched=served if served.any() else node.touched)
        out = q.copy()
        for k, slot in enumerate(self.model.slots):
            if slot.track >= 0 and not served[slot.track]:
                out[k] = before.q[k]
        free = (*before.free, *free_slots(self.model, e, np.flatnonzero(served).tolist()))
        if "cross-coupling" in (*before.effects, e.id):  # what one track loses, the other feels
            rows, _ = refined(self.model, out[None], [free], self.data, POLISH)
            out = rows[0]
        found = self.node((*before.effects, e.id), out, free, served)
        return replace(found, excluded=before.excluded)

    def _likelihood(self, before: Node, after: Node, samples: Array) -> float:
        """Penalised likelihood ratio over both parts, in units of BIC; positive is better."""
        (v0, h0), (v1, h1) = before.errors.mean_squares(), after.errors.mean_squares()
        n = sum(int(np.isfinite(e).any(axis=1).sum()) for e in before.errors.estimation)
        m = sum(int(np.isfinite(e).any(axis=1).sum()) for e in before.errors.held)
        gain = np.log((v0 + 1e-300) / (v1 + 1e-300)) + m / max(n, 1) * np.log(
            (h0 + 1e-300) / (h1 + 1e-300)
        )
        added = len(after.free) - len(before.free)
        return float(np.sum(samples * gain) - added * np.log(np.sum(samples)))

    def best_of(self, base: Node, nodes: Sequence[Node]) -> Node:
        """The likeliest of several sets against the base; the first of equals."""
        scores = self._totals(base, nodes)
        return nodes[int(np.argmax(scores))]

    def _totals(self, base: Node, nodes: Sequence[Node]) -> list[float]:
        """Scores of whole sets against the base, with one effective sample size for all."""
        samples = _common_samples(nodes)
        return [self._likelihood(base, n, samples) for n in nodes]

    def evidence(
        self, before: Node, after: Node, tried: int, samples: Array | None = None
    ) -> Evidence:
        """Evidence for the effects that ``after`` adds."""
        if samples is None:
            samples = effective_samples(after.errors.estimation)
        return compare_errors(
            before.errors,
            after.errors,
            len(after.free) - len(before.free),
            tried,
            after.touched,
            samples,
            self.needed,
        )

    def admissible(self, node: Node) -> bool:
        """Whether the newest effect's numbers are physical (see ``admission``)."""
        return admissible(self.model, self.origin, node)

    def without(self, node: Node, id: str) -> Node:
        """The node without one of its effects, fitted again."""
        q = node.q.copy()
        mine = self.model.of(id)
        for k in mine:
            q[k] = self.origin[k]
        free = tuple(k for k in node.free if k not in mine)
        rest = tuple(i for i in node.effects if i != id)
        found, _ = refined(self.model, q[None], [free], self.data, POLISH)
        return self.node(rest, found[0], free)

    def pruned(self, base: Node, node: Node) -> Node:
        """Drop effects that the others have made needless."""
        while len(node.effects) > 1:
            rests = [self.without(node, id) for id in node.effects]
            best = self.best_of(base, rests)
            evidence = self.evidence(best, node, 1)
            if evidence.significant and evidence.ratio < 0.97:
                break
            node = best
        return node

    def account(
        self, base: Node, node: Node, effects: Sequence[Effect], first: Sequence[Judged]
    ) -> tuple[Named, ...]:
        """Each accepted effect against the model without it, and what ties with it there."""
        named = []
        for id in node.effects:
            if len(node.effects) == 1:
                judged: Sequence[Judged] = first
            else:
                likely = (id, *about(id).ties, *(j.id for j in first[:4]))
                others = [
                    e
                    for e in effects
                    if e.id == id or (e.id in likely and e.id not in node.effects)
                ]
                judged = self.candidates(self.without(node, id), others, most=4)
            mine = next((j for j in judged if j.id == id), None)
            if mine is None:
                continue
            ties = tuple(
                j.id
                for j in judged
                if j.id != id
                and j.evidence.accepted
                and self.admissible(j.node)
                and tied(mine.node, j.node)
            )
            rivals = {j.id: j.node for j in judged if j.id in (id, *ties)}
            named.append(Named(id, mine.evidence, ties, mine.node.touched, rivals))
        return tuple(named)


def _common_samples(nodes: Sequence[Node]) -> Array:
    """Effective sample size of the node that leaves the least, (tracks,)."""
    least = min(nodes, key=lambda n: float(np.sum(np.log(sum(n.errors.mean_squares()) + 1e-300))))
    return effective_samples(least.errors.estimation)
