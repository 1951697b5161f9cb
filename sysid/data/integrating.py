"""Test whether an output integrates its input, as a position does."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array, Record

LAGS = 3
"""Order of the difference equation whose slowest pole decides."""

FOLLOWS = 0.5
"""An output that correlates more with its input follows it and does not integrate it."""

POSITIONS = ("rad", "m")
"""Units of positions; what is written in degrees, turns, counts or millimetres is read in these."""

FOREVER = 0.5
"""A time constant longer than this share of the record is an integrator's."""


def integrates(records: Sequence[Record]) -> bool:
    """Whether some output of a single-track log drifts for ever under a constant input.

    A difference equation A y = B u + c is fitted by least squares to coarse samples; its slowest
    pole is that of an integrator when it forgets over longer than half the record.
    """
    first = records[0]
    if first.ny != 1 or first.nu != 1 or first.is_robot_log:
        return False
    coarse = [_coarse(r, 400) for r in records]
    if any(abs(np.corrcoef(u, y)[0, 1]) > FOLLOWS for u, y in coarse if np.ptp(u) and np.ptp(y)):
        return False
    rows, rights = [], []
    for u, y in coarse:
        n = len(y)
        if n < 4 * LAGS:
            return False
        columns = [-y[LAGS - k : n - k] for k in range(1, LAGS + 1)]
        columns += [u[LAGS - k : n - k] for k in range(1, LAGS + 1)]
        rows.append(np.array([*columns, np.ones(n - LAGS)]).T)
        rights.append(y[LAGS:])
    X, right = np.concatenate(rows), np.concatenate(rights)
    scale = np.sqrt(np.mean(X**2, axis=0)) + 1e-300
    theta = np.linalg.lstsq(X / scale, right, rcond=None)[0] / scale
    poles = np.roots([1.0, *theta[:LAGS]])
    slowest = poles[int(np.argmax(np.abs(poles)))]
    length = min(len(y) for _, y in coarse)
    forgets = -1.0 / np.log(min(abs(slowest), 1.0 - 1e-12))
    return bool(abs(slowest.imag) < 1e-6 and slowest.real > 0.0 and forgets > FOREVER * length)


def is_position(records: Sequence[Record], output: int) -> bool:
    """Whether an output is a position: by its unit, or where that is unknown by its measurements.

    Args:
        records: a motor an output, each with the input of its own number.
        output: which one.
    """
    channel = records[0].outputs[output]
    if channel.unit:
        return channel.unit in POSITIONS
    motors = [
        r.select(r.input_names[output : output + 1], r.output_names[output : output + 1])
        for r in records
    ]
    return integrates(motors)


def _coarse(record: Record, samples: int) -> tuple[Array, Array]:
    step = max(len(record) // samples, 1)
    n = len(record) // step
    u = record.u[: n * step, 0].reshape(n, step).mean(axis=1)
    return u - u.mean(), record.y[: n * step : step, 0]
