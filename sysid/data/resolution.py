"""The steps in which a sensor measures, seen in its measurements."""

import numpy as np

from sysid.data.record import Array

ON_LATTICE = 0.98
"""Share of the measurements that must lie on the lattice."""

VISIBLE = 0.015
"""A step matters when it is at least this share of the largest measurement (95 % quantile)."""

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


def finest_step(y: Array) -> float:
    """The smallest difference between two measurements (N,), beyond rounding; 0 for a constant."""
    apart = np.diff(np.unique(y))
    apart = apart[apart > 1e-9 * float(np.max(np.abs(y), initial=0.0))]
    return float(np.min(apart)) if len(apart) else 0.0


def sensor_step(y: Array) -> float:
    """The step of a sensor with measurements (N,): on a lattice or between lines; 0 for none."""
    return lattice(y) or recurring_step(y)


def last_digit(y: Array) -> float:
    """Last digit of most measurements; infinite when there is none."""
    last = last_digits(y)
    return float(np.median(last)) if len(last) else np.inf


def last_digits(y: Array) -> Array:
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


ENOUGH = 30_000
"""Measurements of a long log that are looked at for a lattice, evenly spread."""


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
    some = slice(None, None, max(-(-len(y) // ENOUGH), 1))
    y, change = y[some], change[some]
    tried = np.arange(CELLS, 1.0 / VISIBLE, 0.25) / size
    # from one step to the next all phases turn on by as much: an exponential less
    turned, turn = (np.exp(2j * np.pi * f * y) for f in (tried[0], tried[1] - tried[0]))
    for f in tried.tolist():
        share, sure = _gathered(y, turned, f)
        if share > most and sure and _moving_too(turned, change * f):
            best, most = 1.0 / f, share
        turned = turned * turn
    for coarser in [best * k * near for k in PARTS for near in NEARBY] if best > 0.0 else []:
        if size < MIN_STEPS * coarser:
            continue
        turned = np.exp(2j * np.pi * y / coarser)
        share, _ = _gathered(y, turned, 1.0 / coarser)
        if share > most and _moving_too(turned, change / coarser):
            best, most = coarser, share
    return float(best)


def _gathered(y: Array, turned: Array, f: float) -> tuple[float, bool]:
    """How measurements gather within steps of 1/f: the mean resultant of their phases over the
    steps, and whether chance gathers them so once in e^16.

    Args:
        turned: exp(2πi f y), (N,).
    """
    cell = np.floor(y * f).astype(np.intp)
    cell -= cell.min()
    count = np.bincount(cell)
    there = count >= MIN_IN_CELL
    mean = np.bincount(cell, turned.real) + 1j * np.bincount(cell, turned.imag)
    mean = mean[there] / count[there]
    total, square = float(abs(np.sum(mean))), float(np.sum(np.abs(mean) ** 2))
    return total / max(len(mean), 1), square > 0.0 and total**2 / square > SURE_LATTICE


def _moving_too(turned: Array, change: Array) -> bool:
    """Whether measurements in motion gather within steps, too.

    Args:
        change: steps by which they move in a sample, (N,).
    """
    moving = turned[change > IN_MOTION]
    chance = SURE_MOVING / np.sqrt(max(len(moving), 1))
    return bool(abs(np.sum(moving)) > max(0.5 * AGREE, chance) * len(moving))


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
