"""Records as the full model takes them: stacked and aligned; and the log of each."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.data.facts import LogFacts
from sysid.data.record import Array, Record
from sysid.diagnosis.policies import ENDLESS
from sysid.structures.augmented.chain import share_before
from sysid.structures.augmented.kernel import Signals


@dataclass(frozen=True, eq=False)
class Data:
    """Records prepared for the full model: stacked, each from its own start.

    Attributes:
        drive: commands in units of full drive, (M, tracks), or (M, inputs) of one track.
        y: measurements, (M, tracks).
        moving: share of its first drive under which a record begins (``share_before``),
            as ``drive``.
        counted: angle integrated from the measurements before each, (M, tracks).
        t: time since the start of the record, or of what a piece was taken from, (M, 1).
        reset: 1 at a record's start, (M,).
        weight: 0 where a sample does not count, (M, tracks).
        log: which of several logs a row belongs to, from 0, (M, 1).
        lengths: samples of each record.
        noise: noise of the measurements (see ``LogFacts``), (tracks,).
    """

    drive: Array
    y: Array
    moving: Array
    counted: Array
    t: Array
    reset: Array
    weight: Array
    log: Array
    lengths: tuple[int, ...]
    noise: Array

    @cached_property
    def signals(self) -> Signals:
        """What a kernel takes."""
        names = ("drive", "y", "moving", "counted", "t", "log", "reset")
        arrays = (np.ascontiguousarray(getattr(self, n), dtype=np.float64) for n in names)
        drive, y, moving, counted, *rest = arrays
        return Signals(drive, y, moving, counted, *(a.ravel() for a in rest))

    def squared_error(self, runs: Array) -> Array:
        """Weighted squared error of runs (…, M, tracks), (…, tracks); infinite for no end."""
        with np.errstate(over="ignore", invalid="ignore"):
            sums = np.sum((self.weight * (self.y - runs)) ** 2, axis=-2)
        return np.where(sums < ENDLESS, sums, np.inf)

    def split(self, whole: Array) -> tuple[Array, ...]:
        """Rows of each record of an array (M, …)."""
        return tuple(np.split(whole, np.cumsum(self.lengths)[:-1]))


def prepare(
    data: Sequence[Record] | LogFacts,
    scales: Array,
    delay: int,
    weights: Sequence[Array] | None = None,
    logs: Sequence[int] | None = None,
    later: Sequence[int] = (),
) -> Data:
    """Stack records.

    Args:
        delay: whole samples of dead time; 0 where the command of a row acted before its reading.
        weights: weight of each sample of each record, (N, tracks).
        logs: which of several logs each record belongs to; all to the first when None.
        later: samples by which each of several inputs acts later still.
    """
    facts = LogFacts.of(data)
    records = facts.records
    lengths = tuple(map(len, records))
    starts = np.cumsum([0, *lengths[:-1]])
    total = sum(lengths)
    drive: list[Array] = []
    moving: list[Array] = []
    for r in records:
        d = r.u / scales
        if r.nu == 1:  # all outputs have it
            d = np.repeat(d, r.ny, axis=1)
        share = share_before(d, r.y)
        rows = np.arange(len(d))[:, None] - (delay - 1) - np.array(later or 0)
        delayed = np.take_along_axis(d, np.broadcast_to(np.clip(rows, 0, len(d) - 1), d.shape), 0)
        drive.append(np.where(rows < 0, share * d[0], delayed))
        moving.append(np.broadcast_to(np.where(rows[0] < 0, 1.0, share), d.shape))
    since = [np.zeros(1 + r.ny) if r.since is None else r.since for r in records]
    counted = [(np.cumsum(r.y, axis=0) - r.y) * r.dt for r in records]
    t = [r.dt * np.arange(len(r), dtype=np.float64)[:, None] for r in records]
    of = [0] * len(records) if logs is None else logs
    reset = np.zeros(total)
    reset[starts] = 1.0

    def stacked(parts: Iterable[Array]) -> Array:
        return np.concatenate(list(parts))

    return Data(
        stacked(drive),
        stacked(r.y for r in records),
        stacked(moving),
        stacked(s[1:] + c for s, c in zip(since, counted, strict=True)),
        stacked(s[0] + clock for s, clock in zip(since, t, strict=True)),
        reset,
        stacked([np.ones(r.y.shape) for r in records] if weights is None else weights),
        stacked(np.full((n, 1), float(k)) for n, k in zip(lengths, of, strict=True)),
        lengths,
        facts.noise,
    )


PART = " part "
"""Between a file's name and the number of a stretch that was cut out of it."""


@dataclass(frozen=True)
class Logs:
    """The logs of a diagnosis.

    Attributes:
        estimation, holdout: the log that each record belongs to, from 0.
    """

    names: tuple[str, ...]
    estimation: tuple[int, ...]
    holdout: tuple[int, ...]

    @property
    def validation(self) -> tuple[int, ...]:
        """Validation logs."""
        return tuple(k for k in range(len(self.names)) if k not in self.estimation)


def logs_of(estimation: Sequence[Record], holdout: Sequence[Record]) -> Logs:
    """Records by log: stretches of one file are one log, whatever number of times it is named."""
    names: dict[str, str] = {}
    for r in (*estimation, *holdout):
        if r.sha256 not in names:
            names[r.sha256] = _unused(r.name.rpartition(PART)[0] or r.name, tuple(names.values()))
    order = list(names)
    parts = (tuple(order.index(r.sha256) for r in part) for part in (estimation, holdout))
    return Logs(tuple(names.values()), *parts)


def _unused(name: str, names: Sequence[str]) -> str:
    """The name, with a number behind it where another log has it."""
    same = sum(n.partition(" (")[0] == name for n in names)
    return f"{name} ({same + 1})" if same else name
