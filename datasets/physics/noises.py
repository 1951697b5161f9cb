"""Noise of readings and loads: arrays of shape (N, channels), made before the run, from a seed."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AR_TIME = 0.3
"""Correlation time of coloured noise [s]."""

HEAVY = 3.0
"""Degrees of freedom of Student's t: one reading in a hundred is beyond 2.6 σ, some beyond 8."""


def white(rng: np.random.Generator, shape: tuple[int, int], dt: float) -> Array:
    """Independent, normal."""
    return rng.standard_normal(shape)


def coloured(rng: np.random.Generator, shape: tuple[int, int], dt: float) -> Array:
    """First-order autoregressive with the correlation time ``AR_TIME``."""
    pole = float(np.exp(-dt / AR_TIME))
    shocks = rng.standard_normal(shape) * np.sqrt(1.0 - pole**2)
    shocks[0] /= np.sqrt(1.0 - pole**2)
    out = np.empty(shape)
    last = np.zeros(shape[1])
    for k, shock in enumerate(shocks):
        last = pole * last + shock
        out[k] = last
    return out


def heavy(rng: np.random.Generator, shape: tuple[int, int], dt: float) -> Array:
    """Student's t, scaled to unit variance."""
    return rng.standard_t(HEAVY, shape) / np.sqrt(HEAVY / (HEAVY - 2.0))


def walk(rng: np.random.Generator, rows: int, channels: int) -> Array:
    """A random walk that has a standard deviation of 1 at the end."""
    return np.cumsum(rng.standard_normal((rows, channels)), axis=0) / np.sqrt(rows)


NOISES: dict[str, Callable[[np.random.Generator, tuple[int, int], float], Array]] = {
    "white": white,
    "coloured": coloured,
    "heavy": heavy,
}
