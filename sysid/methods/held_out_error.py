"""Free-run error on held-out samples, which chooses orders and structures."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.noise import ROBUST
from sysid.data.record import Array, Record
from sysid.structures.base import Structure
from sysid.structures.motion import initial_state_window

OUTLYING = 3.0
"""Errors beyond this many (robust) standard deviations are outliers to a robust score."""


def free_run_error(
    s: Structure,
    theta: Array,
    records: Sequence[Record],
    counted: Sequence[NDArray[np.bool_]],
    robust: bool = False,
    *,
    one_step: bool = False,
) -> float:
    """Root mean square over the outputs of free-run error relative to the output's spread.

    The run goes through each whole record; only the samples ``counted``, (N,) by record, matter.
    With ``one_step`` it is the one-step error. In a closed loop the input holds a part of the
    noise, and a free run errs least, on held-out samples of the same loop too, where the model
    takes that part for the plant's answer; one-step errors are least for the plant itself, if the
    noise is modelled as well (Ljung 1999, §13.4).
    With ``robust`` errors beyond OUTLYING times the usual one count no more than that, because a
    handful of outliers would drown every difference between models.
    """
    window = initial_state_window(s, theta)
    parts = []
    measured = []
    with np.errstate(over="ignore", invalid="ignore"):
        for r, samples in zip(records, counted, strict=True):
            if one_step or not s.nu:  # nothing drives it: how far ahead it sees is one step
                e = s.errors(theta, r.u, r.y, window)
                samples = samples & ~np.isnan(e).any(axis=1)
            else:
                e = r.y - s.simulate(theta, r.u, s.fitted_state(theta, r.u, r.y, window))
            parts.append(e[samples])
            measured.append(r.y[samples])
    return relative_error(np.concatenate(parts), np.concatenate(measured), robust)


def relative_error(errors: Array, measured: Array, robust: bool = False) -> float:
    """Root mean square over the outputs of errors (N, ny) relative to the output's spread."""
    if not len(measured):
        return float("inf")
    with np.errstate(over="ignore", invalid="ignore"):
        if robust:
            limit = OUTLYING * ROBUST * np.median(np.abs(errors), axis=0)
            errors = np.clip(errors, -limit, limit)
        square = np.sum(errors**2, axis=0)
    spread_square = np.sum((measured - measured.mean(axis=0)) ** 2, axis=0)
    moving = spread_square > 0
    if not moving.any():
        return float("inf")
    relative = float(np.sqrt(np.mean(square[moving] / spread_square[moving])))
    return relative if np.isfinite(relative) else float("inf")
