"""Effects visible in the samples themselves: quantised, repeated and lost measurements.

Quantisation: all measurements lie on a lattice whose step is larger than the noise.

Held telemetry: a sensor slower than the log, whose measurements repeat until the next one. Only
fresh ones count, at their own times.

Dropouts: measurements that jump to exactly zero and back, or that repeat exactly while the speed
changes. They are masked. Standstill, a reversal and a clipped sensor are no dropouts.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sysid.data.facts import LogFacts
from sysid.data.noise import white_noise
from sysid.data.record import Array, Record
from sysid.data.resolution import (
    AGREE,
    CLEARLY_AGREE,
    VISIBLE,
    blurred_step,
    last_digit,
    last_digits,
)
from sysid.effects.samples import DROPOUTS, HELD_TELEMETRY, QUANTISATION

Mask = NDArray[np.bool_]

COARSE = 1.2
"""A step matters when it is at least this many standard deviations of the measurements' noise."""

TOP = 0.98
"""Measurements beyond this share of the largest may be clipped."""

LONGEST = 8
"""Longest burst of lost measurements [samples]."""

MIN_BURSTS = 3
MIN_BURST_SHARE = 0.002
"""Fewer clear bursts than this, or than this share of the samples, are chance."""


@dataclass(frozen=True)
class Coarse:
    """Quantisation of one output: its step, in its unit."""

    output: str
    step: float

    @property
    def sentence(self) -> str:
        """What it is and how large."""
        return f"{self.output} is quantised in steps of {self.step:.4g}."


@dataclass(frozen=True)
class Lost:
    """Dropouts of one output: share of samples, bursts, and whether the last reading is held."""

    output: str
    share: float
    bursts: int
    holds: bool

    @property
    def sentence(self) -> str:
        """What it is, how much, and what was done."""
        how = "repeat the last one" if self.holds else "are exactly zero"
        return (
            f"{100 * self.share:.1f} % of the measurements of {self.output} {how} in {self.bursts} "
            "bursts while it moves on; they are excluded."
        )


@dataclass(frozen=True)
class Stale:
    """A sensor slower than the log: rows from reading to reading, phase, share that repeats."""

    output: str
    period: float
    seconds: float
    phase: int
    share: float

    @property
    def sentence(self) -> str:
        """What it is, how often, and what was done."""
        return (
            f"{self.output} is refreshed every {self.period:.3g} rows ({self.seconds:.3g} s, "
            f"mostly in row {self.phase + 1} of {round(self.period)}); {100 * self.share:.0f} % of "
            "the rows repeat the last measurement and are excluded."
        )


@dataclass(frozen=True, eq=False)
class SampleEffects:
    """What inspecting the samples found.

    Attributes:
        weights: 0 where a reading was lost or repeats the last one, 1 elsewhere, (N, ny) a record.
    """

    coarse: tuple[Coarse, ...]
    lost: tuple[Lost, ...]
    weights: tuple[Array, ...]
    stale: tuple[Stale, ...] = ()

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of the catalogue that were found."""
        seen = {QUANTISATION.id: self.coarse, HELD_TELEMETRY.id: self.stale, DROPOUTS.id: self.lost}
        return tuple(id for id, affected in seen.items() if affected)

    @property
    def hidden(self) -> int:
        """Number of measurements that the mask hides."""
        return int(sum(np.sum(w == 0.0) for w in self.weights))


def inspect_samples(data: Sequence[Record] | LogFacts) -> SampleEffects:
    """Quantisation and dropouts of every output, and the mask of lost measurements."""
    facts = LogFacts.of(data)
    records = facts.records
    weights = [np.ones(r.y.shape) for r in records]
    coarse, lost, stale = list[Coarse](), list[Lost](), list[Stale]()
    total = sum(len(r) for r in records)
    slow, few_ways = facts.refreshes, _on_few_ways(records)
    ends = np.cumsum([len(r) for r in records])[:-1]
    for i, name in enumerate(records[0].output_names):
        y, step, refresh = np.concatenate([r.y[:, i] for r in records]), facts.steps[i], slow[i]
        mask = np.zeros(total, dtype=bool)
        if refresh is not None:
            mask = ~np.concatenate(refresh.fresh)
            phase = refresh.phase(0, max(round(refresh.period), 1))
            seconds = refresh.period * records[0].dt
            stale.append(Stale(name, refresh.period, seconds, phase, refresh.repeated))
        for holds in (False, True) if refresh is None else ():
            late = partial(_latest, facts, name)
            asked = partial(_bursts, i=i, step=step, holds=holds, late=late)
            sure = np.concatenate([asked(r, strict=True) for r in records])
            if _count(sure) < max(MIN_BURSTS, MIN_BURST_SHARE * total):
                continue
            bursts = sure | np.concatenate([asked(r, strict=False) for r in records])
            lost.append(Lost(name, float(np.mean(bursts)), _count(bursts), holds))
            mask |= bursts
        for w, m in zip(weights, np.split(mask, ends), strict=True):
            w[m, i] = 0.0
        behind_noise = 0.0 if step else blurred_step(y[~mask], CLEARLY_AGREE if few_ways else AGREE)
        step = step or behind_noise
        if step > 0.0:
            pairs = zip(np.split(y, ends), np.split(~mask, ends), strict=True)
            noise = float(white_noise([part[fresh, None] for part, fresh in pairs])[0])
            size = float(np.quantile(np.abs(y[~mask]), 0.95)) or 1.0
            # what is gathered behind noise is no chance
            clear = behind_noise > 0.0 or step >= COARSE * max(noise, step / np.sqrt(12.0))
            if clear and step >= VISIBLE * size:
                coarse.append(Coarse(name, step))
    return SampleEffects(tuple(coarse), tuple(lost), tuple(weights), tuple(stale))


def _count(mask: Mask) -> int:
    """Bursts of a mask."""
    return int(np.sum(np.diff(mask.astype(int), prepend=0) == 1))


def with_steps_of(seen: SampleEffects, data: Sequence[Record] | LogFacts) -> SampleEffects:
    """What was seen in some logs, with the steps of its sensors that more logs show.

    A sensor is the same in all logs, and a command of few sizes shows its steps in none alone.
    """
    known = {c.output for c in seen.coarse}
    more = tuple(c for c in inspect_samples(data).coarse if c.output not in known)
    return replace(seen, coarse=(*seen.coarse, *more)) if more else seen


def inspect_rates(
    rates: Sequence[Record] | LogFacts, positions: Sequence[Record], step: int
) -> SampleEffects:
    """The same of rates of an output that integrates: what gets lost are its own measurements.

    A difference of two measurements repeats where these are coarse in the file, and a lost reading
    spoils two of them.

    Args:
        rates: central differences over ``step`` samples on either side.
    """
    read = inspect_samples(positions)
    thinned = [w[: len(w) // step * step : step] for w in read.weights]
    weights = tuple(w[2:] * w[:-2] for w in thinned)
    return replace(read, coarse=inspect_samples(rates).coarse, weights=weights)


def smallest_named(records: Sequence[Record]) -> dict[str, float | None]:
    """The smallest quantum (mean over the outputs) and share of dropouts that would be named."""
    total = sum(len(r) for r in records)
    sizes = np.quantile(np.abs(np.concatenate([r.y for r in records])), 0.95, axis=0)
    steps = np.maximum(COARSE * white_noise([r.y for r in records]), VISIBLE * sizes)
    share = max(MIN_BURSTS, MIN_BURST_SHARE * total) / max(total, 1)
    return {QUANTISATION.id: float(np.mean(steps)), DROPOUTS.id: float(share)}


def _on_few_ways(records: Sequence[Record]) -> bool:
    """Whether no command of any log is anything but zero or one size, either way.

    Such a command drives a motor along the same few ways, over and over: the measurements on them
    are the same few values, and some step suits them by chance.
    """
    if not records[0].nu:
        return False
    commands = [np.abs(c) for r in records for c in r.u.T]
    return all(len(np.unique(c[c > 0.0])) < 2 for c in commands)


def _latest(facts: LogFacts, output: str) -> int:
    """Samples beyond the first by which an output may respond late to the input it follows."""
    pairs = [d for d in facts.delays or () if d.output == output and d.delay is not None]
    return max((max(d.high, 1) - 1 for d in pairs), default=0)


def _bursts(
    record: Record, i: int, step: float, holds: bool, late: Callable[[], int], strict: bool
) -> Mask:
    """Samples of one output that were lost.

    Args:
        late: samples that a command may take beyond the first until it shows; asked only where a
            reading held while it may have moved, for the delays of a log take time.
        strict: only bursts that can hardly be anything else; else what is likely a lost reading
            once it is known that measurements do get lost.
    """
    y = record.y[:, i]
    lost = np.zeros(len(y), dtype=bool)
    if len(y) < 8:
        return lost
    ordinary = step > 0.0 or _repeats_by_chance(y)
    noise = max(float(white_noise([y[:, None]])[0]), 1e-9)
    size = float(np.quantile(np.abs(y), 0.95)) or 1.0
    least = max(8.0 * noise, 3.0 * step, (0.1 if holds else 0.25) * size)
    if holds and not ordinary and last_digit(y) < 0.1 * noise:
        least = 0.0  # noise this far above the last digit never repeats a reading
    elif not strict:
        least = max(4.0 * noise, 2.0 * step, 0.05 * size)
    again = np.diff(y, prepend=np.nan) == 0.0
    candidate = again & (y != 0.0) if holds else y == 0.0
    top = TOP * float(np.max(np.abs(y)))
    edges = np.flatnonzero(np.diff(candidate.astype(int), prepend=0, append=0))
    for k, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if k < 2 or stop >= len(y) or stop - k > LONGEST or abs(y[k]) >= top:
            continue
        before, after = float(y[k - 1]), float(y[stop])
        if not holds:
            lost[k:stop] = before * after > 0.0 and min(abs(before), abs(after)) > least
        elif abs(after - before) > least or not (strict or ordinary):
            lost[k:stop] = not ordinary or _moved_before(record, i, k, stop, late, least)
    return lost


def _repeats_by_chance(y: Array) -> bool:
    """Whether measurements repeat hardly more often than they change by one last digit either way.

    A clipped sensor repeats its largest value, and a lost one zero: neither is asked.
    """
    change = np.round(np.abs(np.diff(y)), 9)
    last = last_digits(y)
    asked = (np.abs(y[1:]) < TOP * np.max(np.abs(y))) & (y[1:] != 0.0)
    near = float(np.sum(asked & (change > 0.0) & (change < 1.5 * last))) / 2.0 if len(last) else 0.0
    return float(np.sum(asked & (change == 0.0))) <= 3.0 * near + 5.0


def _moved_before(
    record: Record, i: int, k: int, stop: int, late: Callable[[], int], least: float
) -> bool:
    """Whether the speed must have moved while it was read as constant from k to stop − 1.

    It was moving the same way before, or the command had changed early enough to show by then.
    """
    y, u = record.y[:, i], record.u[:, min(i, record.nu - 1)]
    jump = float(y[stop] - y[k - 1])
    moving = float(y[k - 1] - y[k - 2])
    if moving * jump > 0.0 and abs(moving) > 0.5 * least:
        return True
    dead = late()
    if k - 2 < dead:
        return False
    changed = float(np.max(np.abs(np.diff(u[stop - 2 - dead : stop]))))
    early = float(np.max(np.abs(np.diff(u[k - 2 - dead : stop - 1 - dead])), initial=0.0))
    return early > 0.1 * float(np.max(np.abs(u))) and changed < 0.2 * early
