"""Naming: which effects of the catalogue are missing, found one at a time with proof."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array, Record
from sysid.discrepancy.evidence import Evidence, compare_errors
from sysid.discrepancy.supermodel import COLUMNS, Data, SuperModel, prepare
from sysid.effects.base import Effect

MOST_EFFECTS = 4
SHORTLIST = 8
SCREEN_ITERATIONS = 5
FULL_ITERATIONS = 25
TIE = 1.03
"""Candidates whose held-out error is within this factor of the best may be ties."""

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Node:
    """A set of effects with its fitted super-model.

    Attributes:
        effects: ids in order of acceptance.
        q: all slots, (slots,).
        free: estimated slots.
        errors: free-run errors on the estimation records.
        held: free-run errors on the held-out records.
    """

    effects: tuple[str, ...]
    q: Array
    free: tuple[int, ...]
    errors: tuple[Array, ...]
    held: tuple[Array, ...]

    @property
    def held_rmse(self) -> float:
        """Held-out RMSE over all outputs."""
        return float(np.sqrt(np.mean(np.concatenate(self.held) ** 2)))


@dataclass(frozen=True, eq=False)
class Named:
    """An accepted effect: its evidence and what cannot be told from it."""

    id: str
    evidence: Evidence
    ties: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Naming:
    """Outcome of the search.

    Attributes:
        base: the model before.
        final: the model with all accepted effects.
        named: accepted effects in order.
        minor: effects that help a little but not enough to be proven, with their evidence.
        candidates: held-out gain of every effect at the first stage, best first.
    """

    base: Node
    final: Node
    named: tuple[Named, ...]
    minor: tuple[tuple[str, Evidence], ...]
    candidates: tuple[tuple[str, float], ...]


class NamingSearch:
    """The search over sets of effects on one system.

    Args:
        model: super-model of the system.
        estimation, held: records.
        scales: full drive of each track's command.
        delay: dead time of the base in samples.
        level: whether a constant load belongs to the base.
    """

    def __init__(
        self,
        model: SuperModel,
        estimation: Sequence[Record],
        held: Sequence[Record],
        scales: Array,
        delay: int,
        level: bool = False,
    ) -> None:
        self.model, self.level = model, level
        self.estimation, self.held = tuple(estimation), tuple(held)
        self.data = prepare(self.estimation, scales, delay)
        self.held_data = prepare(self.held, scales, delay)
        owners = ("core", "load-bias") if level else ("core",)
        self.core = tuple(k for k, s in enumerate(model.slots) if s.owner in owners)

    def base(self, starts: Array) -> Node:
        """The base fitted from given values of all slots, (lanes, slots)."""
        q, cost = self.model.search(
            starts, [self.core] * len(starts), self.data, iterations=FULL_ITERATIONS
        )
        return self.node((), q[int(np.argmin(cost))], self.core)

    def node(self, effects: tuple[str, ...], q: Array, free: Sequence[int]) -> Node:
        """A node with its errors on both parts."""
        return Node(
            effects,
            q,
            tuple(free),
            _errors(self.model, q, self.data, self.estimation),
            _errors(self.model, q, self.held_data, self.held),
        )

    def run(
        self, base: Node, effects: Sequence[Effect], progress: Progress | None = None
    ) -> Naming:
        """Grow one effect at a time while the rule accepts; then try to drop each."""
        current = base
        named: list[Named] = []
        minor: list[tuple[str, Evidence]] = []
        first: tuple[tuple[str, float], ...] = ()
        while len(named) < MOST_EFFECTS:
            if progress:
                progress(f"looking for effect {len(named) + 1}")
            ranked = self.candidates(current, effects)
            if not first:
                first = tuple((n.effects[-1], _gain(current, n)) for n in ranked)
            judged = [(n, self.evidence(current, n, len(effects))) for n in ranked]
            passed = [(n, e) for n, e in judged if e.accepted and self.admissible(n)]
            minor = [
                (n.effects[-1], e)
                for n, e in judged
                if e.delta_bic < -6.0 and 0.90 <= e.ratio < 0.98 and self.admissible(n)
            ]
            if not passed:
                break
            best, evidence = self.simplest(passed)
            ties = tuple(
                n.effects[-1]
                for n, _ in passed
                if n is not best and n.held_rmse <= TIE * best.held_rmse
            )
            named.append(Named(best.effects[-1], evidence, ties))
            current = best
        current, named = self.pruned(base, current, named)
        return Naming(base, current, tuple(named), tuple(minor), first)

    def candidates(self, node: Node, effects: Sequence[Effect]) -> list[Node]:
        """Every effect added to a node, the most promising fitted in full, best held-out first."""
        lanes, free, owners = [], [], []
        for e in effects:
            if e.id in node.effects or (self.level and e.id in ("load-bias", "sensor-bias")):
                continue
            for start in self.model.starts(e):
                q = node.q.copy()
                for slot, value in start.items():
                    q[slot] = value
                columns = (*node.free, *start)
                if len(columns) <= COLUMNS:
                    lanes.append(q)
                    free.append(columns)
                    owners.append(e.id)
        q, cost = self.model.search(np.array(lanes), free, self.data, iterations=SCREEN_ITERATIONS)
        order = np.argsort(cost)
        kept: list[int] = []
        for k in order:
            if owners[k] not in [owners[j] for j in kept] and len(kept) < SHORTLIST:
                kept.append(int(k))
        full, _ = self.model.search(
            q[kept], [free[k] for k in kept], self.data, iterations=FULL_ITERATIONS
        )
        nodes = [
            self.node((*node.effects, owners[k]), full[i], free[k]) for i, k in enumerate(kept)
        ]
        return sorted(nodes, key=lambda n: n.held_rmse)

    def evidence(self, before: Node, after: Node, tried: int) -> Evidence:
        """Evidence for the effect that ``after`` adds."""
        added = len(after.free) - len(before.free)
        return compare_errors(before.errors, after.errors, before.held, after.held, added, tried)

    def admissible(self, node: Node) -> bool:
        """Whether the newest effect's numbers are away from their null and from their bounds."""
        id = node.effects[-1]
        inside = []
        for k in node.free:
            slot = self.model.slots[k]
            if slot.owner == id:
                width = slot.upper - slot.lower
                value = node.q[k]
                on_bound = min(value - slot.lower, slot.upper - value) < 1e-3 * width
                inside.append(not on_bound and abs(value - slot.null) > 0.02 * slot.scale)
        if id == "input-delay":
            return any(
                node.q[k] > self.model.dt for k in node.free if self.model.slots[k].owner == id
            )
        return id == "unsigned-speed" or any(inside)

    def simplest(self, passed: Sequence[tuple[Node, Evidence]]) -> tuple[Node, Evidence]:
        """The best, unless one with fewer numbers does nearly as well."""
        best = min(n.held_rmse for n, _ in passed)
        close = [(n, e) for n, e in passed if n.held_rmse <= 1.01 * best]
        return min(close, key=lambda item: (len(item[0].free), item[0].held_rmse))

    def pruned(self, base: Node, node: Node, named: list[Named]) -> tuple[Node, list[Named]]:
        """Drop an earlier effect that the later ones have made needless."""
        for entry in list(named[:-1]):
            slots = [k for k in node.free if self.model.slots[k].owner == entry.id]
            q = node.q.copy()
            for k in slots:
                q[k] = self.model.slots[k].null
            free = tuple(k for k in node.free if k not in slots)
            found, _ = self.model.search(q[None], [free], self.data, iterations=FULL_ITERATIONS)
            rest = tuple(i for i in node.effects if i != entry.id)
            without = self.node(rest, found[0], free)
            if without.held_rmse <= 1.02 * node.held_rmse:
                node = without
                named = [n for n in named if n.id != entry.id]
        return replace(node), named


def _gain(before: Node, after: Node) -> float:
    return 1.0 - after.held_rmse / before.held_rmse


def _errors(
    model: SuperModel, q: Array, data: Data, records: Sequence[Record]
) -> tuple[Array, ...]:
    run = model.run(q, data)[0]
    found, at = [], 0
    for r in records:
        found.append(r.y - run[at : at + len(r)])
        at += len(r)
    return tuple(found)
