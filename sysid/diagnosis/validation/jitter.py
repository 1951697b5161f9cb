"""Jitter: commands whose delay varies from one to the next, which no model predicts.

The output behind each change of the command is then the model's, shifted in time. A response may be
over within a sample and its delay differ by several, so it is shifted and no gradient is used.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.diagnosis.base_model import Base
from sysid.diagnosis.search.selection import CandidateModel

FURTHEST, STEP = 4.0, 0.125
"""By how much and in which steps a response is moved [samples]; between steps by a parabola. Most
loops that log have at most a few samples of delay, and none is so early that it precedes its
command."""

MOVES = 0.05
"""Change of the drive that shows an instant, of full drive."""

HOLDS = 1e-3
"""Change of the drive below which it holds."""

MIN_CHANGES = 15
"""Changes at least from which a spread is estimated, to about a fifth."""

SHORTEST, LONGEST = 3, 12
"""Samples behind a change that show when it acted; the next one must leave as many."""

MOST = 0.5
"""Share of the errors behind changes that uneven delays must explain: else it is something else."""

MOST_BEFORE = 0.5
"""Squared error just before changes, as a share of that behind them, that is a disturbance's or a
missing effect's: what was there before a change is not made by its delay. Delays that differ leave
.2 where changes follow each other, disturbances and weights 1."""

MAX_PREDICTED_SHARE = 0.3
"""Share of the delays that command and change may predict: else they are no jitter but an effect
that depends on them."""

SURE = 3.0
"""Mean square of the delays in units of their squared standard errors, beyond noise alone."""


MEDIAN = 0.455
"""Median of a squared standard normal number."""

SHIFTS = np.arange(-FURTHEST, FURTHEST + 0.5 * STEP, STEP)
"""By how much a response is moved [samples]; later is positive."""


@dataclass(frozen=True, eq=False)
class Behind:
    """What is seen behind the changes of the command of an output.

    Attributes:
        costs: squared error of each change for each of ``SHIFTS``, (changes, shifts).
        power: Σ (∂y/∂δ)² of each, δ in samples.
        errors: squared errors as they are; ``samples`` they are of.
        before, after: the drive before and after each.
        already: squared errors just before each, for as many samples.
    """

    costs: Array
    power: Array
    errors: Array
    samples: Array
    before: Array
    after: Array
    already: Array


@dataclass(frozen=True)
class Jitter:
    """Delays of one output that differ from change to change.

    Attributes:
        spread: standard deviation of the delays [s].
        changes: of the command, from which it is read.
        share: of the error beyond the noise behind these changes that it explains.
    """

    output: str
    spread: float
    changes: int
    share: float

    @property
    def sentence(self) -> str:
        """What it is, and how large."""
        return (
            f"The delay of {self.output} varies from command to command by {self.spread:.2g} s "
            f"(standard deviation of {self.changes} changes). This jitter is "
            f"{100.0 * self.share:.0f} % of its errors there, and no model predicts it: log the "
            "time at which each command acts."
        )


def detect_jitter(base: Base, candidate: CandidateModel, floor: Array) -> tuple[Jitter, ...]:
    """Outputs whose errors behind changes of the command are delays that differ.

    δ_k is the least of Σ (y(t) − ŷ(t − δ))² over the samples behind change k.

    Args:
        floor: noise of each output, (ny,).
    """
    search, names = base.search, base.parts.estimation[0].output_names
    data = search.data
    run = search.model.run(candidate.q, data)[0]
    errors = np.where(data.weight > 0.0, data.y - run, np.nan)
    starts = np.cumsum([0, *data.lengths]).tolist()
    jitters, dt = [], search.model.dt
    for i, name in enumerate(names):
        pieces = [(data.drive[a:b, i], errors[a:b, i], run[a:b, i]) for a, b in pairwise(starts)]
        parts = [seen for piece in pieces if (seen := _behind(*piece)) is not None]
        measured = _spread(parts, float(floor[i])) if parts else None
        if measured is not None:
            spread, share = measured
            changes = sum(len(p.power) for p in parts)
            jitters.append(Jitter(name, spread * dt, changes, share))
    return tuple(jitters)


def _behind(drive: Array, errors: Array, run: Array) -> Behind | None:
    """What is seen behind each change of one record; None where none shows an instant."""
    steps = np.abs(np.diff(drive))
    changes = 1 + np.flatnonzero(steps > HOLDS)  # a command that always moves shows no instant
    ends = np.minimum(np.append(changes[1:], len(drive)), changes + LONGEST)
    costs, rows = [], []
    for a, b in zip(changes, ends, strict=True):
        if steps[a - 1] <= MOVES:
            continue
        good = a + np.flatnonzero(np.isfinite(errors[a:b]))
        if len(good) < SHORTEST:
            continue
        moved = _moved(run, good, int(b))
        slope = moved(0.5) - moved(-0.5)
        if not np.any(slope):
            continue
        earlier = errors[max(a - SHORTEST, 0) : a]
        earlier = earlier[np.isfinite(earlier)]
        already = float(earlier @ earlier) / max(len(earlier), 1)
        y = errors[good] + run[good]
        costs.append([float(np.sum((y - moved(d)) ** 2)) for d in SHIFTS])
        e = errors[good]
        of = [slope @ slope, e @ e, len(e), drive[a - 1], drive[a]]
        rows.append([*of, already * len(e)])
    if not rows:
        return None
    return Behind(np.array(costs), *np.array(rows).T)


def _moved(run: Array, at: NDArray[np.intp], end: int) -> Callable[[float], Array]:
    """A run that is late by a number of samples, at some samples; none of it is from the end on."""
    t = np.arange(end)
    return lambda late: np.interp(at - late, t, run[:end])


def _spread(parts: Sequence[Behind], floor: float) -> tuple[float, float] | None:
    """Standard deviation [samples] of delays and the share of the errors they are; None where they
    are no jitter."""
    costs = np.concatenate([p.costs for p in parts])
    if len(costs) < MIN_CHANGES:
        return None
    power, errors, samples, before, after, already = (
        np.concatenate([getattr(p, n) for p in parts])
        for n in ("power", "errors", "samples", "before", "after", "already")
    )
    about, _ = _least(np.sum(costs, axis=0))
    least = [_least(c) for c in costs]
    delays = np.array([d for d, _ in least])
    gain = np.array([_at(c, about) for c in costs]) - np.array([c for _, c in least])
    if float(np.median(gain)) < SURE * floor**2 * MEDIAN or np.mean(gain) < SURE * floor**2:
        return None
    excess = float(np.sum(errors - samples * floor**2))
    share = float(np.sum(gain - floor**2)) / excess if excess > 0.0 else 0.0
    was_there = float(np.sum(already - samples * floor**2))
    if was_there > MOST_BEFORE * excess:
        return None
    step = after - before
    sizes = (np.ones(len(step)), step, after)
    known = np.column_stack([*sizes, *(f(x) for x in sizes[1:] for f in (np.abs, np.sign))])
    root = np.sqrt(power)[:, None]
    fitted = known @ np.linalg.lstsq(known * root, delays * root[:, 0], rcond=None)[0]
    rest = float(np.sum((delays - fitted) ** 2 * power)) / (len(step) - known.shape[1])
    apart = (delays - about) ** 2 * power
    whole = float(np.sum(apart)) / (len(step) - 1)
    if share < MOST or not rest > (1.0 - MAX_PREDICTED_SHARE) * whole:
        return None
    spread = np.sqrt(max(float(np.sum(apart - floor**2)) / float(np.sum(power)), 0.0))
    return float(spread), min(share, 1.0)


def _least(costs: Array) -> tuple[float, float]:
    """The shift of the least cost and that cost, by a parabola through three neighbours."""
    k = int(np.clip(np.argmin(costs), 1, len(costs) - 2))
    slope, bend = _parabola(costs, k)
    part = float(np.clip(-slope / bend, -1.0, 1.0)) if bend > 0.0 else 0.0
    shift = float(SHIFTS[k]) + part * STEP
    return shift, _at(costs, shift)


def _at(costs: Array, shift: float) -> float:
    """The cost at a shift, by the parabola through the three nearest."""
    k = int(np.clip(round((shift + FURTHEST) / STEP), 1, len(costs) - 2))
    x, (slope, bend) = (shift - float(SHIFTS[k])) / STEP, _parabola(costs, k)
    return float(costs[k] + slope * x + 0.5 * bend * x**2)


def _parabola(costs: Array, k: int) -> tuple[float, float]:
    """Slope and bend at a shift."""
    low, now, high = costs[k - 1 : k + 2].tolist()
    return (high - low) / 2.0, high - 2.0 * now + low
