"""Parameters of the full model: the effect and track of each entry of a parameter vector."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.effects.base import Effect
from sysid.effects.catalogue import CHANGED

SHIFT, WIDE_SHIFT = 1e-5, 0.03
"""Shift of a parameter for its slope, in units of its typical size; the second for effects with
which runs change by jumps: wide enough to hold some of them."""

NO_LIMIT = 100.0
"""A null value beyond this stands for no limit at all."""


@dataclass(frozen=True)
class ModelParameter:
    """One number of the full model.

    Attributes:
        owner: ``core`` or an effect's id.
        name: parameter name.
        track: index of the track, or -1 when all share it.
        null: value at which it does nothing (for the core: its place is taken by the base).
        lower, upper: bounds in physical units.
        scale: typical size, for the solver.
        stepwise: whether runs change with it by jumps.
        rough: whether it belongs to an effect that has such a parameter.
        kinks, jumps: whether the run has a kink, or jumps, where a sample passes it.
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
    kinks: bool = False
    jumps: bool = False
    edge: int = 0

    @property
    def without_gradient(self) -> bool:
        """Whether gradients give no standard error of it."""
        return self.kinks or self.stepwise or self.jumps

    @property
    def shift(self) -> float:
        """By how much it is moved for a slope."""
        return (WIDE_SHIFT if self.rough else SHIFT) * self.scale


class ParameterTable:
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
        self.parameters = tuple(self._list())
        self.index = {(s.owner, s.name, s.track): k for k, s in enumerate(self.parameters)}

    def _list(self) -> list[ModelParameter]:
        listed = []
        for i in range(self.tracks):
            v = float(self.speed[i])
            listed.append(ModelParameter("core", "gain", i, v, -1e3 * v, 1e3 * v, v))
            listed += [
                ModelParameter("core", f"f{k + 1}", i, 0.0, -10.0, 10.0, 0.1)
                for k in range(self.order)
            ]
            listed += [
                ModelParameter("core", f"b{k + 1}", i, 0.0, -100.0, 100.0, 0.1)
                for k in range(1, self.order)
            ]
        for e in self.effects:
            for i in (-1,) if e.shared else range(self.tracks):
                rough = any(p.stepwise for p in e.parameters)
                listed += [self._effect_parameter(e.id, p, i, rough) for p in e.parameters]
        return listed

    def _effect_parameter(self, id: str, p: Any, track: int, rough: bool) -> ModelParameter:
        v = float(np.mean(self.speed) if track < 0 else self.speed[track])
        factor = {"drive": 1.0, "speed": v, "dt": self.dt, "one": 1.0}[p.scaled_by]
        if p.unit == "1/speed":
            factor = 1.0 / v
        null = p.null * (v if p.scaled_by == "speed" and 0.0 < abs(p.null) < 1e3 else 1.0)
        size = max(abs(s) for s in p.starts) or 0.1
        bounds = (p.lower * factor, p.upper * factor)
        kind = (p.stepwise, rough, p.kinks, p.jumps, p.edge)
        return ModelParameter(id, p.name, track, null, *bounds, size * factor, *kind)

    @property
    def null(self) -> Array:
        """All parameters at their null values."""
        return np.array([s.null for s in self.parameters])

    def of(self, owner: str) -> tuple[int, ...]:
        """Slots of an effect or of the core, which is what a changed parameter changes."""
        owner = "core" if owner == CHANGED.id else owner
        return tuple(k for k, s in enumerate(self.parameters) if s.owner == owner)

    def joined(self, q: Array, free: Sequence[int]) -> bool:
        """Whether tracks feel each other's parameters: they share some, or an effect couples them.

        Args:
            q: all parameters, (parameters,).
            free: those that are moved.
        """
        return any(self.parameters[k].track < 0 for k in free) or self.coupled(q, free)

    def coupled(self, q: Array, free: Sequence[int]) -> bool:
        """Whether an effect that couples tracks acts, or may once the free parameters are moved."""
        return any(k in free or q[k] != self.parameters[k].null for k in self._coupling)

    @cached_property
    def _coupling(self) -> tuple[int, ...]:
        owners = {e.id for e in self.effects if e.couples}
        return tuple(k for k, s in enumerate(self.parameters) if s.owner in owners)

    def starts(self, e: Effect) -> list[dict[int, float]]:
        """Starting values of an effect on all tracks: parameter → value."""
        starts = []
        for k in range(max(len(p.starts) for p in e.parameters)):
            values = {}
            chosen = {p.name: p.starts[min(k, len(p.starts) - 1)] for p in e.parameters if p.choice}
            acting = {*chosen, *e.searched(chosen)}
            for i in (-1,) if e.shared else range(self.tracks):
                for p in e.parameters:
                    at = self.index[e.id, p.name, i]
                    if p.name not in acting:
                        values[at] = self.parameters[at].null
                        continue
                    share = p.starts[min(k, len(p.starts) - 1)]
                    size = max(abs(s) for s in p.starts) or 1.0
                    values[at] = share * self.parameters[at].scale / size
            starts.append(values)
        return starts

    def chosen(self, e: Effect, q: Array) -> dict[str, float]:
        """The choices of an effect in an item, those of the first track on which it acts."""
        names = [p.name for p in e.parameters if p.choice]
        for i in (-1,) if e.shared else range(self.tracks):
            at = [self.index[e.id, p.name, i] for p in e.parameters]
            if any(q[k] != self.parameters[k].null for k in at):
                return {n: float(q[self.index[e.id, n, i]]) for n in names}
        return {p.name: p.null for p in e.parameters if p.choice}
