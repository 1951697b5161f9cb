"""Start values for a weight over the angle, where the baseline without it follows nothing."""

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import Data
from sysid.effects.base import Effect, Wave

LEAST_ROWS = 10
"""Rows a number of the regression, below which it says nothing."""


def from_changes(model: FullModel, e: Effect, wave: Wave, q: Array, data: Data) -> Array | None:
    """Core and weight by one regression of the measured speed's changes; None where it fails.

    A weight that holds the shaft leaves a baseline nearly no gain, and no wave shows in errors of
    a run that goes elsewhere. F(q) ω = B(q) K d − F(1) (a cos θ + b sin θ) is linear in all of
    them, with θ counted from the measurements.

    Args:
        wave: that of the law, a torque.
        q: parameters of the model without it, (parameters,).
    """
    row, n = q.copy(), model.order
    for i in range(model.tracks):
        rows, rights = [], []
        columns = (data.drive, data.y, data.weight, data.counted)
        line = model.parameters[model.index[e.id, wave.line, i]].null
        for d, y, weight, turned in zip(*(data.split(x[:, i]) for x in columns), strict=True):
            k = np.arange(n - 1, len(y) - 1)
            if len(k) == 0:
                continue
            k = k[np.min([weight[k + 1 - j] for j in range(n + 1)], axis=0) > 0.0]
            angle = line * (turned[k] + 0.5 * model.dt * y[k])
            past = [y[k - j] for j in range(n)] + [d[k - j] for j in range(n)]
            rows.append(np.column_stack([*past, np.cos(angle), np.sin(angle)]))
            rights.append(y[k + 1])
        if sum(map(len, rights)) < LEAST_ROWS * (2 * n + 2):
            return None
        theta = np.linalg.lstsq(np.concatenate(rows), np.concatenate(rights), rcond=None)[0]
        f = -theta[:n]
        size = 1.0 + float(f.sum())
        if not size > 1e-9 or np.any(np.abs(np.roots([1.0, *f])) >= 1.0):
            return None
        model.set_core(row, i, float(theta[n : 2 * n].sum()) / size, f)
        for name, value in zip((wave.cosine, wave.sine), -theta[2 * n :] / size, strict=True):
            row[model.index[e.id, name, i]] = model.parameters[model.index[e.id, name, i]].within(
                float(value)
            )
    return row
