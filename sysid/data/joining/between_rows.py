"""Values of a second file between its rows: measurements interpolated, commands held."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sysid.data.column_words import is_wheel_speed, meaning
from sysid.data.record import Array

SPARSE = 3.0
"""A file of events has rows so many times further apart than the log's: what is written at every
row or two of the log is sampled."""

UNEVEN = 3.0
"""… and its longer steps (90 % quantile) are so many times its shorter ones (10 %): jitter and a
lost row or two stay below two."""

STILL = 0.9
"""A column that repeats its last value in so many of its rows stands still between changes."""

SLACK = 0.02
"""A row within so much of a row of the log counts for it: stamps are rounded when written."""


def held_at(t: Array, at: Array, values: Array) -> tuple[Array, NDArray[np.bool_]]:
    """y(t) = the last value with at ≤ t; empty cells leave the value before them.

    Args:
        t: instants of the log [s], (N,).
        at: instants of the values [s], rising, (M,).
        values: (M,), NaN in empty cells.

    Returns:
        y, (N,), 0 where there is none; and where there is one, (N,).
    """
    there = np.isfinite(values)
    slack = SLACK * float(np.median(np.diff(t)))
    k = np.searchsorted(at[there], t + slack, side="right") - 1
    return np.where(k >= 0, values[there][np.maximum(k, 0)], 0.0), k >= 0


def spanned(t: Array, at: Array, longest: float) -> NDArray[np.bool_]:
    """Which instants t (N,) lie between two of ``at`` (M,), rising, that are no further apart."""
    after = np.searchsorted(at, t, side="right")
    gap = np.diff(at)[np.clip(after - 1, 0, len(at) - 2)]
    return np.asarray((after > 0) & (after < len(at)) & (gap <= longest))


def is_event_log(t: Array, at: Array) -> bool:
    """Whether a file beside a log is written when something happens, not at a steady rate.

    Args:
        t: instants of the log [s], (N,).
        at: instants of the file [s], rising, (M,).
    """
    if len(at) < 3 or len(t) < 2:
        return len(at) > 0 and len(t) > 1
    step = np.diff(at)
    short, usual, long = np.quantile(step, (0.1, 0.5, 0.9))
    return bool(usual > SPARSE * np.median(np.diff(t)) and long > UNEVEN * short)


def zero_order_hold_names(columns: Mapping[str, Array], by_events: bool) -> tuple[str, ...]:
    """The columns that keep their value until the next row: all of a file of events, else
    commands, set points and what stands still in most rows.

    Args:
        columns: name → values in the order of time, (M,).
        by_events: whether the file is written when something happens.
    """
    return tuple(n for n, values in columns.items() if by_events or _is_held(n, values))


def _is_held(name: str, values: Array) -> bool:
    if meaning(name).quantity in ("command", "reference"):
        return True
    if is_wheel_speed(name, ""):
        return False  # a wheel at rest stands still too, and it does not step when it starts
    return len(values) > 1 and float(np.mean(np.diff(values) == 0.0)) >= STILL
