"""Warning for validation data outside the range that a nonlinear model was fitted to."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Record
from sysid.structures.model import Model

BEYOND = 0.05
"""Share of the range of the estimation data by which other data may exceed it unsaid."""


def beyond_range(model: Model, records: Sequence[Record]) -> tuple[str, ...]:
    """One sentence for each input that leaves the range the model has seen.

    Linear models are left out: what they do at one level they do at every level.

    Args:
        records: the data it is judged on.
    """
    if model.structure.traits.linear or len(model.ranges) < len(model.inputs):
        return ()
    warnings = []
    for k, channel in enumerate(model.inputs):
        low, high = model.ranges[k]
        values = np.concatenate([r.u[:, k] for r in records])
        if not len(values) or not high > low:
            continue
        least, most = float(values.min()), float(values.max())
        slack = BEYOND * (high - low)
        if least < low - slack or most > high + slack:
            share = 100.0 * float(np.mean((values < low) | (values > high)))
            unit = f" {channel.unit}" if channel.unit else ""
            warnings.append(
                f"{channel.name} runs from {least:.4g} to {most:.4g}{unit} in the validation data "
                f"but only from {low:.4g} to {high:.4g}{unit} in the estimation data "
                f"({share:.0f} % of the samples lie outside): a nonlinear model extrapolates "
                "there; fit to data of that amplitude."
            )
    return tuple(warnings)
