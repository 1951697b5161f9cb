"""Round sample time of stamps that were written with few digits."""

import numpy as np

from sysid.data.record import Array

STAMP_UNITS = (86400.0, 3600.0, 60.0, 1.0)
"""Units of stamps [s] that are longer than a second, or one: shorter ones end in a decimal too."""
COARSEST = 0.2
"""A last digit beyond this share of the sample time is too coarse to find a period."""
MIN_STAMPS = 10
"""Fewer stamps agree with several periods."""


def last_digit(t: Array, dt: float) -> float:
    """The step [s] of the last digit of the stamps t (N,), 0 where they are finer than any.

    Stamps in minutes with four decimals are multiples of 0.006 s: that is seen in seconds too.
    """
    shifted = t - t[0]
    steps = sorted((unit * 10.0**-k for unit in STAMP_UNITS for k in range(10)), reverse=True)
    for step in (s for s in steps if s <= COARSEST * dt):
        counts = shifted / step
        if np.max(np.abs(counts - np.rint(counts))) < 1e-4:
            return step
    return 0.0


def round_period(t: Array, dt: float) -> float:
    """A sample time T of two digits near ``dt`` if every stamp agrees with it to its last digit.

    |t_k − t_0 − n_k T| ≤ q for all k, with n_k whole and q the step of the last digit; else dt.

    Args:
        t: instants [s], (N,).
        dt: their usual or mean step [s].
    """
    period = float(f"{dt:.2g}")
    if len(t) < MIN_STAMPS or period == dt or not period > 0.0:
        return dt
    if abs(period - dt) > COARSEST * dt or np.ptp(np.diff(t)) <= 1e-9 * dt:
        return dt  # steps that are all alike, such as those of whole days, leave nothing to find
    digit = last_digit(t, dt)
    if digit == 0.0 or abs(period - dt) > 1.001 * digit:
        return dt
    off = (t - t[0]) / period
    return period if np.max(np.abs(off - np.rint(off))) * period <= 1.001 * digit else dt
