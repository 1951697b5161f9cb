"""What the tests of narmax share."""

from dataclasses import replace

import numpy as np

from sysid.data.record import Record
from sysid.estimation.pem import fit
from sysid.structures.model import Model
from sysid.structures.narmax.structure import NARMAX

TERMS = "y(t-1), y(t-2), u(t-1), u(t-1)*y(t-2)^2, u(t-2)^3"

TRUTH = np.array([0.9, -0.3, 0.5, -0.2, 0.1])

ORDERS = {"na": 2, "nb": 2, "nk": 1}


def structure(terms: str = TERMS, wide: bool = True, **options: str) -> NARMAX:
    """One input, one output, with ranges as a fit would give them."""
    found = NARMAX.from_orders(ORDERS, 1, 1, {"terms": terms, **options})
    if not wide:
        return found
    return replace(
        found, output_range=((-3.0, 3.0),), input_range=((-1.0, 1.0),), input_step=(2.0,)
    )


def record(samples: int = 1500, process: float = 0.0, sensor: float = 0.0, seed: int = 0) -> Record:
    """The truth under white input, with noise in the equation and on the output."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1.0, 1.0, (samples, 1))
    e = process * rng.standard_normal(samples)
    y = np.zeros(samples)
    v = u[:, 0]
    for t in range(2, samples):
        y[t] = (
            0.9 * y[t - 1] - 0.3 * y[t - 2] + 0.5 * v[t - 1]
            - 0.2 * v[t - 1] * y[t - 2] ** 2 + 0.1 * v[t - 2] ** 3 + e[t]
        )  # fmt: skip
    return Record(u, y + sensor * rng.standard_normal(samples), 0.1)


def fitted(r: Record | list[Record], **options: str) -> Model:
    records = r if isinstance(r, list) else [r]
    return fit(NARMAX.from_orders(ORDERS, 1, 1, options), records)


def names(model: Model) -> set[str]:
    return {p.name for p in model.parameters}
