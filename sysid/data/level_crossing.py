"""When a signal first reaches a level."""

import numpy as np

from sysid.data.record import Array


def first_crossing(t: Array, values: Array, level: float) -> Array:
    """When values first reach a level, between samples on a straight line; infinite if never.

    Args:
        t: instants, (N,).
        values: (N, …).

    Returns:
        An instant for each signal, (…).
    """
    beyond = values >= level
    k = np.argmax(beyond, axis=0)
    before = np.maximum(k - 1, 0)
    low, high = (np.take_along_axis(values, np.asarray(at)[None], 0)[0] for at in (before, k))
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.where(k > 0, (level - low) / (high - low), 0.0)
    instant = t[before] + part * (t[k] - t[before])
    return np.where(beyond.any(axis=0), instant, np.inf)
