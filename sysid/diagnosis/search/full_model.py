"""The full model: every effect of the catalogue in one compiled simulation, and its parameters.

Absent effects sit at their null values and cost nothing, so that trying a candidate means freeing
a few parameters. Candidates, starts and shifted copies for slopes are shared among the cores.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.prepared import Data
from sysid.effects.base import Effect, EffectParameter, sides_of
from sysid.effects.catalogue import CHANGED
from sysid.runners.native import compiler
from sysid.structures.augmented.batch import Stepped
from sysid.structures.augmented.kernel import kernel

WORTH_A_THREAD = 20000
"""Samples to simulate from which a second thread saves more than it costs."""

SHIFT, WIDE_SHIFT = 1e-5, 0.03
"""Shift of a parameter for its slope, in units of its typical size; the second for effects with
which runs change by jumps: wide enough to hold some of them."""

NO_LIMIT = 100.0
"""A null value beyond this stands for no limit at all."""

FINEST = 1.0
"""The finest wave over an angle that is looked for [rad a sample, at typical speed]: six samples
a wave."""

_OF_CORE = EffectParameter("", "", 0.0, 0.0, 0.0, ())


@dataclass(frozen=True)
class ModelParameter:
    """One number of the full model.

    Attributes:
        owner: ``core`` or an effect's id.
        track: index of the track whose output it moves, or -1 when all share it.
        null: value at which it does nothing (for the core: its place is taken by the base).
        lower, upper: bounds in physical units.
        scale: typical size, for the solver.
        of: what the effect declares of it.
        rough: whether it belongs to an effect with a parameter on which runs depend by jumps.
        side: index of the input where several act on one output; else the track.
        usual: size against which it is as good as nothing, of an effect.
    """

    owner: str
    name: str
    track: int
    null: float
    lower: float
    upper: float
    scale: float
    of: EffectParameter = _OF_CORE
    rough: bool = False
    side: int = 0
    usual: float = 0.0

    @property
    def without_gradient(self) -> bool:
        """Whether gradients give no standard error of it."""
        return self.of.kinks or self.of.stepwise or self.of.jumps

    @property
    def shift(self) -> float:
        """By how much it is moved for a slope."""
        return (WIDE_SHIFT if self.rough else SHIFT) * self.scale

    def within(self, value: float) -> float:
        """A value within its bounds."""
        return float(np.clip(value, self.lower, self.upper))


class FullModel:
    """All effects around cores of one order, for a number of tracks.

    Args:
        speed: typical speed of each track, (tracks,).
        dt: sample time [s].
        inputs: number of inputs where it is not that of the tracks; else 0.
        lag: of servos, how far they typically are from their set points, (tracks,): what is small
            against that is as good as nothing, however far the servo travels.
    """

    def __init__(
        self,
        effects: Sequence[Effect],
        order: int,
        tracks: int,
        speed: Array,
        dt: float,
        inputs: int = 0,
        lag: Array | None = None,
    ) -> None:
        self.effects, self.order, self.tracks = tuple(effects), order, tracks
        self.lag = speed if lag is None else lag
        self.speed, self.dt, self.inputs = speed, dt, inputs or tracks
        self.parameters = (
            *(p for i in range(tracks) for p in self._of_core(i, float(speed[i]))),
            *(
                replace(self._of_core(0, float(speed[0]))[0], side=i)
                for i in range(tracks, self.inputs)
            ),
            *(
                self._of_effect(e, p, i)
                for e in effects
                for i in self.sides(e)
                for p in e.parameters
            ),
        )
        self.index = {(s.owner, s.name, s.side): k for k, s in enumerate(self.parameters)}
        run, width = kernel if compiler() else Stepped, max(self.inputs, tracks)
        self._null, self._kernel = self.null, run(self.effects, order, width, dt, tracks)
        sides = {e.id: self.sides(e) for e in self.effects} | {"core": range(tracks)}
        self._entries = np.array(
            [
                [self._at(owner, name, sides[owner], i) for i in range(width)]
                for owner, name in self._kernel.rows
            ],
            dtype=np.int64,
        )

    def _at(self, owner: str, name: str, sides: Sequence[int], i: int) -> int:
        """The entry of a row of the kernel on its track i."""
        side = i if (owner, name) == ("core", "gain") else sides[i % len(sides)]
        return self.index[owner, name, side]

    def _of_core(self, i: int, v: float) -> list[ModelParameter]:
        f = (
            ModelParameter("core", f"f{k}", i, 0.0, -10.0, 10.0, 0.1, side=i) for k in self._powers
        )
        b = (
            ModelParameter("core", f"b{k}", i, 0.0, -100.0, 100.0, 0.1, side=i)
            for k in self._powers[1:]
        )
        return [ModelParameter("core", "gain", i, v, -1e3 * v, 1e3 * v, v, side=i), *f, *b]

    @property
    def _powers(self) -> range:
        return range(1, self.order + 1)

    def _of_effect(self, e: Effect, p: EffectParameter, side: int) -> ModelParameter:
        track = min(side, self.tracks - 1)
        v = float(np.mean(self.speed) if track < 0 else self.speed[track])
        of_speed = {"speed": v, "speed/s": v, "1/speed": 1.0 / v}
        factor = of_speed.get(p.unit, self.dt if p.in_samples else 1.0)
        null = p.null * factor if p.unit in of_speed and abs(p.null) < 1e3 else p.null
        upper = max(p.upper, FINEST / (v * self.dt)) if p.as_seen else p.upper * factor
        bounds, rough = (p.lower * factor, upper), any(q.stepwise for q in e.parameters)
        lag = float(np.mean(self.lag / self.speed) if track < 0 else self.lag[track] / v)
        scale, smaller = p.size * factor, lag if p.unit == "speed" else 1.0
        return ModelParameter(
            e.id, p.name, track, null, *bounds, scale, p, rough, side, scale * smaller
        )

    def sides(self, e: Effect) -> Sequence[int]:
        """Tracks, or inputs, at which an effect has parameters; -1 where all share them."""
        return sides_of(e, self.inputs, self.tracks)

    @property
    def null(self) -> Array:
        """All parameters at their null values."""
        return np.array([s.null for s in self.parameters])

    def of(self, owner: str) -> tuple[int, ...]:
        """Slots of an effect or of the core, which is what a changed parameter changes."""
        owner = "core" if owner == CHANGED.id else owner
        return tuple(k for k, s in enumerate(self.parameters) if s.owner == owner)

    def core(self, q: Array, track: int) -> tuple[float, Array, Array]:
        """K, f_1 … f_n and b_2 … b_n of a track's core."""
        at = [k for k in self.of("core") if self.parameters[k].side == track]
        return float(q[at[0]]), q[at[1 : self.order + 1]], q[at[self.order + 1 :]]

    def time_constants(self, q: Array) -> Array:
        """The slowest time constant of each track's core [s], (tracks,)."""
        slowest = [np.abs(np.roots(np.append(1.0, self.core(q, i)[1]))) for i in range(self.tracks)]
        poles = np.array([np.max(p, initial=1e-300) for p in slowest])
        return np.asarray(self.dt / -np.log(np.clip(poles, 1e-300, 1.0 - 1e-9)))

    def set_core(
        self, q: Array, track: int, gain: float, f: Array, b: Array | Sequence[float] = ()
    ) -> None:
        """Put K, f_1 … and b_2 … of a track's core into ``q``; what is not given becomes zero."""
        at = [k for k in self.of("core") if self.parameters[k].side == track]
        q[at] = 0.0
        q[at[0]], q[at[1 : len(f) + 1]] = gain, f
        q[at[self.order + 1 : self.order + 1 + len(b)]] = b

    def joined(self, q: Array, free: Sequence[int]) -> bool:
        """Whether tracks feel each other's parameters: they share some, or an effect couples them.

        Args:
            q: all parameters, (parameters,).
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
            acting = e.searched({p.name: p.start(k) for p in e.parameters if p.choice})
            values = {}
            for i in self.sides(e):
                for p in e.parameters:
                    at = self.index[e.id, p.name, i]
                    s, tried = self.parameters[at], p.choice or p.name in acting
                    values[at] = p.start(k) * s.scale / p.size if tried else s.null
            starts += [values, *self._at_one_input(values)]
        return starts

    def _at_one_input(self, values: dict[int, float]) -> list[dict[int, float]]:
        """A start at each of several inputs of one output alone."""
        every = self.parameters
        sides = {every[k].side for k in values}
        if len(sides) <= self.tracks:
            return []
        return [
            {k: v if every[k].side == i else every[k].null for k, v in values.items()}
            for i in sorted(sides)
        ]

    def chosen(self, e: Effect, q: Array) -> dict[str, float]:
        """The choices of an effect in an item, those of the first track on which it acts."""
        names = [p.name for p in e.parameters if p.choice]
        for i in self.sides(e):
            at = [self.index[e.id, p.name, i] for p in e.parameters]
            if any(q[k] != self.parameters[k].null for k in at):
                return {n: float(q[self.index[e.id, n, i]]) for n in names}
        return {p.name: p.null for p in e.parameters if p.choice}

    def run(self, q: Array, data: Data) -> Array:
        """Measurements for parameter vectors q (batch, parameters), shape (batch, M, tracks)."""
        q = np.atleast_2d(q)
        parts = min(os.cpu_count() or 1, len(q), 1 + len(q) * len(data.y) // WORTH_A_THREAD)

        def one(rows: Array) -> Array:
            return self._kernel.run(rows, self._null, self._entries, data.signals)

        if parts == 1:
            return one(q)
        return np.concatenate(list(_threads().map(one, np.array_split(q, parts))))


@cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count())
