"""Tanks whose outflow grows with the square root of the level, integrated by Euler's rule."""

import numpy as np
import pytest

from sysid.data.record import Channel, Record
from sysid.diagnosis.diagnose import diagnose

pytestmark = pytest.mark.slow

DT, FINE = 2.0, 20


def tanks(seed: int, read: int, samples: int = 900) -> Record:
    """The level of one of two tanks below each other, 0 the upper one; its pump holds 60 s."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(1.0, 6.0, samples // 30), 30)
    h, seen = np.zeros(2), np.zeros((samples, 2))
    for k, volts in enumerate(u):
        seen[k] = h
        for _ in range(FINE):
            out = np.array([0.35, 0.32]) * np.sqrt(np.maximum(h, 0.0))
            h = h + DT / FINE / 4.0 * np.array([0.18 * volts - out[0], out[0] - out[1]])
    y = seen[:, [read]] + 0.02 * rng.standard_normal((samples, 1))
    channels = (Channel("pump", "V"),), (Channel("level", "cm"),)
    return Record(u[:, None], y, DT, *channels, name=f"{seed}.csv", sha256=f"tank{seed}")


@pytest.mark.parametrize("seed", [1, 3])
def test_outflow_of_a_tank_is_a_curve_that_bends_and_has_no_name(seed: int) -> None:
    found = diagnose([tanks(seed, 0)], [tanks(seed + 1, 0)])
    assert found.effects == ()
    (shape,) = found.shapes
    assert (shape.id, shape.place) == ("loss-curve", "torque")
    assert shape.share > 0.95
    assert shape.curve is not None
    slope = np.gradient(shape.curve.y, shape.curve.x)
    assert slope[-8] < 0.75 * slope[8]  # √h: less and less


def test_the_lower_of_two_tanks_gets_no_name_and_no_shape_of_time() -> None:
    """The upper level is not in the log; its command always moves and leaves no quiet sample.

    A free curve of time follows the slow errors of any log; what goes with the level comes first.
    """
    found = diagnose([tanks(1, 1)], [tanks(2, 1)])
    assert found.effects == ()
    assert {s.place for s in found.shapes} <= {"torque", "speed", "reading", "command"}
