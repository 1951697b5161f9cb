"""A forecast as panels: the log before it, the forecast with its band, what came after."""

import numpy as np

from sysid.estimation.assessment.forecast import Forecast
from sysid.report.panels import Curve, Panel, Panels
from sysid.report.style import labelled

BEFORE = 1.0
"""Of the log so much is shown before a forecast, in lengths of that, and at least 50 samples."""


def forecast_panels(f: Forecast) -> Panels:
    """One panel an output."""
    r = f.record
    head = slice(max(f.first - max(int(BEFORE * len(f.t)), 50), 0), f.first)
    panels = []
    for i, channel in enumerate(r.outputs):
        t = np.concatenate([r.t[head], f.t])
        y = np.concatenate([r.y[head, i], f.measured[:, i]])
        seen = np.isfinite(y)
        curves = (
            Curve("measured", t[seen], y[seen], colour=-1),
            Curve("forecast", f.t, f.y[:, i], f.low[:, i], f.high[:, i]),
        )
        axis = labelled(channel.name, channel.unit)
        note = f"Nothing after {r.t[f.first - 1]:.6g} s was used; band: 95 %."
        panels.append(
            Panel(f"forecast-{channel.name}", channel.name, "time [s]", axis, curves, note=note)
        )
    return tuple(panels)
