"""Starting values of statics: the identity over a signal's range, or the shape of another one."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.record import Array
from sysid.structures.blocks.static.functions import Static
from sysid.structures.blocks.static.kinds import KINDS, Stage

PLACES = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
"""Places of limits tried, as fractions of the range of a signal."""

SHAPE_POINTS = 2000
"""Samples that suffice to compare the shapes of two statics."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A static that follows another one: gain·static(x) + offset ≈ target.

    Attributes:
        static: with the abscissae of splines read off the data.
        gain: what it is multiplied by; 1 where it has a gain of its own.
        offset: what is added; 0 where it can add it itself.
    """

    static: Static
    p: Array
    gain: float
    offset: float


def identity_start(static: Static, low: float, high: float) -> tuple[Static, Array]:
    """The static and parameters with which it hardly does anything on low … high.

    Limits stand near the ends of the range (a dead zone is narrow), points on the identity line;
    an absolute value has its kink at 0.
    """
    stages, parts = [], []
    for stage in static.stages:
        placed, p, low, high = _stage_identity(stage, low, high)
        stages.append(placed)
        parts.append(p)
    return Static(tuple(stages)), np.concatenate([*parts, np.zeros(0)])


def _stage_identity(stage: Stage, low: float, high: float) -> tuple[Stage, Array, float, float]:
    width = max(high - low, 1e-12)
    middle = min(max(0.0, low + 0.1 * width), high - 0.1 * width)
    if stage.kind == "abs":
        return stage, np.zeros(1), 0.0, max(abs(low), abs(high))
    if stage.kind == "polynomial":
        return stage, np.eye(stage.size)[0], low, high
    if stage.kind in ("piecewise", "spline"):
        points = np.linspace(low, high, stage.size)
        if stage.kind == "piecewise":
            return stage, np.concatenate([points, points]), low, high
        return replace(stage, knots=tuple(points.tolist())), points, low, high
    ends = (low, high) if stage.kind.startswith("saturation") else (middle, middle)
    inward = 0.02 if stage.kind.startswith("saturation") else -0.02
    sides = {"low": ends[0] + inward * width, "high": ends[1] - inward * width}
    p = np.array([sides[n.partition("_")[2]] for n in stage.names])
    low, high = stage.value(np.array([low, high]), p).tolist()
    return stage, p, low, high


def shaped(static: Static, x: Array, target: Array, *, upright: bool = True) -> Shape:
    """The static's parameters with which it follows ``target`` over the samples x best.

    Limits are tried on a grid, stage by stage; what enters linearly is found by least squares.

    Args:
        static: the kind to take the shape.
        x, target: samples of the shape.
        upright: whether the gain must be positive: that of a last static goes into its argument.
    """
    if len(x) > SHAPE_POINTS:
        pick = np.linspace(0, len(x) - 1, SHAPE_POINTS).astype(int)
        x, target = x[pick], target[pick]
    placed, start = identity_start(static, float(x.min()), float(x.max()))
    best = _followed(placed, start, x, target, upright)
    for k, stage in enumerate(placed.stages):
        if stage.size:
            continue
        # limits of one stage after the other, where those before it have been put
        before = Static(placed.stages[:k])
        p = best[1].p
        enters = before.value(x, p[: before.n])
        for limits in _other_limits(stage, float(enters.min()), float(enters.max())):
            q = p.copy()
            q[before.n : before.n + len(limits)] = limits
            trial = _followed(placed, q, x, target, upright)
            if trial[0] < best[0]:
                best = trial
    return best[1]


def _other_limits(stage: Stage, low: float, high: float) -> Iterator[list[float]]:
    """Limits or kinks of a stage on a grid over what enters it."""
    places = [low + f * (high - low) for f in PLACES]
    if len(stage.names) == 1:
        yield from ([a] for a in places[1:-1])
    elif KINDS[stage.kind].ordered(stage.size) == 2:
        for k, a in enumerate(places):
            yield from ([a, b] for b in places[k + 1 :])


def _followed(
    static: Static, p: Array, x: Array, target: Array, upright: bool
) -> tuple[float, Shape]:
    """Least squares of what enters linearly: (sum of squares, shape)."""
    value, _, partials = static.evaluated(x, p)
    linear = _linear_entries(static)
    columns = partials[linear] if len(linear) else value[None]
    if not static.has_offset:
        columns = np.concatenate([columns, np.ones((1, len(x)))])
    scale = np.sqrt(np.mean(columns**2, axis=1))
    scale[scale == 0.0] = 1.0
    # points without data stay where the others put them: the smallest change from the start
    now = p[linear] if len(linear) else np.ones(1)
    now = now if static.has_offset else np.append(now, 0.0)
    rest = target - now @ columns
    followed = now + np.linalg.lstsq((columns / scale[:, None]).T, rest, rcond=1e-6)[0] / scale
    e = target - followed @ columns
    cost = float(e @ e)
    offset = 0.0 if static.has_offset else float(followed[-1])
    if len(linear):
        out = p.copy()
        out[linear] = followed[: len(linear)]
        return cost, Shape(static, out, 1.0, offset)
    gain = float(followed[0])
    if gain == 0.0 or (upright and gain < 0.0):
        return np.inf, Shape(static, p, 1.0, offset)
    return cost, Shape(static, p, gain, offset)


def _linear_entries(static: Static) -> Array:
    """Parameters of the last stage that enter linearly."""
    if not static.stages:
        return np.zeros(0, dtype=int)
    last, place = static.stages[-1], static.slices()[-1]
    if not KINDS[last.kind].has_gain:
        return np.zeros(0, dtype=int)
    return np.arange(place.stop - last.size, place.stop)
