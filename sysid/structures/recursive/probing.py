"""Inputs that probe a free run for running away."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array

HOLDS = (1, 3, 10, 40)
"""Samples for which the random two-level inputs keep a level: fast and slow."""


def probes(ranges: Sequence[tuple[float, float]], length: int) -> Array:
    """Inputs that fill their ranges: two-level, fast and slow, and both ends held, (N, nu, 6)."""
    rng = np.random.default_rng(0)
    low, high = np.array(ranges).reshape(-1, 2).T
    u = np.empty((length, len(ranges), len(HOLDS) + 2))
    for k, hold in enumerate(HOLDS):
        levels = rng.integers(0, 2, (length, len(ranges)))
        u[:, :, k] = low + (high - low) * np.repeat(levels, hold, axis=0)[:length]
    u[:, :, -2], u[:, :, -1] = low, high
    return u
