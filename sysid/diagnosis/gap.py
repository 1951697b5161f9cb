"""The gap: how much of the error beyond the noise the added effects close on held-out data."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.data.noise import white_noise
from sysid.data.record import Array

REPLICATES = 400
BLOCKS = 30
ABOVE = 1.3
"""An output has a gap where its mean squared error exceeds this multiple of its floor's."""

REFUTED = 0.85
"""Errors below this share of a floor refute it; it is known to some 7 %."""


@dataclass(frozen=True)
class ChannelGap:
    """RMSE of one output before and after, and its noise floor with a 95 % interval."""

    rmse_before: float
    rmse_after: float
    noise_floor: float
    floor_interval: tuple[float, float] | None = None

    @property
    def surely_noise(self) -> float:
        """What the noise is at most, as far as it is known."""
        return self.noise_floor if self.floor_interval is None else self.floor_interval[1]


@dataclass(frozen=True)
class Gap:
    """Gap = RMSE² − floor² of all outputs (each in units of its spread), before and after.

    Attributes:
        before, after: gaps, summed over outputs.
        noise_floor: floor of all outputs in the same units.
        closed_percent: 100 (1 − after/before).
        interval: 95 % interval of that share (block bootstrap).
        parts: the share closed [%] of each part, by what it is; empty where there is but one.
    """

    before: float
    after: float
    noise_floor: float
    closed_percent: float
    interval: tuple[float, float]
    channels: dict[str, ChannelGap]
    parts: dict[str, float] = field(default_factory=dict)


def measure_gap(
    before: Sequence[Array],
    after: Sequence[Array],
    floor: Array,
    spread: Array,
    names: Sequence[str],
    seed: int = 0,
) -> Gap:
    """The gap on held-out records, from free-run errors (N, ny) before and after.

    Outputs add up by their shares of what was measured, Σ (RMSE² − floor²)/spread², as a fit in per
    cent counts them: one that follows well but for a disturbance weighs little beside one that
    does not follow.

    Errors that are not finite do not count. A floor that held-out errors fall below was none (a
    wave at constant speed passes for noise): what is jagged in those errors themselves is the
    floor then, see ``floor_of_errors``.

    Args:
        floor, spread: noise, and standard deviation of the measurements, of each output, (ny,).
    """
    refined = floor_of_errors(after)
    old, new = np.concatenate(before), np.concatenate(after)
    there = np.isfinite(old) & np.isfinite(new)
    rows = there.any(axis=1)
    # each output counts as if it had a reading in every row: a slow sensor's stand for more
    weight = (there[rows] / np.mean(there[rows], axis=0)).astype(np.float64)
    old, new = (np.where(there[rows], e[rows], 0.0) for e in (old, new))
    reached = np.sqrt(np.mean(weight * new**2, axis=0))
    floor = np.where(reached < REFUTED * floor, np.minimum(refined, reached), floor)
    channels = {
        n: ChannelGap(
            float(np.sqrt(np.mean(weight[:, i] * old[:, i] ** 2))),
            float(np.sqrt(np.mean(weight[:, i] * new[:, i] ** 2))),
            float(floor[i]),
        )
        for i, n in enumerate(names)
    }
    # an output that was at its floor has no gap to close: only its noise would be counted
    open_ = np.mean(weight * old**2, axis=0) > ABOVE * floor**2
    at = np.flatnonzero(open_ if open_.any() else np.ones(len(floor), dtype=bool))
    scale = np.maximum(spread, 1e-300)
    per = weight[:, at] / scale[at] ** 2
    a = np.sum((old[:, at] ** 2 - floor[at] ** 2) * per, axis=1)
    b = np.sum((new[:, at] ** 2 - floor[at] ** 2) * per, axis=1)
    size = max(len(a) // BLOCKS, 5)
    blocks = np.add.reduceat(np.column_stack([a, b]), np.arange(0, len(a), size))
    gap_before, gap_after = max(float(a.mean()), 0.0), float(b.mean())
    closed = 100.0 * (1.0 - gap_after / gap_before) if gap_before > 0 else 0.0
    noise = float(np.sum(floor[at] ** 2 / scale[at] ** 2))
    interval = interval_of_closed(blocks, seed)
    return Gap(gap_before, gap_after, noise, min(closed, 100.0), interval, channels)


def interval_of_closed(blocks: Array, seed: int) -> tuple[float, float]:
    """95 % interval of 100 (1 − after/before) by a bootstrap over blocks of both sums, (n, 2)."""
    drawn = np.random.default_rng(seed).integers(0, len(blocks), (REPLICATES, len(blocks)))
    before, after = blocks[drawn].sum(axis=1).T
    remains = np.divide(after, before, where=before > 0.0, out=np.ones(REPLICATES))
    low, high = np.quantile(np.minimum(100.0 * (1.0 - remains), 100.0), [0.025, 0.975]).tolist()
    return low, high


SPEEDS, PATH = "outputs", "path"
"""Parts of a gap: what the sensors read, and where the robot is."""


def with_path(outputs: Gap, path: Gap) -> Gap:
    """The gap of all outputs and of the path together: each part counts by its channels.

    A channel that was at its floor has no gap. Intervals add as if both parts erred alike.
    """
    parts = {SPEEDS: outputs, PATH: path}
    counts = {name: sum(map(_open, part.channels.values())) for name, part in parts.items()}
    total = sum(counts.values())
    if not total:
        return outputs

    def mean(ends: Sequence[float]) -> float:
        return sum(n * v for n, v in zip(counts.values(), ends, strict=True)) / total

    closed = mean([part.closed_percent for part in parts.values()])
    low, high = (mean([part.interval[k] for part in parts.values()]) for k in (0, 1))
    return Gap(
        float(total),
        total * (1.0 - 0.01 * closed),
        outputs.noise_floor,
        closed,
        (low, high),
        outputs.channels | path.channels,
        {name: part.closed_percent for name, part in parts.items() if counts[name]},
    )


def _open(c: ChannelGap) -> bool:
    return c.rmse_before**2 > ABOVE * c.noise_floor**2


def floor_of_errors(errors: Sequence[Array]) -> Array:
    """Reading noise from what a model leaves, (ny,): third differences over √20, as for
    measurements.

    What a model misses is smooth beside white noise, and what it explains is gone: so this is the
    better estimate where a signal is too quick for ``noise.measurement_noise``. The median absolute
    deviation passes over the samples that are not. Of a slow sensor only fresh measurements count.
    """
    columns = range(errors[0].shape[1])
    fresh = [[e[np.isfinite(e[:, i]), i : i + 1] for e in errors] for i in columns]
    return np.concatenate([white_noise(column) for column in fresh])
