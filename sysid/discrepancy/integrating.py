"""Outputs that integrate, such as the position of an axis: the chain is then held to their rate."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import Array, Channel, Record

LAGS = 3
"""Order of the difference equation whose slowest pole tells."""

MOST_SAMPLES = 3000
"""Rates are taken over several samples where a log has more: differences amplify noise."""

FOLLOWS = 0.5
"""An output that correlates more with its input follows it and does not integrate it."""

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


def step_of(records: Sequence[Record]) -> int:
    """Samples over which rates are taken."""
    return max(max(len(r) for r in records) // MOST_SAMPLES, 1)


def rates(records: Sequence[Record], step: int) -> tuple[Record, ...]:
    """The logs with the rate of the output in its place, one every ``step`` samples.

    ẏ(t_k) = (y(t_{k+1}) − y(t_{k−1}))/(2Δ), u averaged over the step that follows t_k.
    """
    found = []
    for r in records:
        n = len(r) // step
        u = r.u[: n * step].reshape(n, step, r.nu).mean(axis=1)
        y = r.y[: n * step : step]
        rate = (y[2:] - y[:-2]) / (2.0 * step * r.dt)
        outputs = tuple(
            Channel(f"{c.name}_rate", f"{c.unit}/s" if c.unit else "") for c in r.outputs
        )
        found.append(
            replace(
                r,
                u=u[1:-1],
                y=rate,
                dt=step * r.dt,
                outputs=outputs,
                pose=None,
                t0=r.t0 + step * r.dt,
            )
        )
    return tuple(found)


def _coarse(record: Record, samples: int) -> tuple[Array, Array]:
    step = max(len(record) // samples, 1)
    n = len(record) // step
    u = record.u[: n * step, 0].reshape(n, step).mean(axis=1)
    return u - u.mean(), record.y[: n * step : step, 0]
