"""Long signals thinned for drawing: no peak is lost and the file stays small."""

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array

NDArrayBool = NDArray[np.bool_]


def envelope(t: Array, y: Array, bins: int) -> tuple[Array, Array]:
    """Keep the smallest and the largest sample of each of ``bins`` equal stretches.

    A stroke through these points covers the same pixels as one through all samples when a bin is
    no wider than a pixel. Stretches without a finite sample give a NaN, which breaks the stroke.

    Args:
        t: sample instants, shape (N,).
        y: the signal, shape (N,); values that are not finite count as missing.
        bins: number of stretches, at least 1.

    Returns:
        Instants and values in time order, at most ``2 * bins`` of them; the signal itself
        (missing values as NaN) when it is no longer than that.
    """
    missing = ~np.isfinite(y)
    n, bins = len(y), max(bins, 1)
    if n <= 2 * bins:
        return t, np.where(missing, np.nan, y)
    size = -(-n // bins)
    bins = -(-n // size)
    low = np.full(bins * size, np.inf)
    high = np.full(bins * size, -np.inf)
    low[:n] = np.where(missing, np.inf, y)
    high[:n] = np.where(missing, -np.inf, y)
    start = size * np.arange(bins)
    picks = np.stack(
        [low.reshape(bins, size).argmin(axis=1), high.reshape(bins, size).argmax(axis=1)], axis=1
    )
    index = (np.sort(picks, axis=1) + start[:, None]).ravel()
    values = y[index]
    return t[index], np.where(np.isfinite(values), values, np.nan)


def isolated(y: Array) -> NDArrayBool:
    """Mark the finite samples without a finite neighbour: a stroke alone would not show them."""
    finite = np.isfinite(y)
    before = np.concatenate([[False], finite[:-1]])
    after = np.concatenate([finite[1:], [False]])
    lonely: NDArrayBool = finite & ~before & ~after
    return lonely
