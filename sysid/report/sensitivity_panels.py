"""When a log shows its parameters: the inputs, and when the information on each has come in."""

import numpy as np

from sysid.data.record import Record
from sysid.estimation.information.sensitivity import MOST, Sensitivity
from sysid.report.panels import Curve, Panel, Panels


def sensitivity_panels(found: Sensitivity, record: Record) -> Panels:
    """The inputs over time, and when each parameter shows."""
    inputs = tuple(
        Curve(c.name, record.t, u, kind="steps", colour=k)
        for k, (c, u) in enumerate(zip(record.inputs, record.u.T, strict=True))
    )
    shown = [(p, p.when) for p in found.parameters if p.when is not None]
    names = tuple(f"{p.name} ± {196 * p.relative:.2g} %" if p.value else p.name for p, _ in shown)
    low, high = np.array([when for _, when in shown]).reshape(-1, 2).T
    within = Curve("", np.arange(float(len(shown))), 0.5 * (low + high), low, high, kind="dots")
    return (
        Panel("inputs", "Inputs", "time [s]", "", inputs),
        Panel("information", f"Time with {100 * MOST:.0f} % of its information", "time [s]", "",
              (within,), names=names, large=True),
    )  # fmt: skip
