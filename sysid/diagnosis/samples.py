"""Effects visible in the samples themselves: quantised, repeated and lost measurements.

Quantisation: all measurements lie on a lattice whose step is larger than the noise.

Held telemetry: a sensor slower than the log, whose measurements repeat until the next one. Only
fresh ones count, at their own times.

Dropouts: measurements that jump to exactly zero and back, or that repeat exactly while the speed
changes. They are masked. Standstill, a reversal and a clipped sensor are no dropouts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.reading.stale import refreshes
from sysid.data.record import Array, Record
from sysid.effects.samples import DROPOUTS, HELD_TELEMETRY, QUANTISATION

Mask = NDArray[np.bool_]

ON_LATTICE = 0.98
"""Share of the measurements that must lie on the lattice."""

COARSE = 1.2
"""A step matters when it is at least this many standard deviations of the measurements' noise."""

VISIBLE = 0.015
"""… and at least this share of the largest reading (95 % quantile)."""

TOP = 0.98
"""Measurements beyond this share of the largest may be clipped."""

LONGEST = 8
"""Longest burst of lost measurements [samples]."""

MIN_REPEATED_VALUES = 10
"""Values that stand twice, of which a lattice can be told: by chance all of so many lie within a
twentieth of one of the thousands of steps that are tried once in a million times."""

RECURS, MIN_RECURRING_VALUES = 4, 4
"""Of fewer, a value that recurs in so many bursts is a step of a coarse sensor, where there are so
many of them."""

MAX_REPEATED_VALUES = 100
"""Such values that are compared with every step."""

MIN_CELLS, MAX_CELLS = 4.0, 1200.0
"""Steps within the largest of them: a finer one is as good as none."""

IN_CELL = 0.8
"""Mean cosine of the phases of values that lie on a lattice."""

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
        coarse: outputs with quantisation.
        lost: outputs with dropouts.
        weights: 0 where a reading was lost or repeats the last one, 1 elsewhere, (N, ny) a record.
        stale: outputs whose sensor is slower than the log.
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


def inspect_samples(records: Sequence[Record]) -> SampleEffects:
    """Quantisation and dropouts of every output, and the mask of lost measurements.

    Args:
        records: with the same channels.
    """
    weights = [np.ones(r.y.shape) for r in records]
    coarse: list[Coarse] = []
    lost: list[Lost] = []
    stale: list[Stale] = []
    total = sum(len(r) for r in records)
    slow, few_ways = refreshes(records), _on_few_ways(records)
    for i, name in enumerate(records[0].output_names):
        series = [r.y[:, i] for r in records]
        whole = np.concatenate(series)
        step = lattice(whole) or recurring_step(whole)
        masks = [np.zeros(len(y), dtype=bool) for y in series]
        refresh = slow[i]
        if refresh is not None:
            masks = [~fresh for fresh in refresh.fresh]
            phase = refresh.phase(0, max(round(refresh.period), 1))
            seconds = refresh.period * records[0].dt
            stale.append(Stale(name, refresh.period, seconds, phase, refresh.repeated))
        for holds in (False, True) if refresh is None else ():
            sure = [_bursts(r, i, step, holds, strict=True) for r in records]
            count = sum(int(np.sum(np.diff(m.astype(int), prepend=0) == 1)) for m in sure)
            if count < max(MIN_BURSTS, MIN_BURST_SHARE * total):
                continue
            bursts_of = [_bursts(r, i, step, holds, strict=False) for r in records]
            bursts_of = [a | b for a, b in zip(bursts_of, sure, strict=True)]
            bursts = sum(int(np.sum(np.diff(m.astype(int), prepend=0) == 1)) for m in bursts_of)
            share = sum(int(m.sum()) for m in bursts_of) / total
            lost.append(Lost(name, share, bursts, holds))
            masks = [a | b for a, b in zip(masks, bursts_of, strict=True)]
        for w, m in zip(weights, masks, strict=True):
            w[m, i] = 0.0
        kept = np.concatenate([y[~m] for y, m in zip(series, masks, strict=True)])
        agree = CLEARLY_AGREE if few_ways else AGREE
        behind_noise = 0.0 if step else blurred_step(kept, agree)
        step = step or behind_noise
        if step > 0.0:
            fresh_only = [y[~m] for y, m in zip(series, masks, strict=True)]
            noise = max(reading_noise(fresh_only), step / np.sqrt(12.0))
            size = float(np.quantile(np.abs(kept), 0.95)) or 1.0
            clear = behind_noise > 0.0 or step >= COARSE * noise  # gathered: no chance
            if clear and step >= VISIBLE * size:
                coarse.append(Coarse(name, step))
    return SampleEffects(tuple(coarse), tuple(lost), tuple(weights), tuple(stale))


def with_steps_of(seen: SampleEffects, records: Sequence[Record]) -> SampleEffects:
    """What was seen in some logs, with the steps of its sensors that more logs show.

    A sensor is the same in all logs, and a command of few sizes shows its steps in none alone.
    """
    known = {c.output for c in seen.coarse}
    more = tuple(c for c in inspect_samples(records).coarse if c.output not in known)
    return replace(seen, coarse=(*seen.coarse, *more)) if more else seen


def inspect_rates(rates: Sequence[Record], positions: Sequence[Record], step: int) -> SampleEffects:
    """The same of rates of an output that integrates: what gets lost are its own measurements.

    A difference of two measurements repeats where these are coarse in the file, and a lost reading
    spoils two of them.

    Args:
        rates: central differences over ``step`` samples on either side.
        positions: what they were made from.
        step: see ``rates``.
    """
    read = inspect_samples(positions)
    thinned = [w[: len(w) // step * step : step] for w in read.weights]
    weights = tuple(w[2:] * w[:-2] for w in thinned)
    return replace(read, coarse=inspect_samples(rates).coarse, weights=weights)


def smallest_named(records: Sequence[Record]) -> dict[str, float | None]:
    """The smallest quantum (mean over the outputs) and share of dropouts that would be named."""
    steps, total = [], sum(len(r) for r in records)
    for i in range(records[0].ny):
        series = [r.y[:, i] for r in records]
        size = float(np.quantile(np.abs(np.concatenate(series)), 0.95))
        steps.append(max(COARSE * reading_noise(series), VISIBLE * size))
    share = max(MIN_BURSTS, MIN_BURST_SHARE * total) / max(total, 1)
    return {QUANTISATION.id: float(np.mean(steps)), DROPOUTS.id: float(share)}


def reading_noise(series: Sequence[Array]) -> float:
    """Standard deviation of white reading noise, from third differences (median of |Δ³y|)."""
    third = np.concatenate([np.diff(y, n=3) for y in series if len(y) > 3] or [np.zeros(1)])
    return float(1.4826 * np.median(np.abs(third)) / np.sqrt(20.0))


def lattice(y: Array) -> float:
    """Step of the lattice on which the measurements lie; 0 when there is none.

    The step is the median distance of neighbouring distinct values; it is one only when nearly all
    measurements are whole multiples of it apart and the values are used over and over.
    """
    values, counts = np.unique(np.round(y[np.isfinite(y)], 9), return_counts=True)
    if len(values) < 4 or len(values) > 0.35 * counts.sum():
        return 0.0
    often = values[counts >= max(2.0, 0.1 * float(np.median(counts)))]
    if len(often) < 4:
        return 0.0
    # files carry a fixed number of digits: distances below a thousandth of the median are rounding
    gaps = np.diff(often)
    gaps = gaps[gaps > 1e-3 * float(np.median(gaps))]
    step = float(np.median(gaps))
    near = gaps[np.abs(gaps - step) < 0.2 * step]
    step = float(np.mean(near)) if len(near) else step
    whole = np.round((often - often[0]) / step)
    if whole[-1] > 0:
        step = float(np.polyfit(whole, often, 1)[0])
    offset = (y - often[0]) / step
    close = np.abs(offset - np.round(offset)) < 0.05
    return step if float(np.mean(close)) >= ON_LATTICE else 0.0


CELLS = 8
"""Steps within the largest reading, at least: of fewer no lattice is certain."""

MIN_STEPS = 3
"""… and of a multiple of one that is certain."""

MIN_IN_CELL = 5

SURE_LATTICE = 16.0
"""Phases of so many steps that agree: by chance once in e^16, of some hundred steps tried."""

IN_MOTION, SURE_MOVING = 0.25, 3.0
"""Measurements that move by more than this share of a step in a sample are none of a steady speed,
and gather by so many standard errors of chance."""

AGREE, CLEARLY_AGREE = 0.3, 0.7
"""Mean resultant of a step's measurements: noise of a quarter of a step leaves it; one of an eighth
leaves more than those few values do that a command of one size leads to again and again."""


PARTS, NEARBY = (2, 3, 4), np.linspace(0.98, 1.02, 9)
"""A certain step may be such a part of the true one: of a step so coarse that fewer than `CELLS`
lie within the measurements only a part is sought, and multiples are tried near by."""


class _Gathered(NamedTuple):
    """How measurements gather within steps of one length."""

    share: float
    """Mean resultant of their phases over the steps."""
    sure: bool
    """Whether chance gathers them so once in e^16."""
    moves: bool
    """Whether measurements in motion gather there, too."""


def _on_few_ways(records: Sequence[Record]) -> bool:
    """Whether no command of any log is anything but zero or one size, either way.

    Such a command drives a motor along the same few ways, over and over: the measurements on them
    are the same few values, and some step suits them by chance.
    """
    if not records[0].nu:
        return False
    commands = [np.abs(c) for r in records for c in r.u.T]
    return all(len(np.unique(c[c > 0.0])) < 2 for c in commands)


def blurred_step(y: Array, agree: float = AGREE) -> float:
    """Step of a lattice that noise has blurred, as of ticks behind a noisy line; 0 for none.

    In every interval of one step measurements gather at one place. Each interval has one vote,
    however many measurements it holds: a few levels held for long are no lattice. Nor are many at
    equal distances, as a staircase of the command leaves: measurements in motion must gather there,
    too.

    Args:
        y: measurements, (N,).
        agree: mean resultant within the steps that is asked.
    """
    size = float(np.quantile(np.abs(y), 0.95)) if len(y) else 0.0
    if size <= 0.0:
        return 0.0
    best, most = 0.0, agree  # half a step gathers them, too, but less
    change = np.abs(np.gradient(y)) if len(y) > 1 else np.zeros(len(y))
    for f in np.arange(CELLS, 1.0 / VISIBLE, 0.25) / size:
        gathered = _gathered(y, change, float(f))
        if gathered.sure and gathered.moves and gathered.share > most:
            best, most = 1.0 / float(f), gathered.share
    for coarser in [best * k * near for k in PARTS for near in NEARBY] if best > 0.0 else []:
        if size < MIN_STEPS * coarser:
            continue
        gathered = _gathered(y, change, 1.0 / coarser)
        if gathered.moves and gathered.share > most:
            best, most = coarser, gathered.share
    return float(best)


def _gathered(y: Array, change: Array, f: float) -> _Gathered:
    """How measurements `y` that change by `change` a sample gather within steps of 1/f."""
    cell, turned = np.floor(y * f).astype(np.intp), np.exp(2j * np.pi * y * f)
    cell -= cell.min()
    count = np.bincount(cell)
    there = count >= MIN_IN_CELL
    mean = np.bincount(cell, turned.real) + 1j * np.bincount(cell, turned.imag)
    mean = mean[there] / count[there]
    total, square = abs(np.sum(mean)), float(np.sum(np.abs(mean) ** 2))
    moving = turned[change * f > IN_MOTION]
    chance = SURE_MOVING / np.sqrt(max(len(moving), 1))
    return _Gathered(
        total / max(len(mean), 1),
        bool(square > 0.0 and total**2 / square > SURE_LATTICE),
        bool(abs(np.sum(moving)) > max(0.5 * AGREE, chance) * len(moving)),
    )


def _bursts(record: Record, i: int, step: float, holds: bool, strict: bool) -> Mask:
    """Samples of one output that were lost.

    Args:
        strict: only bursts that can hardly be anything else; else what is likely a lost reading
            once it is known that measurements do get lost.
    """
    y = record.y[:, i]
    lost = np.zeros(len(y), dtype=bool)
    if len(y) < 8:
        return lost
    ordinary = step > 0.0 or _repeats_by_chance(y)
    noise = max(reading_noise([y]), 1e-9)
    size = float(np.quantile(np.abs(y), 0.95)) or 1.0
    least = max(8.0 * noise, 3.0 * step, (0.1 if holds else 0.25) * size)
    if holds and not ordinary and _resolution(y) < 0.1 * noise:
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
            lost[k:stop] = not ordinary or _moved_before(record, i, k, stop, least)
    return lost


def _resolution(y: Array) -> float:
    """Last digit of most measurements; infinite when there is none."""
    last = _last_digits(y)
    return float(np.median(last)) if len(last) else np.inf


def _last_digits(y: Array) -> Array:
    """Last digit of each reading but the first, (N − 1,); nothing where no reading changes.

    Files with so many digits in all have coarser ones where measurements are larger: the digit is
    the smallest change among measurements of the same power of ten or above.
    """
    change = np.round(np.abs(np.diff(y)), 9)
    moved = change > 0.0
    if not moved.any():
        return np.zeros(0)
    size = np.maximum(np.abs(y[1:]), np.abs(y[:-1]))
    power = np.floor(np.log10(np.maximum(size, 1e-9)))
    digits = np.zeros(len(change))
    for p in np.unique(power):
        there = moved & (power >= p)
        if there.any():
            digits[power == p] = np.min(change[there])
    return np.maximum(digits, np.min(change[moved]))


def _repeats_by_chance(y: Array) -> bool:
    """Whether measurements repeat hardly more often than they change by one last digit either way.

    A clipped sensor repeats its largest value, and a lost one zero: neither is asked.
    """
    change = np.round(np.abs(np.diff(y)), 9)
    last = _last_digits(y)
    asked = (np.abs(y[1:]) < TOP * np.max(np.abs(y))) & (y[1:] != 0.0)
    near = float(np.sum(asked & (change > 0.0) & (change < 1.5 * last))) / 2.0 if len(last) else 0.0
    return float(np.sum(asked & (change == 0.0))) <= 3.0 * near + 5.0


def recurring_step(y: Array) -> float:
    """Step of a coarse sensor whose measurements were interpolated onto a grid; 0 for none.

    They lie on no lattice any more, but where two measurements were alike the lattice value still
    stands twice. All such values lie on one lattice through zero, however seldom each comes; a
    reading of a fine sensor that was held is a number of its own.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.diff(y) == 0.0, [0]])))
    twice = np.round(y[edges[::2]], 9)
    repeated = np.unique(np.abs(twice[twice != 0.0]))
    if len(repeated) < MIN_REPEATED_VALUES:
        return _recurring(twice)
    some = repeated[:: -(-len(repeated) // MAX_REPEATED_VALUES)]
    cells = np.arange(MIN_CELLS, MAX_CELLS, 0.1) / repeated[-1]
    agree = np.mean(np.cos(2.0 * np.pi * np.outer(cells, some)), axis=1)
    near = np.flatnonzero(agree > IN_CELL)
    if not len(near):
        return 0.0
    first = int(near[0]) + int(np.argmax(agree[near[0] : near[0] + 10]))
    whole = np.maximum(np.round(repeated * cells[first]), 1.0)
    if len(np.unique(whole)) < MIN_REPEATED_VALUES:  # one settled speed agrees with any step
        return _recurring(twice)
    step = float(np.sum(repeated * whole) / np.sum(whole**2))
    off = repeated / step
    return step if float(np.mean(np.abs(off - np.round(off)) < 0.05)) >= ON_LATTICE else 0.0


def _recurring(twice: Array) -> float:
    """Step of so coarse a sensor that few values stand twice, each of them again and again."""
    values, counts = np.unique(twice, return_counts=True)
    often, moving = values[counts >= RECURS], values != 0.0
    known = np.sum(counts[moving & (counts >= RECURS)])
    if len(often) < MIN_RECURRING_VALUES or known <= 0.5 * np.sum(counts[moving]):
        return 0.0
    gaps = np.diff(often)
    step = float(np.min(gaps[gaps > 1e-3 * float(np.median(gaps))]))
    off = (often - often[0]) / step
    return step if float(np.mean(np.abs(off - np.round(off)) < 0.05)) >= ON_LATTICE else 0.0


def _moved_before(record: Record, i: int, k: int, stop: int, least: float) -> bool:
    """Whether the speed must have moved while it was read as constant from k to stop − 1.

    It was moving the same way before, or the command had changed early enough to show by then.
    """
    y, u = record.y[:, i], record.u[:, min(i, record.nu - 1)]
    jump = float(y[stop] - y[k - 1])
    moving = float(y[k - 1] - y[k - 2])
    if moving * jump > 0.0 and abs(moving) > 0.5 * least:
        return True
    late = abs(float(u[stop - 1] - u[stop - 2]))
    early = float(np.max(np.abs(np.diff(u[k - 2 : stop - 1])), initial=0.0))
    return early > 0.1 * float(np.max(np.abs(u))) and late < 0.2 * early
