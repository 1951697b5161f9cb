"""One run of a grey box on plain numbers is its run on arrays."""

from typing import Any

import numpy as np
import pytest

from sysid.data.record import Array
from sysid.structures.grey_box.dc_motor.structure import DCMotor, MotorPhysics
from sysid.structures.grey_box.physics import Sampling
from sysid.structures.grey_box.structure import GreyBox
from sysid.structures.grey_box.tanks import Tanks, TanksPhysics
from sysid.structures.special_runs import readout

MOTOR = {
    "gain": 2.0,
    "time_constant": 0.3,
    "coulomb": 0.7,
    "breakaway": 1.5,
    "stribeck": 0.8,
    "drag": 0.01,
    "viscous_back": 1.2,
    "coulomb_back": 0.8,
    "offset": 0.1,
    "limit": 5.0,
}
TRACKS = {**MOTOR, "gain": [2.0, 2.4], "coulomb": [0.8, 0.6], "coupling": -0.3}


def on_both(s: GreyBox[Any], theta: Array, inputs: Array, x: Array) -> tuple[Array, Array]:
    """States along a run on plain numbers, and each from the one before it on arrays."""
    step, read, physics = s.step(theta), readout(s, theta), s.physics
    h, steps = s.sampling.h, s.sampling.steps
    p = physics.prepared(np, physics.unpack(np, theta), h)
    plain, arrays = [], []
    for u in inputs:
        after, y = step(x, u)
        np.testing.assert_array_equal(y, read(x, u))
        arrays.append(physics.sample(np, x[:, None], u[:, None], p, h, steps)[:, 0])
        plain.append(after)
        x = after
    return np.array(plain), np.array(arrays)


@pytest.mark.parametrize("integrator", ["exact", "rk4", "implicit"])
@pytest.mark.parametrize("output", ["speed", "position"])
@pytest.mark.parametrize("tracks", [1, 2])
def test_motors_on_plain_numbers(tracks: int, output: str, integrator: str) -> None:
    """The same operations in the same order: through stops and reversals, to the last bit."""
    options = {"friction": "full", "input": "voltage", "integrator": integrator, "output": output}
    s = DCMotor(MotorPhysics.from_options(options, tracks, tracks), Sampling(0.05, 7))
    theta = s.physics.pack(MOTOR if tracks == 1 else TRACKS)
    level = np.random.default_rng(3).uniform(-1.0, 1.0, (30, tracks))
    inputs = 6.0 * np.repeat(np.where(np.abs(level) < 0.15, 0.0, level), 4, axis=0)
    plain, arrays = on_both(s, theta, inputs, np.zeros(s.n_states(theta)))
    np.testing.assert_array_equal(plain, arrays)
    speeds = plain[:, :tracks]
    assert np.any(speeds == 0.0)
    assert np.min(speeds) < 0.0 < np.max(speeds)


def test_tanks_on_plain_numbers() -> None:
    s = Tanks(TanksPhysics(1, 1), Sampling(4.0, 3))
    theta = s.physics.pack({"k1": 0.05, "k2": 0.04, "k3": 0.05, "limit1": 8.0, "share": 0.4})
    inputs = np.repeat(np.random.default_rng(5).uniform(0.0, 5.0, (10, 1)), 10, axis=0)
    plain, arrays = on_both(s, theta, inputs, np.array([2.0, 1.0]))
    # powers of NumPy and of math may differ in their last bit
    np.testing.assert_allclose(plain, arrays, rtol=1e-14)
    assert np.max(plain[:, 0]) == 8.0  # the upper one overflows
