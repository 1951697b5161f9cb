"""The numbers of the super-model: which slot holds which parameter of which effect and track."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.effects.base import Effect
from sysid.effects.catalogue import CHANGED

SHIFT, WIDE_SHIFT = 1e-5, 0.03
"""Shift of a number for its slope, in units of its typical size; the second for effects with which
runs change by jumps: wide enough to hold some of them."""


@dataclass(frozen=True)
class Slot:
    """One number of the super-model.

    Attributes:
        owner: ``core`` or an effect's id.
        name: parameter name.
        track: index of the track, or -1 when all share it.
        null: value at which it does nothing (for the core: its place is taken by the base).
        lower, upper: bounds in physical units.
        scale: typical size, for the solver.
        stepwise: whether runs change with it by jumps.
        rough: whether it belongs to an effect that has such a number.
        jumps: whether the run itself jumps where a sample passes it.
        edge: +1 or −1 for an edge on the axis of the command, upward or downward.
    """

    owner: str
    name: str
    track: int
    null: float
    lower: float
    upper: float
    scale: float
    stepwise: bool = False
    rough: bool = False
    jumps: bool = False
    edge: int = 0

    @property
    def shift(self) -> float:
        """By how much it is moved for a slope."""
        return (WIDE_SHIFT if self.rough else SHIFT) * self.scale


class Numbers:
    """All effects around cores of one order, for a number of tracks.

    Args:
        effects: those of the chain, in its order.
        order: order of the core.
        tracks: number of tracks.
        speed: typical speed of each track, (tracks,).
        dt: sample time [s].
    """

    def __init__(
        self, effects: Sequence[Effect], order: int, tracks: int, speed: Array, dt: float
    ) -> None:
        self.effects, self.order, self.tracks = tuple(effects), order, tracks
        self.speed, self.dt = speed, dt
        self.slots = tuple(self._slots())
        self.place = {(s.owner, s.name, s.track): k for k, s in enumerate(self.slots)}

    def _slots(self) -> list[Slot]:
        found = []
        for i in range(self.tracks):
            v = float(self.speed[i])
            found.append(Slot("core", "gain", i, v, -1e3 * v, 1e3 * v, v))
            found += [
                Slot("core", f"f{k + 1}", i, 0.0, -10.0, 10.0, 0.1) for k in range(self.order)
            ]
            found += [
                Slot("core", f"b{k + 1}", i, 0.0, -100.0, 100.0, 0.1) for k in range(1, self.order)
            ]
        for e in self.effects:
            for i in (-1,) if e.shared else range(self.tracks):
                rough = any(p.stepwise for p in e.parameters)
                found += [self._effect_slot(e.id, p, i, rough) for p in e.parameters]
        return found

    def _effect_slot(self, id: str, p: Any, track: int, rough: bool) -> Slot:
        v = float(np.mean(self.speed) if track < 0 else self.speed[track])
        factor = {"drive": 1.0, "speed": v, "dt": self.dt, "one": 1.0}[p.scaled_by]
        if p.unit == "1/speed":
            factor = 1.0 / v
        null = p.null * (v if p.scaled_by == "speed" and 0.0 < abs(p.null) < 1e3 else 1.0)
        size = max(abs(s) for s in p.starts) or 0.1
        bounds = (p.lower * factor, p.upper * factor)
        kind = (p.stepwise, rough, p.jumps, p.edge)
        return Slot(id, p.name, track, null, *bounds, size * factor, *kind)

    @property
    def null(self) -> Array:
        """All slots at their null values."""
        return np.array([s.null for s in self.slots])

    def of(self, owner: str) -> tuple[int, ...]:
        """Slots of an effect or of the core, which is what a changed parameter changes."""
        owner = "core" if owner == CHANGED.id else owner
        return tuple(k for k, s in enumerate(self.slots) if s.owner == owner)

    def joined(self, q: Array, free: Sequence[int]) -> bool:
        """Whether tracks feel each other's numbers: they share some, or an effect couples them.

        Args:
            q: all slots, (slots,).
            free: those that are moved.
        """
        return any(self.slots[k].track < 0 for k in free) or self.coupled(q, free)

    def coupled(self, q: Array, free: Sequence[int]) -> bool:
        """Whether an effect that couples tracks acts, or may once the free slots are moved."""
        return any(k in free or q[k] != self.slots[k].null for k in self._coupling)

    @cached_property
    def _coupling(self) -> tuple[int, ...]:
        owners = {e.id for e in self.effects if e.couples}
        return tuple(k for k, s in enumerate(self.slots) if s.owner in owners)

    def starts(self, e: Effect) -> list[dict[int, float]]:
        """Starting values of an effect on all tracks: slot → value."""
        found = []
        for k in range(max(len(p.starts) for p in e.parameters)):
            values = {}
            chosen = {p.name: p.starts[min(k, len(p.starts) - 1)] for p in e.parameters if p.choice}
            acting = {*chosen, *e.searched(chosen)}
            for i in (-1,) if e.shared else range(self.tracks):
                for p in e.parameters:
                    at = self.place[e.id, p.name, i]
                    if p.name not in acting:
                        values[at] = self.slots[at].null
                        continue
                    share = p.starts[min(k, len(p.starts) - 1)]
                    size = max(abs(s) for s in p.starts) or 1.0
                    values[at] = share * self.slots[at].scale / size
            found.append(values)
        return found

    def chosen(self, e: Effect, q: Array) -> dict[str, float]:
        """The choices of an effect in a lane, those of the first track on which it acts."""
        names = [p.name for p in e.parameters if p.choice]
        for i in (-1,) if e.shared else range(self.tracks):
            at = [self.place[e.id, p.name, i] for p in e.parameters]
            if any(q[k] != self.slots[k].null for k in at):
                return {n: float(q[self.place[e.id, n, i]]) for n in names}
        return {p.name: p.null for p in e.parameters if p.choice}
