"""Uniform grids: check that the instants form one, and resample where they do not."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sysid.data.finding import Finding, Severity
from sysid.data.record import Array
from sysid.errors import DataError, UsageError

STAMP_UNITS = (86400.0, 3600.0, 60.0, 1.0)
"""Units of stamps [s] that are longer than a second, or one: shorter ones end in a decimal too."""
COARSEST = 0.2
"""A last digit beyond this share of the sample time is too coarse to find a period."""
MIN_STAMPS = 10
"""Fewer stamps agree with several periods."""


def last_digit(t: Array, dt: float) -> float:
    """The step [s] of the last digit of the stamps t (N,), 0 where they are finer than any.

    Stamps in minutes with four decimals are multiples of 0.006 s: that is seen in seconds too.
    """
    shifted = t - t[0]
    steps = sorted((unit * 10.0**-k for unit in STAMP_UNITS for k in range(10)), reverse=True)
    for step in (s for s in steps if s <= COARSEST * dt):
        counts = shifted / step
        if np.max(np.abs(counts - np.rint(counts))) < 1e-4:
            return step
    return 0.0


def round_period(t: Array, dt: float) -> float:
    """A sample time T of two digits near ``dt`` if every stamp agrees with it to its last digit.

    |t_k − t_0 − n_k T| ≤ q for all k, with n_k whole and q the step of the last digit; else dt.

    Args:
        t: instants [s], (N,).
        dt: their usual or mean step [s].
    """
    period = float(f"{dt:.2g}")
    if len(t) < MIN_STAMPS or period == dt or not period > 0.0:
        return dt
    if abs(period - dt) > COARSEST * dt or np.ptp(np.diff(t)) <= 1e-9 * dt:
        return dt  # steps that are all alike, such as those of whole days, leave nothing to find
    digit = last_digit(t, dt)
    if digit == 0.0 or abs(period - dt) > 1.001 * digit:
        return dt
    off = (t - t[0]) / period
    return period if np.max(np.abs(off - np.rint(off))) * period <= 1.001 * digit else dt


ResamplePolicy = Literal["auto", "hold", "refuse", "fill", "split"]
"""auto: even out jitter and gaps of a few samples, cut at longer ones into several experiments;
hold: so, and an output cell that is empty is the last measurement again; refuse: only a uniform
grid will do; fill: interpolate over gaps of any length; split: as auto, and cut wherever the clock
goes back."""

POLICIES: tuple[str, ...] = get_args(ResamplePolicy)
ROUNDING = 0.01
"""Intervals within this fraction of the sample time count as uniform."""
GAP = 1.5
"""An interval longer than this many sample times is a gap."""
SHORT_GAP = 3
"""Up to this many missing samples in a row are interpolated without being asked."""
SHORTEST = 10
"""Pieces between gaps with fewer samples than this are left out."""
MOST_SET_BACK = 0.01
"""Share of rows up to which a clock that goes back was set; rows in disorder go back more often."""
MOST_FILLED = 20
"""Samples for each row beyond which a log is not filled: what was measured would be lost in it."""
LEAST_FILLED = 1_000_000
"""Samples that are filled in any case: they cost no memory to speak of."""

Place = Callable[[int], str]


@dataclass(frozen=True)
class Segment:
    """Rows ``start`` ≤ i < ``stop`` of the file that make one experiment."""

    start: int
    stop: int
    even: bool


@dataclass(frozen=True)
class Grid:
    """How the rows of a file become uniform experiments.

    Attributes:
        dt: sample time, in the unit of the time given.
        segments: the experiments; those that are not ``even`` are to be brought onto it.
    """

    dt: float
    segments: tuple[Segment, ...]
    findings: tuple[Finding, ...]


def check_policy(policy: str) -> ResamplePolicy:
    """The policy, if it is one."""
    if policy not in POLICIES:
        raise UsageError(f"unknown `resample` {policy!r}; choose one of {', '.join(POLICIES)}")
    return policy  # type: ignore[return-value]


def plan_grid(
    t: Array,
    policy: ResamplePolicy,
    place: Place,
    where: str,
    advice: Callable[[], str] = lambda: "log it with more digits",
) -> Grid:
    """Judge the instants ``t`` (N,) and say how to bring the samples onto a uniform grid.

    With d the intervals and T their median: |d/T − 1| ≤ 1 %, or deviations no larger than the
    digits printed, is uniform. d > 1.5 T is a gap. Anything between is jitter.

    Args:
        t: instants, any unit, finite.
        policy: what may be done about jitter and gaps.
        place: row → "file, line n" for messages.
        advice: what to do about a clock that stands.
    """
    breaks = _increasing(t, policy, place, where, advice)
    bounds = [0, *(i + 1 for i in breaks), len(t)]
    inside = np.ones(len(t) - 1, dtype=bool)
    inside[list(breaks)] = False
    d = np.diff(t)
    T = float(np.median(d[inside]))
    ratio = np.where(inside, d / T, 1.0)
    gaps = _gaps(ratio)
    missing = np.where(gaps, np.rint(ratio).astype(int) - 1, 0)
    dt = float(d[inside].sum() / max((np.count_nonzero(inside) + missing[inside].sum()), 1))
    if not 1e-9 <= dt <= 1e9:
        raise DataError(
            f"{where}: a sample time of {dt:.3g} s is not credible; check the time column"
        )
    dt = float(f"{dt:.12g}")  # 0.0999999… of a mean over printed tenths is 0.1
    dt = round_period(t, dt)

    off = np.abs(d / dt - 1.0)[inside & ~gaps]
    uneven = bool(len(off)) and off.max() > ROUNDING and not _is_rounding(t, dt, gaps | ~inside)
    if np.mean(np.abs(ratio - 1.0) > 0.5) > 0.2 and policy in ("auto", "split"):
        raise DataError(
            f"{where}: the sampling is irregular, with intervals from {d[inside].min():.3g} to "
            f"{d[inside].max():.3g} s; record at a fixed rate, or interpolate with "
            "`resample='fill'`"
        )
    findings = _set_back_findings(t, breaks, place, where)
    if uneven:
        findings.append(_jitter(d[inside & ~gaps], dt, policy, where))
    long = gaps & (missing > SHORT_GAP)
    findings += _gap_findings(gaps, long, missing, d, policy, place, where)
    if policy in ("auto", "split"):
        bounds = sorted({*bounds, *(int(i) + 1 for i in np.flatnonzero(long))})
    pieces = list(pairwise(bounds))
    kept = [(a, b) for a, b in pieces if b - a >= SHORTEST or len(pieces) == 1]
    if not kept:
        raise DataError(
            f"{where}: no piece between its gaps has {SHORTEST} samples; record again, or "
            "interpolate with `resample='fill'`"
        )
    if len(kept) < len(pieces):
        n, rows = len(pieces) - len(kept), len(t) - sum(b - a for a, b in kept)
        text = f"{where}: {n} piece{'s' * (n > 1)} between gaps, of {rows} samples in all, "
        text += f"{'were' if n > 1 else 'was'} left out as too short."
        findings.append(Finding("gaps", Severity.NOTE, text, record=where))
    segments = [Segment(a, b, even=not (uneven or gaps[a : b - 1].any())) for a, b in kept]
    filled = sum((t[s.stop - 1] - t[s.start]) / dt for s in segments if not s.even)
    if filled > max(MOST_FILLED * len(t), LEAST_FILLED):
        raise DataError(
            f"{where}: its {len(t)} rows would be filled up to {filled:.3g} samples; split it at "
            "the gaps with `resample='auto'`"
        )
    return Grid(dt, tuple(segments), tuple(findings))


def positions(t: Array, start: float, dt: float) -> Array:
    """Instants t (N,) [s] in steps of a grid, whole where all of them fall on it."""
    at = (t - start) / dt
    nearest = np.rint(at)
    on_it = np.all(np.abs(at - nearest) <= 2.0 * ROUNDING) and np.all(np.diff(nearest) > 0)
    return nearest if on_it else at


def measured_on_grid(t: Array, dt: float, y: Array) -> Array:
    """Measurements y (N, n) at instants t (N,), on lines between them at t[0] + k·dt, (M, n)."""
    at, k = positions(t, t[0], dt), _steps(t, dt)
    return np.column_stack([np.interp(k, at, column) for column in y.T])


def held_on_grid(t: Array, dt: float, u: Array) -> Array:
    """Commands u (N, n) from instants t (N,) on, at t[0] + k·dt, (M, n); see ``held``."""
    return held(positions(t, t[0], dt), u, _steps(t, dt))


def _steps(t: Array, dt: float) -> Array:
    return np.arange(np.floor((t[-1] - t[0]) / dt + ROUNDING) + 1.0)


def held(at: Array, u: Array, k: Array) -> Array:
    """A signal that is held between its instants, at whole steps k (M,) of a grid, (M, n).

    Where the instants do not fall on the grid, the value is the mean of the held signal over the
    step, ū_k = (1/dt)∫ u(τ)dτ over [t_k, t_k + dt): picking the last value instead would delay
    the input by a whole sample wherever a stamp comes a moment late.

    Args:
        at: instants in steps of the grid, rising, (N,).
        u: values from these instants on, (N, n).
    """
    if np.all(at == np.rint(at)):
        return u[np.maximum(np.searchsorted(at, k, side="right") - 1, 0)]
    return zero_order_hold_means(at, u, np.append(k, k[-1] + 1.0))


def zero_order_hold_means(at: Array, u: Array, edges: Array) -> Array:
    """Means of a held signal between edges that are a unit apart, (M, nu).

    Args:
        at: instants in the unit of the edges, rising, (N,); the last value holds to the last edge.
        u: values from these instants on, (N, nu).
        edges: (M + 1,).
    """
    knots = np.append(at, max(edges[-1], at[-1] + 1.0))
    width = np.diff(knots)[:, None]
    integral = np.vstack([np.zeros(u.shape[1]), np.cumsum(u * width, axis=0)])
    means = [np.diff(np.interp(edges, knots, column)) for column in integral.T]
    return np.column_stack(means) if means else np.empty((len(edges) - 1, 0))


def _increasing(
    t: Array, policy: ResamplePolicy, place: Place, where: str, advice: Callable[[], str]
) -> tuple[int, ...]:
    """Intervals where the clock starts again or is set back; refuses any other non-increase."""
    d = np.diff(t)
    bad = np.flatnonzero(d <= 0)
    if not len(bad):
        return ()
    i = int(bad[0])
    if np.all(d < 0):
        raise DataError(f"{where}: time decreases throughout; sort the rows by time")
    if not np.any(d > 0) or np.count_nonzero(d == 0) > len(d) // 3:
        raise DataError(
            f"{place(i + 1)}: time stays at {t[i]:.9g} (as {np.count_nonzero(d == 0)} rows "
            f"do); {advice()}"
        )
    if d[i] == 0:
        raise DataError(
            f"{place(i + 1)}: time {t[i]:.9g} appears twice; delete one of the two lines"
        )
    back = np.flatnonzero(d < 0)
    usual = float(np.median(np.diff(np.unique(t))))  # of rows in disorder, the steps are not
    restarts = np.abs(t[back + 1] - t[0]) <= 3.0 * usual
    apart = restarts.all() or set_back(t).size == len(back)
    if (policy == "split" or (policy == "auto" and apart)) and not np.any(d == 0):
        return tuple(int(j) for j in back)
    hint = (
        "the file holds several logs; `resample='auto'` makes an experiment of each"
        if apart
        else "sort the rows by time or delete that line"
    )
    raise DataError(
        f"{place(i + 1)}: time does not increase; it goes from {t[i]:.9g} to {t[i + 1]:.9g}; {hint}"
    )


def set_back(t: Array) -> NDArray[np.intp]:
    """Intervals where a clock is set back, as at the end of summer time.

    Few of them, each between pieces of ``SHORTEST`` rows or more, after which the clock stays
    behind: t rises by less than the rows around the interval say. Where stamps are damaged or rows
    exchanged it rises by as much; rows in disorder make many short pieces. What was logged is in
    the order of the rows: sorting them would mix two experiments.
    """
    d = np.diff(t)
    back = np.flatnonzero(d < 0)
    if not 0 < len(back) <= MOST_SET_BACK * len(t):
        return back[:0]
    rows = np.diff([-1, *back, len(t) - 1])
    back = back[np.minimum(rows[:-1], rows[1:]) >= SHORTEST]
    around, usual = SHORTEST // 2, float(np.median(d[d > 0]))
    rise = t[back + around] - t[back + 1 - around]
    return back[(2 * around - 1) * usual - rise >= GAP * usual]


def _gaps(ratio: Array) -> NDArray[np.bool_]:
    """Intervals that lack samples; a late stamp followed by an early one lacks none."""
    wide = ratio > GAP
    after = np.append(ratio[1:], np.inf)
    before = np.append(np.inf, ratio[:-1])
    late = (ratio + np.minimum(after, before) < 2.25) & (ratio < 2.0)
    return np.asarray(wide & ~late)


def _is_rounding(t: Array, dt: float, cut: NDArray[np.bool_]) -> bool:
    """Whether the deviations from the grid are no larger than the last digit printed."""
    quantum = last_digit(t, dt)
    steps = np.where(cut, np.nan, np.diff(t) - dt)
    return quantum > 0.0 and bool(np.nanmax(np.abs(steps)) <= 1.001 * quantum)


def _jitter(d: Array, dt: float, policy: ResamplePolicy, where: str) -> Finding:
    rms, peak = 100 * np.std(d) / dt, 100 * np.max(np.abs(d / dt - 1.0))
    seen = f"{where}: the sample time jitters by {rms:.2g} % rms ({peak:.2g} % at most) of {dt:.4g}"
    if policy == "refuse":
        raise DataError(f"{seen} s; record at a fixed rate, or allow `resample='auto'`")
    return Finding(
        "jitter",
        Severity.WARNING if rms > 3 else Severity.NOTE,
        f"{seen} s; it was resampled onto a uniform grid.",
        "Log at a fixed rate if possible: interpolation smooths the fastest part of the signals.",
        record=where,
    )


def _set_back_findings(t: Array, breaks: Sequence[int], place: Place, where: str) -> list[Finding]:
    """What is said of a clock that was set back; one that starts again at its start was not."""
    usual = float(np.median(np.diff(t)))
    back = [i for i in breaks if abs(t[i + 1] - t[0]) > 3.0 * usual]
    if not back:
        return []
    by = t[back[0]] + usual - t[back[0] + 1]
    amount = f"{by / 3600:.4g} h" if by >= 3600 else f"{by:.4g} s"
    more = "" if len(back) == 1 else f" (the first of {len(back)} times)"
    text = (
        f"{place(back[0] + 1)}: the clock goes back by {amount}{more}; another experiment begins "
        "there, in the order of the rows."
    )
    return [Finding("clock-set-back", Severity.WARNING, text, record=where)]


def _gap_findings(
    gaps: NDArray[np.bool_],
    long: NDArray[np.bool_],
    missing: NDArray[np.int64],
    d: Array,
    policy: ResamplePolicy,
    place: Place,
    where: str,
) -> list[Finding]:
    if not gaps.any():
        return []
    shown = long if long.any() else gaps
    first = int(np.flatnonzero(shown)[0])
    n = int(np.count_nonzero(shown))
    more = "" if n == 1 else f" (the first of {n} gaps)"
    seen = f"{place(first + 1)}: {d[first]:.4g} s without samples before this line{more}"
    if policy == "refuse":
        raise DataError(f"{seen}; `resample='auto'` cuts it there, `resample='fill'` interpolates")
    lost = int(missing[gaps].sum())
    advice = "Find out what kept the logger from writing; interpolated samples hold no information."
    if policy != "fill" and long.any():
        did = f"; the log was cut into {n + 1} experiments there."
        advice = "`resample='fill'` interpolates instead."
    else:
        did = f"; {lost} missing sample{'s were' if lost > 1 else ' was'} interpolated."
    return [Finding("gaps", Severity.WARNING, seen + did, advice, record=where)]
