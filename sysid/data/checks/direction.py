"""Which way two signals go: does a column act on an output, or follow it?

Linear feedback in each direction (Geweke 1982), of means c, y, u over blocks and their P lags:

    F(c → y) = ln σ²(y | past y, u) − ln σ²(y | past y, u, past c and c·u)
    F(y, u → c) = ln σ²(c | past c) − ln σ²(c | past c, past y, u)

A current, an acceleration, a second sensor or what lies downstream follows inputs and output: its
F(y, u → c) is the larger one. The weather and a set pressure act: nothing of these says anything of
them.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import fdtrc

from sysid.data.impulse import least_squares
from sysid.data.record import Array, Record, block_means

P = 3
"""Lags of each signal, in blocks."""

CLEARLY = 2.0
"""A column acts where it says so many times more of the output than is said of it."""

CHANCE = 1e-3
"""Level at which it says anything."""


def acts_on(parts: Sequence[tuple[Array, Array, Array]], rows: int) -> bool:
    """Whether a column acts on an output rather than follows it.

    Args:
        parts: column (N,), output (N,) and inputs (N, nu) of each record.
        rows: length of the blocks [samples]; a quarter of the output's time constant shows most.
    """
    if not all(np.isfinite(column).all() for column, _, _ in parts):
        return False
    stacked = [_lags(*(block_means(x, rows) for x in part)) for part in parts]
    stacked = [s for s in stacked if s]
    if not stacked:
        return False
    y, c, past_y, past_c, u, product = map(np.vstack, zip(*stacked, strict=True))
    one = np.ones_like(y)
    of_y, chance = _gain(y, np.hstack([one, past_y, u]), np.hstack([past_c, product]))
    of_c, _ = _gain(c, np.hstack([one, past_c]), np.hstack([past_y, u]))
    return chance < CHANCE and of_y > CLEARLY * of_c


def acting_columns(records: Sequence[Record], j: int, rows: int) -> tuple[int, ...]:
    """Unused columns, which all of the records hold, that act on output j.

    Args:
        rows: as ``acts_on`` takes them.
    """
    names = records[0].unused_names
    parts = [
        (r.unused, r.y[:, j], r.u)
        for r in records
        if r.unused is not None and r.unused_names == names
    ]
    if len(parts) < len(records):
        return ()
    found = ([(c[:, k], y, u) for c, y, u in parts] for k in range(len(names)))
    return tuple(k for k, columns in enumerate(found) if acts_on(columns, rows))


def _lags(c: Array, y: Array, u: Array) -> tuple[Array, ...]:
    """y, c, their lags, those of u from now on, and c·u, (n − P, …)."""
    if len(y) <= P:
        return ()
    past = [np.hstack([x[P - k : len(x) - k] for k in range(P + 1)]) for x in (y, c, u)]
    product = [c[P - k : len(c) - k] * u[P - k : len(u) - k] for k in (0, 1)]
    of_y, of_c, of_u = past
    return of_y[:, :1], of_c[:, :1], of_y[:, 1:], of_c[:, 1:], of_u, np.hstack(product)


def _gain(target: Array, own: Array, other: Array) -> tuple[float, float]:
    """ln of the ratio of squared errors without and with others, and its p value."""
    without, left = (
        float(np.sum(least_squares(X, target)[1] ** 2)) for X in (own, np.hstack([own, other]))
    )
    free = len(target) - own.shape[1] - other.shape[1]
    if free <= 0 or left <= 0.0:
        return 0.0, 1.0
    q = other.shape[1]
    chance = float(fdtrc(q, free, max(without - left, 0.0) / q / (left / free)))
    return float(np.log(without / left)), chance
