"""Periods without a model: zero crossings and turning points.

They say which part of a log is a free swing (before it the body is held, after it somebody stops
it), give the fit its start, and check its result.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.errors import DataError

MIN_PERIODS = 3.0
"""Periods needed to measure one: with fewer, damping and offset decide the period too."""
MIN_SAMPLES_PER_PERIOD = 4.0
"""Samples per period: with fewer, an oscillation twice as fast looks the same."""
TONE = 0.5
"""Share of the variation that the strongest wave has where there is one: of noise over ten windows
or more it has a few per cent, of a swing sampled too slowly nearly all."""
REACH = 0.1
"""Share of the largest swing that the angle must reach on either side between two passages: less
is noise, or a swing so small that its crossings carry little information."""
STEADY = 0.15
"""A period may differ by so much from the usual one: at 90° it is 18 % longer than at rest."""
LONGEST_HOLE = 12
"""Half periods between two passages up to which they are counted across missing measurements."""
WINDOW = 15
"""Measurements among which the middle one is taken before passages are looked for: up to seven wild
ones in a row do no harm."""
GROWTH, LOSS = 1.3, 0.3
"""A swing may be at most so much larger, and must be at least so much of the one before, half a
period ago: free swings do not grow (offset and noise apart), and one that loses more is no
oscillation to count periods of (damping ratio 0.36)."""


@dataclass(frozen=True)
class Counted:
    """A period from instants that follow each other by half of it.

    Attributes:
        period: [s].
        std_error: of it, from the scatter of the instants [s].
        instants: how many there were.
    """

    period: float = field(metadata={"alias": "period_s"})
    std_error: float
    instants: int


@dataclass(frozen=True, eq=False)
class FreeSwing:
    """The part of a log in which the body swings freely.

    Attributes:
        passages: instants at which the angle passes the middle, (n,) [s].
        numbers: of these, counted in half periods from the first, (n,): where measurements are
            missing some passages are.
        swings: the angle farthest from the middle after each but the last of them, (n − 1,).
        middle: the angle about which it swings.
        period: the usual period [s].
        from_passages, from_turns: periods counted from either.
    """

    passages: Array
    numbers: NDArray[np.int_]
    swings: Array
    middle: float
    period: float
    from_passages: Counted
    from_turns: Counted


def free_swing(t: Array, angle: Array, where: str) -> FreeSwing:
    """Find the longest part of a log that is a free swing, and count its periods.

    Args:
        t: instants [s], (N,), rising.
        angle: (N,), in any unit.
    """
    guess = _strongest_period(t, angle, where)
    even, smooth = _smoothed(t, angle, guess)
    wide = np.flatnonzero(np.diff(t) > guess / 8.0)  # a passage may hide in them
    holes = np.column_stack([t[wide] - guess / 8.0, t[wide + 1] + guess / 8.0])
    middle = 0.5 * float(np.sum(np.percentile(smooth, (1.0, 99.0))))
    first = _regular(even, smooth - middle, holes, where)
    middle += 0.5 * float(np.mean(first.swings[:-1] + first.swings[1:]))
    rough = _regular(even, smooth - middle, holes, where)
    half = 0.5 * rough.period
    passages = np.array([_passage(t, angle - middle, at, half) for at in rough.passages])
    turns = np.array([_turn(t, angle, at, half) for at in rough.turns])
    whole = np.diff(rough.numbers) == 1
    return FreeSwing(
        passages,
        rough.numbers,
        rough.swings,
        middle,
        rough.period,
        _counted(passages, rough.numbers),
        _counted(turns[whole], rough.numbers[:-1][whole]),
    )


@dataclass(frozen=True, eq=False)
class _Rough:
    passages: Array
    numbers: NDArray[np.int_]
    turns: Array
    swings: Array
    period: float


def _strongest_period(t: Array, angle: Array, where: str) -> float:
    """The period of the strongest wave, from the spectrum on an even grid [s]."""
    step = float(np.median(np.diff(t)))
    span = float(t[-1] - t[0])
    if span < 4.0 * step:
        raise DataError(f"{where} holds no oscillation: it is {span:.3g} s long")
    n = round(span / step) + 1
    even = np.linspace(t[0], t[-1], n)
    low, high = np.percentile(angle, (2.0, 98.0))
    clipped = np.clip(angle, low - (high - low) / 2.0, high + (high - low) / 2.0)
    signal = np.interp(even, t, clipped)  # outliers would hide the oscillation
    signal = signal - np.polyval(np.polyfit(even, signal, 1), even)
    if not float(np.ptp(signal)) > 1e-9 * float(np.max(np.abs(angle))):
        drifts = float(np.ptp(angle)) > 1e-9 * float(np.max(np.abs(angle)))
        does = "drifts evenly" if drifts else f"stays at {angle[0]:.4g}"
        raise DataError(f"{where} holds no oscillation: the angle {does}")
    power = np.abs(np.fft.rfft(signal * np.hanning(n), 4 * n)) ** 2
    frequency = np.fft.rfftfreq(4 * n, span / (n - 1))
    low = frequency >= MIN_PERIODS / span / 2.0
    best = float(frequency[low][np.argmax(power[low])])
    if best * step * MIN_SAMPLES_PER_PERIOD > 1.0:
        lobe = np.abs(frequency - best) <= 2.0 / span  # of the Hann window
        if float(np.sum(power[lobe])) < TONE * float(np.sum(power)):
            raise DataError(
                f"{where} holds no oscillation: the angle is noise without a period; "
                "let it swing freely ten times or more, from some 10°"
            )
        raise DataError(
            f"{where}: one sample every {step:.3g} s is too slow for a period of {1 / best:.3g} "
            "s; record at 20 Hz or faster"
        )
    return 1.0 / best


def _smoothed(t: Array, angle: Array, period: float) -> tuple[Array, Array]:
    """An even grid, and the angle on it without outliers, averaged over an eighth period."""
    from scipy.ndimage import median_filter, uniform_filter1d

    step = float(np.median(np.diff(t)))
    even = np.linspace(t[0], t[-1], round(float(t[-1] - t[0]) / step) + 1)
    width = int(period / 8.0 / step) | 1
    if width < 3:
        return even, np.interp(even, t, angle)
    calm = median_filter(angle, min(width, WINDOW), mode="nearest")
    return even, uniform_filter1d(np.interp(even, t, calm), width, mode="nearest")


def _regular(t: Array, x: Array, holes: Array, where: str) -> _Rough:
    """The longest run of passages that follow each other as those of a free swing do."""
    level = REACH * float(np.max(np.abs(x)))
    beyond = np.flatnonzero(np.abs(x) > level)
    sides = np.sign(x[beyond])
    changes = np.flatnonzero(sides[1:] != sides[:-1])
    spans = [(int(beyond[k]), int(beyond[k + 1])) for k in changes]
    passages = np.array([_zero(t[a : b + 1], x[a : b + 1]) for a, b in spans])
    hidden = np.any((passages[:, None] > holes[:, 0]) & (passages[:, None] < holes[:, 1]), axis=1)
    passages = passages[~hidden]
    edges = np.searchsorted(t, passages).tolist()
    pieces = [slice(a, max(b, a + 1)) for a, b in pairwise(edges)]
    peaks = [p.start + int(np.argmax(np.abs(x[p]))) for p in pieces]
    run, numbers, period = _longest_run(passages, x[peaks])
    count = float(numbers[-1]) / 2.0 if len(numbers) else 0.0
    if count < MIN_PERIODS:
        raise DataError(
            f"{where} holds no oscillation that can be counted: {count:g} periods follow each "
            f"other evenly, and {MIN_PERIODS:g} are needed; let it swing freely ten times or "
            "more, from some 10°, on a hinge that damps little"
        )
    between = slice(run.start, run.stop - 1)
    return _Rough(passages[run], numbers, t[peaks][between], x[peaks][between], period)


def _longest_run(passages: Array, swings: Array) -> tuple[slice, NDArray[np.int_], float]:
    """The longest run whose passages are whole half periods apart and whose swings fade.

    Returns:
        it, the number of each passage in half periods, and the usual period.
    """
    none = slice(0, 0), np.zeros(0, dtype=int), 0.0
    if len(passages) < 3:
        return none
    periods = passages[2:] - passages[:-2]
    size = np.abs(swings)
    large = size[:-1] + size[1:]
    usual = float(np.median(periods[large >= np.median(large)]))
    # an offset makes half periods long and short in turns, so whole ones are compared
    apart = np.diff(passages) / (0.5 * usual)
    steps = np.maximum(np.rint(apart), 1.0).astype(int)
    off = np.abs(periods / (0.5 * usual) - steps[1:] - steps[:-1])
    even: NDArray[np.bool_] = (off < 2.0 * STEADY) & (steps[1:] + steps[:-1] <= LONGEST_HOLE)
    side_by_side = (steps[1:] == 1) & (steps[:-1] == 1)
    fades = (size[1:] < GROWTH * size[:-1]) & (size[1:] > LOSS * size[:-1])
    even &= fades | ~side_by_side
    best, length, start = slice(0, 0), 0, 0
    for k in range(len(even) + 1):
        if k == len(even) or not even[k]:
            if k > start and int(steps[start : k + 1].sum()) > length:
                best, length = slice(start, k + 2), int(steps[start : k + 1].sum())
            start = k + 1
    if not length:
        return none
    numbers = np.concatenate([[0], np.cumsum(steps[best.start : best.stop - 1])])
    return best, numbers, usual


def _zero(t: Array, x: Array) -> float:
    """Where a piece that goes from one side to the other passes zero [s]: its middle change."""
    k = np.flatnonzero(np.sign(x[1:]) != np.sign(x[:-1]))
    at = int(k[len(k) // 2])
    rise = x[at + 1] - x[at]
    return float(t[at] - x[at] / rise * (t[at + 1] - t[at])) if rise else float(t[at])


def _passage(t: Array, x: Array, at: float, half: float) -> float:
    """Zero of the line through measurements near a passage, wild ones left out [s]."""
    near = slice(*np.searchsorted(t, (at - half / 6.0, at + half / 6.0)))
    s, x = t[near] - at, x[near]
    if len(s) < 3:
        return at
    slope, offset = np.polyfit(s, x, 1)
    off = np.abs(x - slope * s - offset)
    good = off <= 5.0 * np.median(off) + 1e-12 * float(np.max(np.abs(x)))
    if 3 <= good.sum() < len(s):
        slope, offset = np.polyfit(s[good], x[good], 1)
    zero = float(-offset / slope) if slope else 0.0
    return at + (zero if abs(zero) < half / 6.0 else 0.0)


def _turn(t: Array, x: Array, at: float, half: float) -> float:
    """A turning point from a parabola through the measurements near it [s]."""
    near = slice(*np.searchsorted(t, (at - half / 3.0, at + half / 3.0)))
    if near.stop - near.start < 4:
        return at
    s = (t[near] - at) / half
    bend, slope, _ = np.polyfit(s, x[near], 2)
    vertex = -slope / (2.0 * bend) if bend else 0.0
    return at + half * (float(vertex) if abs(vertex) < 1.0 / 3.0 else 0.0)


def _counted(instants: Array, numbers: NDArray[np.int_]) -> Counted:
    """Twice the slope of instants over their number; both sides have an offset of their own."""
    k = numbers.astype(np.float64)
    X = np.column_stack([k, np.ones(len(k)), (-1.0) ** k])
    beta = np.linalg.lstsq(X, instants, rcond=None)[0]
    residual = instants - X @ beta
    usual = 1.4826 * float(np.median(np.abs(residual)))
    good = np.abs(residual) <= 6.0 * usual + 1e-12  # a wild measurement moves a turn or passage
    if 5 <= good.sum() < len(k):
        X, instants = X[good], instants[good]
        beta = np.linalg.lstsq(X, instants, rcond=None)[0]
        residual = instants - X @ beta
    dof = max(len(instants) - 3, 1)
    variance = float(residual @ residual) / dof * float(np.linalg.pinv(X.T @ X)[0, 0])
    return Counted(2.0 * float(beta[0]), 2.0 * float(np.sqrt(variance)), len(instants))
