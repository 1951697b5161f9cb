"""Start values for a weight over the angle, where the baseline without it follows nothing."""

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.motion_equations import Motion, counted_rows, motion_equation
from sysid.diagnosis.search.prepared import Data
from sysid.effects.base import Effect, Wave


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
        turning = []
        columns = (data.drive, data.y, data.weight, data.counted)
        line = model.parameters[model.index[e.id, wave.line, i]].null
        for d, y, weight, turned in zip(*(data.split(x[:, i]) for x in columns), strict=True):
            at = np.arange(n - 1, len(y) - 1)
            at = at[counted_rows(weight, at, n)]
            angle = line * (turned[at] + 0.5 * model.dt * y[at])
            turning.append(Motion(y, d, at, (np.cos(angle), np.sin(angle))))
        equation = motion_equation(turning, n)
        core = None if equation is None else equation.core
        if core is None:
            return None
        gain, f, weights = core
        model.set_core(row, i, gain, f)
        for name, value in zip((wave.cosine, wave.sine), -weights, strict=True):
            k = model.index[e.id, name, i]
            row[k] = model.parameters[k].within(float(value))
    return row
