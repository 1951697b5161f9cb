"""Probing a polynomial equation: does it stay near its data under inputs like those it has seen?"""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array
from sysid.structures.narmax.runs import FreeRun
from sysid.structures.recursive.monomials import Term
from sysid.structures.recursive.probing import probes
from sysid.structures.recursive.single_values import Limits

RUNAWAY = 1.0
"""Range widths beyond the training range from which a probe counts as running away."""

PROBE = 400


def widened(ranges: Limits, margin: float) -> Limits:
    """Each range with ``margin`` times its width added on either side."""
    return tuple(
        (low - margin * (high - low), high + margin * (high - low)) for low, high in ranges
    )


def stays_near(
    rows: Sequence[Sequence[Term]],
    theta: Array,
    output_range: Limits,
    input_range: Limits,
    input_step: Sequence[float],
) -> bool:
    """Whether free runs from rest under probing inputs stay within a range's width of the data.

    The inputs are random two-level ones, fast and slow, and the two ends of the range held; they
    fill the range but change no faster than ``input_step`` a sample.

    Args:
        rows: terms of each output.
        theta: their coefficients.
        output_range: lowest and highest value of each output in the data.
        input_range: the same of each input.
        input_step: largest change of each input from one sample to the next.
    """
    run = FreeRun(rows, len(input_range), widened(output_range, RUNAWAY))
    low, high = np.array(input_range).reshape(-1, 2).T
    u = probes(input_range, run.before + PROBE)
    step = np.asarray(input_step, dtype=np.float64)[:, None]
    u[0] = np.clip(0.0, low, high)[:, None]
    for t in range(1, len(u)):
        u[t] = u[t - 1] + np.clip(u[t] - u[t - 1], -step, step)
    weights = run.weights(theta, run.input_products(u))
    found = run.runs(weights, np.zeros((run.depth, run.ny, u.shape[2])))[run.depth :]
    ends = np.array(run.limits)
    return bool(np.all((found > ends[:, :1]) & (found < ends[:, 1:])))
