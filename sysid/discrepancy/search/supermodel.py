"""The super-model: every effect of the catalogue in one compiled simulation.

Absent effects sit at their null values, so that trying a candidate means freeing a few numbers
and never compiling a new model. Many candidates, starts and shifted copies for slopes run side by
side (``batched_search.py`` searches over them).

What has no memory of its own is computed for a whole record at once; only the motion is stepped.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Record
from sysid.discrepancy.search.evidence import noise_floor
from sysid.discrepancy.search.runs import Runs
from sysid.effects.base import Effect
from sysid.effects.catalogue import CHANGED
from sysid.structures.augmented.chain import drive_before

LENGTHS = (512, 1024, 1536, 2048, 3072, 4096, 5120, 6144, 8192)
"""Records are padded to one of these (then to multiples of the last), so that one compilation
serves many logs."""

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

    @property
    def shift(self) -> float:
        """By how much it is moved for a slope."""
        return (WIDE_SHIFT if self.rough else SHIFT) * self.scale


@dataclass(frozen=True, eq=False)
class Data:
    """Records prepared for the super-model: stacked, each from its own start, then padded.

    Attributes:
        drive, y: commands in units of full drive and readings, (M, tracks).
        moving: 1 in records that begin in motion, 0 where the command begins with the record,
            (M, tracks).
        counted: angle integrated from the readings before each, (M, tracks).
        t: time since the start of the record, (M, 1).
        reset: 1 at a record's start, (M,).
        first: row of the record's start, (M,).
        weight: 0 where a sample does not count, (M, tracks).
        log: which of several logs a row belongs to, from 0, (M, 1).
        lengths: samples of each record.
        noise: noise of the readings (see ``noise_floor``), (tracks,).
    """

    drive: Array
    y: Array
    moving: Array
    counted: Array
    t: Array
    reset: Array
    first: NDArray[np.int64]
    weight: Array
    log: Array
    lengths: tuple[int, ...]
    noise: Array

    @cached_property
    def arrays(self) -> dict[str, Any]:
        """What the compiled functions take, handed over once."""
        from sysid.fitting.compiled import jax_module

        names = ("drive", "y", "moving", "counted", "t", "reset", "first", "log")
        return {name: jax_module().device_put(getattr(self, name)) for name in names}

    def split(self, whole: Array) -> tuple[Array, ...]:
        """Rows of each record of an array (M, …)."""
        ends = np.cumsum(self.lengths)
        return tuple(np.split(whole[: ends[-1]], ends[:-1]))


def padded_length(samples: int) -> int:
    """The length to which so many samples are padded."""
    for length in LENGTHS:
        if samples <= length:
            return length
    return -(-samples // LENGTHS[-1]) * LENGTHS[-1]


def prepare(
    records: Sequence[Record],
    scales: Array,
    delay: int,
    weights: Sequence[Array] | None = None,
    least: int = 0,
    logs: Sequence[int] | None = None,
) -> Data:
    """Stack records.

    Args:
        records: experiments.
        scales: full drive of each input.
        delay: whole samples of dead time.
        weights: weight of each sample of each record, (N, tracks).
        least: rows at least, so that two parts of the data share one compilation.
        logs: which of several logs each record belongs to; all to the first when None.
    """
    drive: list[Array] = []
    before: list[Array] = []
    for r in records:
        shift = max(delay - 1, 0)
        d = r.u / scales
        before.append(drive_before(d[0], r.y))
        drive.append(np.vstack([np.repeat(before[-1][None], shift, axis=0), d[: len(d) - shift]]))
    lengths = tuple(len(r) for r in records)
    begins = [np.where(b == d[0], 1.0, 0.0) for b, d in zip(before, drive, strict=True)]
    total = sum(lengths)
    first = np.concatenate(
        [np.full(n, at) for n, at in zip(lengths, _starts(lengths), strict=True)]
    )
    reset = np.zeros(total)
    reset[_starts(lengths)] = 1.0
    weight = [np.ones(r.y.shape) for r in records] if weights is None else list(weights)
    of = [0] * len(records) if logs is None else logs
    pad = max(padded_length(total), least) - total

    def stacked(parts: Sequence[Array]) -> Array:
        whole = np.concatenate(parts)
        return np.concatenate([whole, np.zeros((pad, *whole.shape[1:]))])

    return Data(
        stacked(drive),
        stacked([r.y for r in records]),
        stacked([np.repeat(b[None], n, axis=0) for b, n in zip(begins, lengths, strict=True)]),
        stacked([(np.cumsum(r.y, axis=0) - r.y) * r.dt for r in records]),
        stacked([r.dt * np.arange(len(r), dtype=np.float64)[:, None] for r in records]),
        np.concatenate([reset, np.zeros(pad)]),
        np.concatenate([first, np.full(pad, total - 1)]).astype(np.int64),
        stacked(weight),
        stacked([np.full((n, 1), float(k)) for n, k in zip(lengths, of, strict=True)]),
        lengths,
        noise_floor(records),
    )


def _starts(lengths: Sequence[int]) -> list[int]:
    return [0, *np.cumsum(lengths)[:-1].tolist()]


class SuperModel:
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
        return Slot(id, p.name, track, null, *bounds, size * factor, p.stepwise, rough)

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

    @cached_property
    def runs(self) -> Runs:
        return Runs(self)

    def run(self, q: Array, data: Data) -> Array:
        """Readings for parameter vectors q (lanes, slots), shape (lanes, M, tracks)."""
        return self.runs(np.atleast_2d(q), data)
