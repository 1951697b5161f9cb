"""A log that begins where the plant does not rest: the figures count the way, and it is said."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.data.record import Channel, Record
from sysid.estimation.pem import fit
from sysid.plant.replay import replay
from sysid.structures.registry import structure_class


def oven(seed: int = 0) -> Record:
    """20 °C ambient, 8 K a unit, 30 s; from rest, driven to one side."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([0.0, 4.0, 8.0], 40), 30)
    pole = float(np.exp(-1.0 / 30.0))
    y = 20.0 + lfilter([0.0, 8.0 * (1.0 - pole)], [1.0, -pole], u)
    y += 0.05 * rng.standard_normal(len(u))
    return Record(u, y, 1.0, (Channel("power", "W"),), (Channel("temp", "degC"),))


@pytest.mark.parametrize(("first", "said"), [(0, False), (400, True)])
def test_a_log_that_begins_elsewhere_is_told(first: int, said: bool) -> None:
    record = oven()
    model = fit(structure_class("oe").from_orders({"nb": 1, "nf": 1}, 1, 1), [record])
    part = record.rows(first, len(record))
    shown = [w for w in replay(model.plant(), part).warnings if "begins at" in w]
    assert bool(shown) is said
    if said:
        assert f"{record.y[first, 0]:.4g} degC in the log" in shown[0]
