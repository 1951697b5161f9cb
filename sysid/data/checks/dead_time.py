"""Dead times with intervals: the delays that a regression saw, refined by a process model.

A regression on lags sees a second small lag as delay, and lends a slow input the delay of a quick
one. A model of two lags and a continuous dead time for every input (``process.py``) does neither;
it is believed where it predicts nearly as well as a long regression.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.checks.delay import Delay
from sysid.data.impulse import long_regression
from sysid.data.process import ProcessFit, fit_process
from sysid.data.record import Record
from sysid.data.speed import Speed
from sysid.errors import DataError

BELIEVED = 1.1
"""Variance of the errors, over that of a long regression, up to which the process is believed."""

ORDER = 8
"""Lags of that regression."""

WIDTH = 2.6
"""Standard errors to either side: 99 %."""

LAGS = (3.0, 12.0, 48.0)
"""Sums of lags [samples] to start from where the speed of an output is unknown."""

MOST_INPUTS = 6
"""Inputs up to which the search is worth its time."""

PLAIN = 1
"""The delay of a plant without dead time, and of one that nothing shows to respond at once."""


def refined_delays(
    delays: Sequence[Delay], processes: Sequence[ProcessFit | None], dt: float, shortest: int
) -> tuple[Delay, ...]:
    """The delays with intervals of the process of each output, where there is one.

    Args:
        delays: of every pair, output by output.
        dt: sample time [s].
        shortest: 1 where a response within the sample is known to be a controller's, else 0.
    """
    inputs = len(delays) // max(len(processes), 1)
    refined: list[Delay] = []
    for k, d in enumerate(delays):
        fit = processes[k // inputs]
        if fit is not None:
            refined.append(_refined(d, fit, k % inputs, dt, shortest))
        else:
            unsure = d.delay is not None and d.low <= PLAIN < d.delay
            refined.append(replace(d, delay=PLAIN) if unsure else d)
    return tuple(refined)


def process_of(
    records: Sequence[Record], j: int, row: Sequence[Delay], speed: Speed
) -> ProcessFit | None:
    """The process of output j from its delays on, None where it is not believed.

    Args:
        row: the delays of all inputs to this output.
        speed: of this output.
    """
    if not 0 < len(row) <= MOST_INPUTS or all(d.delay is None for d in row):
        return None
    seen = [float(PLAIN if d.delay is None else d.delay) for d in row]
    plain = [float(PLAIN)] * len(row)
    starts = [seen, plain]
    if len(row) > 1:
        starts += [[*seen[:i], plain[i], *seen[i + 1 :]] for i in range(len(row))]
    unique = list(dict.fromkeys(map(tuple, starts)))
    quick = LAGS if not speed.time_constant else None
    samples = (speed.time_constant or 0.0) / records[0].dt
    lags = quick or (max(samples, 0.5), max(samples - max(seen), samples / 4.0, 0.5))
    fit = fit_process(records, j, unique, tuple(dict.fromkeys(lags)))
    if fit is None:
        return None
    far = [round(x) + k for x in fit.dead for k in (-1, 0, 1, 2) if round(x) + k > ORDER]
    alone = [r.select(r.input_names, [r.output_names[j]]) for r in records]
    try:
        long = long_regression(alone, ORDER, min(PLAIN, round(min(fit.dead))), ORDER, far)
    except (DataError, IndexError):
        return None
    return fit if fit.variance <= BELIEVED * float(long.variance[0]) else None


def _refined(d: Delay, fit: ProcessFit, i: int, dt: float, shortest: int) -> Delay:
    if d.delay is None:
        return d
    late, error = float(fit.dead[i]), float(fit.dead_error[i])
    dead = late - fit.held(i) + PLAIN
    low, high = (
        max(int(np.ceil(dead + side * WIDTH * error - 0.5)), shortest) for side in (-1.0, 1.0)
    )
    delay = max(int(np.ceil(dead - 0.5)), shortest)
    if late - WIDTH * error <= PLAIN <= high:
        delay = PLAIN  # no dead time where none is shown
    seconds = max(dead - PLAIN, 0.0) * dt
    return replace(d, delay=delay, low=low, high=high, dead_s=seconds, error_s=error * dt)
