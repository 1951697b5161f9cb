"""One track's signals as the shapes take them: stacked over all records, with both parts' weights.

A term δT in the torque of the base moves its free run by G(q) δT, with G the base's core of static
gain one: for a first-order core τ ω̇ = T − ω that is (1 − p) q⁻¹/(1 − p q⁻¹). The speed in a term is
a simulated one, first the base's, then that of the last fit (pseudo-linear regression; Ljung 1999,
10.64): with measured speeds any slow disturbance would be predicted from itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.filtering import filtered_by_record
from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.search.candidates import CandidateSearch
from sysid.diagnosis.search.selection import CandidateModel

BLOCKS_OF_TIME, LEAST_BLOCK = 60, 8
"""Blocks of a log that terms of time are judged on, every third one; samples of each at least."""

A_MOVE = 0.1
"""Share of the command's range that a move of it takes at least."""

SETTLING = 0.3
"""Share of the longest record within which the slowest part of a core passes, as that of an output
that does not integrate does."""

SAME = 0.98
"""Columns of this correlation say the same."""

Mask = NDArray[np.bool_]


class Signal(NamedTuple):
    """What a log holds beside command and output of a track, (N,)."""

    name: str
    values: Array


@dataclass(frozen=True, eq=False)
class Track:
    """Signals of one track, (N,) over all records, one after the other.

    Attributes:
        starts: first row of each record, and N.
        drive: command in units of full drive; of several inputs of one output their sum, in units
            of the first.
        inputs: what ``drive`` is the sum of, or the own command and those of others, (N, m).
        channels: of ``inputs``.
        adds_inputs: whether all of them act on the output.
        measured, other_speed: measurements, gaps bridged; the other one None without a track.
        others: what else the log holds: commands as they were given, the other track's
            measurements.
        unused: columns that were chosen for nothing, but for those that say the same as the output.
        run, error: free run of the candidate model, and measured minus simulated.
        speed: the speed that terms depend on.
        t: time since the start of each log [s].
        angle: integrated from the measurements [rad].
        fitted, judged: rows that count in the estimation and in the held-out part.
        fitted_in_time, judged_in_time: the same for terms of time, which another log says nothing
            of: blocks of the estimation logs.
        gain, f, b: the core, B = b_1 q⁻¹ + …, F = 1 + f_1 q⁻¹ + …
        level: whether the base holds a constant load.
        scale: full drive in the record's unit.
        fixed: whether the base is given and stays as it is.
    """

    starts: tuple[int, ...]
    dt: float
    drive: Array
    inputs: Array
    channels: tuple[Channel, ...]
    adds_inputs: bool
    measured: Array
    other_speed: Array | None
    others: tuple[Signal, ...]
    unused: tuple[Signal, ...]
    run: Array
    speed: Array
    error: Array
    t: Array
    angle: Array
    fitted: Mask
    judged: Mask
    fitted_in_time: Mask
    judged_in_time: Mask
    gain: float
    f: Array
    b: Array
    level: bool
    fixed: bool
    command: Channel
    output: Channel
    scale: float

    def filtered(self, b: Array, a: Array, columns: Array) -> Array:
        """Columns (N,) or (N, k) through B/A, each record from rest, (N, k).

        See ``filtered_by_record``, which takes several filters, too.
        """
        return filtered_by_record(b, a, columns.reshape(len(columns), -1), self.starts)

    def through(self, torque: Array) -> Array:
        """What terms of the torque, (N,) or (N, k), do to the free run, (N, k)."""
        return self.filtered(np.append(0.0, self.b), np.append(1.0, self.f), torque)

    def past(self, signal: Array, k: int) -> Array:
        """A signal k samples earlier, held at each record's start, (N,)."""
        rows = np.arange(len(signal))
        return np.asarray(signal[np.maximum(rows - k, self.first)])

    @cached_property
    def first(self) -> NDArray[np.int64]:
        """First row of each row's record, (N,)."""
        return np.repeat(self.starts[:-1], np.diff(self.starts)).astype(np.int64)

    @cached_property
    def moves(self) -> int:
        """How often the command turns back by more than ``A_MOVE`` of its range, in the rows that
        terms of time are fitted to and judged on."""
        drive = self.drive[self.fitted_in_time | self.judged_in_time]
        changed = drive[np.flatnonzero(np.diff(drive, prepend=np.nan))]
        least = A_MOVE * float(np.ptp(drive))
        turns, way = 0, 0
        low = high = float(changed[0])
        for value in changed.tolist():
            low, high = min(low, value), max(high, value)
            if way >= 0 and value < high - least:
                turns, way, low = turns + 1, -1, value
            elif way <= 0 and value > low + least:
                turns, way, high = turns + 1, 1, value
        return turns

    @cached_property
    def pole(self) -> float:
        """The core's slowest pole, by size."""
        return min(self._slowest, 0.9999)

    @cached_property
    def bounded(self) -> bool:
        """Whether what acts on the core stays bounded: else no shape can be fitted through it."""
        return self._slowest <= 1.0

    @cached_property
    def settles(self) -> bool:
        """Whether the core's slowest part passes within the log: else it has no gain at rest."""
        longest = float(np.max(np.diff(self.starts)))
        return -float(np.log(self._slowest + 1e-300)) * SETTLING * longest > 1.0

    @cached_property
    def _slowest(self) -> float:
        return float(np.max(np.abs(np.roots(np.append(1.0, self.f))), initial=0.0))

    @cached_property
    def own(self) -> Array:
        """What changes of the core's own numbers do, (N, k): nothing for a given base."""
        if self.fixed:
            return np.empty((len(self.drive), 0))
        lags = range(len(self.f))
        acting = self.inputs.T if self.adds_inputs else [self.drive]
        inputs = [self.past(d, k) for d in acting for k in lags]
        outputs = [self.past(self.speed, k) for k in lags]
        columns = [*inputs, *outputs, *([np.ones_like(self.drive)] if self.level else [])]
        return self.through(np.column_stack(columns))

    @cached_property
    def unbalanced(self) -> Array:
        """ω − T, what makes the speed move by its lag, (N,); a constant load, its mean, is in T:
        were it left in, a slower lag would shift the level."""
        rest = self.speed - self.gain * self.drive
        return np.asarray(rest - rest[self.fitted_in_time].mean() if self.level else rest)

    @cached_property
    def full_speed(self) -> float:
        """Size of the fast measurements."""
        return float(max(np.quantile(np.abs(self.measured), 0.98), 1e-12))


def tracks_of(search: CandidateSearch, candidate: CandidateModel) -> tuple[Track, ...]:
    """Every track of a diagnosis around a candidate model; the given base has no free core."""
    blocks = search.holdout is search.estimation or search.holdout == search.estimation
    data = (search.data,) if blocks else (search.data, search.holdout_data)
    runs = [np.concatenate(search.simulated(candidate))]
    if not blocks:
        runs.append(np.concatenate(search.simulated(candidate, holdout=True)))
    counts = [sum(d.lengths) for d in data]
    whole = [d.y[:n] for d, n in zip(data, counts, strict=True)]
    lengths = [n for d in data for n in d.lengths]
    records = search.estimation if blocks else (*search.estimation, *search.holdout)
    beside = _beside(records, search.scales)
    y, run = np.concatenate(whole), np.concatenate(runs)
    drive = np.concatenate([d.drive[:n] for d, n in zip(data, counts, strict=True)])
    t = np.concatenate([d.t[:n, 0] for d, n in zip(data, counts, strict=True)])
    angle = np.concatenate([d.counted[:n] for d, n in zip(data, counts, strict=True)])
    fitted, judged, in_time = _parts(search, blocks, counts)
    model, first, tracks = search.model, search.estimation[0], []
    for i in range(model.tracks):
        gain, f, tail = model.core(candidate.q, i)
        channels, inputs = _inputs(search, candidate, drive, i)
        b = np.append(1.0 + np.sum(f) - np.sum(tail), tail)
        j = 1 - i if model.tracks == 2 else None
        there = fitted[:, i] | judged[:, i]
        starts = tuple(np.cumsum([0, *lengths]).tolist())
        speed = _bridged(y[:, i], there, starts)
        tracks.append(
            Track(
                starts,
                model.dt,
                inputs.sum(axis=1) if model.inputs > model.tracks else drive[:, i],
                inputs,
                channels,
                model.inputs > model.tracks,
                speed,
                None if j is None else _bridged(y[:, j], fitted[:, j] | judged[:, j], starts),
                (*beside[0], *([] if j is None else [Signal(first.outputs[j].name, y[:, j])])),
                tuple(c for c in beside[1] if not _same(c.values, speed)),
                run[:, i],
                run[:, i],
                np.where(there, y[:, i] - run[:, i], np.nan),
                t,
                angle[:, i],
                fitted[:, i],
                judged[:, i],
                there & in_time[0],
                there & in_time[1],
                gain,
                f,
                b,
                search.level,
                not search.core,
                first.inputs[min(i, first.nu - 1)],
                first.outputs[i],
                float(search.scales[min(i, first.nu - 1)]),
            )
        )
    return tuple(tracks)


def _inputs(
    search: CandidateSearch, candidate: CandidateModel, drive: Array, i: int
) -> tuple[tuple[Channel, ...], Array]:
    """Commands of a track, its own first; those that add up in units of the first."""
    model, channels = search.model, search.estimation[0].inputs
    order = [i, *(k for k in range(drive.shape[1]) if k != i)]
    inputs, gain = drive[:, order], candidate.q[model.index["core", "gain", i]]
    if model.inputs > model.tracks and gain:
        inputs = inputs * candidate.q[[model.index["core", "gain", k] for k in order]] / gain
    return tuple(channels[min(k, len(channels) - 1)] for k in order), inputs


def _beside(
    records: Sequence[Record], scales: Array
) -> tuple[tuple[Signal, ...], tuple[Signal, ...]]:
    """Commands as they were given, and the columns that all of some records hold unused."""
    u, first = np.concatenate([r.u / scales for r in records]), records[0]
    commands = tuple(Signal(c.name, u[:, k]) for k, c in enumerate(first.inputs))
    if any(r.unused is None or r.unused_names != first.unused_names for r in records):
        return commands, ()
    columns = np.concatenate([r.unused for r in records if r.unused is not None])
    return commands, tuple(
        Signal(name, columns[:, k])
        for k, name in enumerate(first.unused_names)
        if np.isfinite(columns[:, k]).all()
    )


def _same(a: Array, b: Array) -> bool:
    """Whether two signals say the same; one that does not move says nothing."""
    moves = np.ptp(a) > 0.0 and np.ptp(b) > 0.0
    return not moves or bool(abs(np.corrcoef(a, b)[0, 1]) > SAME)


def _parts(
    search: CandidateSearch, blocks: bool, counts: Sequence[int]
) -> tuple[Mask, Mask, tuple[Mask, Mask]]:
    """Rows of both parts, (N, tracks), and of both parts in time, (N,)."""
    fitted = search.data.weight[: counts[0]] > 0.0
    judged = search.holdout_data.weight[: counts[-1]] > 0.0
    if not blocks:
        nothing = np.zeros_like(fitted), np.zeros_like(judged)
        fitted = np.concatenate([fitted, nothing[1]])
        judged = np.concatenate([nothing[0], judged])
    # a change within a long block could be anywhere in it: time is judged on short ones
    held = np.zeros(len(fitted), dtype=bool)
    low = 0
    for n in search.data.lengths:
        block = np.arange(n) // max(n // BLOCKS_OF_TIME, LEAST_BLOCK)
        held[low : low + n] = block % 3 == 1
        low += n
    own = np.arange(len(fitted)) < counts[0]
    return fitted, judged, (own & ~held, own & held)


def _bridged(y: Array, there: Mask, starts: Sequence[int]) -> Array:
    """Measurements with straight lines where none counts, record by record."""
    bridged = y.copy()
    for low, high in pairwise(starts):
        rows = np.arange(low, high)
        known = rows[there[low:high]]
        if 0 < len(known) < len(rows):
            bridged[low:high] = np.interp(rows, known, y[known])
    return bridged
