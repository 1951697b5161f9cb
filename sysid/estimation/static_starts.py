"""Starting values of statics: the identity over the signal's range, or the best limits of a grid."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array
from sysid.structures.static import Stage, Static

LIMITS = (0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.0)
"""Places of limits tried, as fractions of the range of a signal."""


def identity_start(static: Static, low: float, high: float) -> tuple[Static, Array]:
    """The static and parameters with which it hardly does anything on low … high.

    Limits stand at the ends of the range (a dead zone is empty), points on the identity line; an
    absolute value has its kink at 0.
    """
    stages, parts = [], []
    for stage in static.stages:
        stage, p, low, high = _stage_identity(stage, low, high)
        stages.append(stage)
        parts.append(p)
    return Static(tuple(stages)), np.concatenate([*parts, np.zeros(0)])


def _stage_identity(stage: Stage, low: float, high: float) -> tuple[Stage, Array, float, float]:
    width = max(high - low, 1e-12)
    inner = {"low": low + 0.02 * width, "high": high - 0.02 * width}
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
    if stage.kind.startswith("saturation"):
        return stage, np.array([inner[n.partition("_")[2]] for n in stage.names]), low, high
    sides = {"low": middle - 0.02 * width, "high": middle + 0.02 * width}
    return stage, np.array([sides[n.partition("_")[2]] for n in stage.names]), low, high


def limit_grid(static: Static, low: float, high: float) -> Iterator[Array]:
    """Parameters with the first stage's limits at places of a grid over the range.

    Nothing where the first stage has no limits.
    """
    if not static.stages or not static.stages[0].names[0].startswith(("d_", "s_")):
        return
    _, start = identity_start(static, low, high)
    names = static.stages[0].names
    places = [low + f * (high - low) for f in LIMITS]
    for a in places[:-1] if len(names) == 2 else places[1:-1]:
        for b in [t for t in places if t > a] if len(names) == 2 else [a]:
            p = start.copy()
            p[: len(names)] = [a, b][: len(names)]
            if len(names) == 2 or not (a == low or a == high):
                yield p


def ranges(signals: Sequence[Array]) -> tuple[float, float]:
    """Lowest and highest value of one signal over all experiments."""
    return float(min(s.min() for s in signals)), float(max(s.max() for s in signals))
