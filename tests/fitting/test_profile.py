"""Profile likelihood: ends of intervals where slopes tell nothing, and better minima on the way."""

import numpy as np
import pytest

from sysid.data.record import Array, Channel, Record
from sysid.estimation.pem import fit
from sysid.fitting.profile import NORMAL, profiled
from sysid.structures.grey_box.dc_motor.structure import DCMotor

OPEN = (-np.inf, np.inf)
TRUTH = {"gain": 6.0, "time_constant": 0.15, "coulomb": 1.3, "breakaway": 1.5, "stribeck": 2.0}


def test_a_parabola_gives_the_error_of_its_slopes() -> None:
    p = np.array([3.0])
    for guessed in (0.05, 0.2, 1.0):
        found = profiled(lambda v, q: (((v - 3.0) / 0.2) ** 2, q), p, 0, guessed, *OPEN)
        # ends are bracketed to a fifth, on the outer side
        assert 0.2 <= found.error < 0.2 * 1.2


def test_a_jump_ends_the_interval_and_a_bound_as_well() -> None:
    p = np.array([1.0])

    def jumps(v: float, q: Array) -> tuple[float, Array]:
        return (50.0 if v > 1.3 else 0.1), q

    found = profiled(jumps, p, 0, 0.01, 0.5, np.inf)
    assert 0.3 <= found.above < 0.3 * 1.5
    # nothing contradicts any value below: six steps outwards reach the bound
    assert found.below == pytest.approx(0.5)
    assert found.error == pytest.approx(0.5 / NORMAL)


def test_a_better_minimum_on_the_way_is_reported() -> None:
    p = np.array([0.0, 7.0])
    found = profiled(lambda v, q: (-9.0, q + 1.0), p, 0, 1.0, *OPEN)
    assert found.better is not None
    np.testing.assert_array_equal(found.better, p + 1.0)


def sticking(seed: int, samples: int = 1500, dt: float = 0.02, fine: int = 40) -> Record:
    """A motor that breaks away at 1.95 V and slides at 1.3 V."""
    rng = np.random.default_rng(seed)
    u: list[float] = []
    while len(u) < samples:
        level = 0.0 if rng.random() < 0.25 else rng.uniform(-10.0, 10.0)
        u += [level] * int(rng.integers(12, 50))
    gain, tau, dry, extra, slow = TRUTH.values()
    w, y = 0.0, np.zeros(samples)
    for k in range(samples):
        y[k] = w
        for _ in range(fine):
            level = gain * dry * (1.0 + (extra - 1.0) / (1.0 + (w / slow) ** 2))
            net = gain * u[k]
            if w == 0.0 and abs(net) <= level:
                break
            sense = np.sign(w) if w != 0.0 else np.sign(net)
            aim = net - sense * level
            after = aim + (w - aim) * np.exp(-dt / fine / tau)
            w = 0.0 if after * sense < 0.0 else after
    y += 0.4 * rng.standard_normal(samples)
    volts, speed = (Channel("volts", "V"),), (Channel("speed", "rad/s"),)
    return Record(np.array(u[:samples])[:, None], y[:, None], dt, volts, speed)


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(s, marks=pytest.mark.slow) for s in (2, 5, 12))]
)
def test_friction_that_sticks_is_found_with_honest_errors(seed: int) -> None:
    motor = DCMotor.from_orders({}, 1, 1, {"friction": "stribeck"})
    model = fit(motor, [sticking(seed)])
    found = {p.name: p for p in model.parameter_table()}
    for name, true in TRUTH.items():
        p = found[name]
        assert p.std_error is not None
        assert np.isfinite(p.std_error), name
        # one of 20 numbers is beyond 3.5 standard errors once in 100 such tests
        assert abs(p.value - true) < 3.5 * p.std_error, name
        assert p.std_error < 0.35 * true, name
