"""Records as the full model takes them: stacked, aligned and padded."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.facts import LogFacts
from sysid.data.record import Array, Record
from sysid.structures.augmented.chain import drive_before

LENGTHS = (512, 1024, 1536, 2048, 3072, 4096, 5120, 6144, 8192)
"""Records are padded to one of these (then to multiples of the last), so that one compilation
serves many logs."""

OVERFLOW = 1e300
"""A cost beyond this is infinite: sums of several would overflow."""


@dataclass(frozen=True, eq=False)
class Data:
    """Records prepared for the full model: stacked, each from its own start, then padded.

    Attributes:
        drive, y: commands in units of full drive and measurements, (M, tracks).
        moving: 1 in records that begin in motion, 0 where the command begins with the record,
            (M, tracks).
        counted: angle integrated from the measurements before each, (M, tracks).
        t: time since the start of the record, or of what a piece was taken from, (M, 1).
        reset: 1 at a record's start, (M,).
        first: row of the record's start, (M,).
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

    def squared_error(self, runs: Array) -> Array:
        """Weighted squared error of runs (…, M, tracks), (…, tracks); infinite on overflow."""
        with np.errstate(over="ignore", invalid="ignore"):
            sums = np.sum((self.weight * (self.y - runs)) ** 2, axis=-2)
        return np.where(sums < OVERFLOW, sums, np.inf)

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
    data: Sequence[Record] | LogFacts,
    scales: Array,
    delay: int,
    weights: Sequence[Array] | None = None,
    least: int = 0,
    logs: Sequence[int] | None = None,
) -> Data:
    """Stack records.

    Args:
        delay: whole samples of dead time.
        weights: weight of each sample of each record, (N, tracks).
        least: rows at least, so that two parts of the data share one compilation.
        logs: which of several logs each record belongs to; all to the first when None.
    """
    facts = LogFacts.of(data)
    records = facts.records
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
    first = np.concatenate([np.full(n, k) for n, k in zip(lengths, _starts(lengths), strict=True)])
    reset = np.zeros(total)
    reset[_starts(lengths)] = 1.0
    weight = [np.ones(r.y.shape) for r in records] if weights is None else list(weights)
    of = [0] * len(records) if logs is None else logs
    pad = max(padded_length(total), least) - total

    since = [np.zeros(1 + r.ny) if r.since is None else r.since for r in records]

    def stacked(parts: Sequence[Array]) -> Array:
        whole = np.concatenate(parts)
        return np.concatenate([whole, np.zeros((pad, *whole.shape[1:]))])

    return Data(
        stacked(drive),
        stacked([r.y for r in records]),
        stacked([np.repeat(b[None], n, axis=0) for b, n in zip(begins, lengths, strict=True)]),
        stacked(
            [
                s[1:] + (np.cumsum(r.y, axis=0) - r.y) * r.dt
                for r, s in zip(records, since, strict=True)
            ]
        ),
        stacked(
            [
                s[0] + r.dt * np.arange(len(r), dtype=np.float64)[:, None]
                for r, s in zip(records, since, strict=True)
            ]
        ),
        np.concatenate([reset, np.zeros(pad)]),
        np.concatenate([first, np.full(pad, total - 1)]).astype(np.int64),
        stacked(weight),
        stacked([np.full((n, 1), float(k)) for n, k in zip(lengths, of, strict=True)]),
        lengths,
        facts.noise,
    )


def _starts(lengths: Sequence[int]) -> list[int]:
    return [0, *np.cumsum(lengths)[:-1].tolist()]


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
    order: dict[str, int] = {}
    names: list[str] = []
    log_of_record: list[list[int]] = []
    for part in (estimation, holdout):
        log_of_record.append([])
        for r in part:
            if r.sha256 not in order:
                order[r.sha256] = len(names)
                names.append(_unused(r.name.rpartition(PART)[0] or r.name, names))
            log_of_record[-1].append(order[r.sha256])
    return Logs(tuple(names), tuple(log_of_record[0]), tuple(log_of_record[1]))


def _unused(name: str, names: Sequence[str]) -> str:
    """The name, with a number behind it where another log has it."""
    same = sum(n.partition(" (")[0] == name for n in names)
    return f"{name} ({same + 1})" if same else name
