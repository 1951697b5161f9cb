"""Probe equations: do they stay near their data under similar inputs?"""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array
from sysid.structures.difference_equations.free_run import FreeRun, Limits

PROBE = 400
"""Samples of a probing run: long enough for what runs away to get away."""

HOLDS = (1, 3, 10, 40)
"""Samples for which the random two-level inputs keep a level."""


def stays_near(
    run: FreeRun, theta: Array, input_range: Limits, input_step: Sequence[float] | None = None
) -> bool:
    """Whether free runs from rest under probing inputs stay inside the limits of ``run``.

    The inputs are random two-level ones, fast and slow, and the two ends of the range held.

    Args:
        run: the equations, their limits set to what counts as running away.
        input_range: lowest and highest value of each input.
        input_step: largest change of each input from one sample to the next; any where None.
    """
    u = probing_inputs(input_range, run.before + PROBE)
    if input_step is not None:
        _slow_down(u, input_range, np.asarray(input_step, dtype=np.float64))
    outputs = run.driven(theta, u, np.zeros((run.depth, run.ny, u.shape[2])))
    ends = np.array(run.limits)
    return bool(np.all((outputs > ends[:, :1]) & (outputs < ends[:, 1:])))


def probing_inputs(input_range: Sequence[tuple[float, float]], length: int) -> Array:
    """Inputs that fill their ranges: two-level, fast and slow, and both ends held, (N, nu, 6)."""
    rng = np.random.default_rng(0)
    low, high = np.array(input_range).reshape(-1, 2).T
    u = np.empty((length, len(low), len(HOLDS) + 2))
    for k, hold in enumerate(HOLDS):
        levels = rng.integers(0, 2, (length, len(low)))
        u[:, :, k] = low + (high - low) * np.repeat(levels, hold, axis=0)[:length]
    u[:, :, -2], u[:, :, -1] = low, high
    return u


def _slow_down(u: Array, input_range: Limits, step: Array) -> None:
    """Limit the changes of probing inputs in place; they begin as near to zero as they may."""
    low, high = np.array(input_range).reshape(-1, 2).T
    u[0] = np.clip(0.0, low, high)[:, None]
    for t in range(1, len(u)):
        u[t] = u[t - 1] + np.clip(u[t] - u[t - 1], -step[:, None], step[:, None])
