"""The noise floor: what no model can explain is never reported as nothing."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.data.facts import LogFacts
from sysid.data.record import Record
from sysid.diagnosis.gap import floor_of_errors, measure_gap


def quick_plant(noise: float, quantum: float = 0.0, seed: int = 0) -> tuple[Record, np.ndarray]:
    """A motor that follows its command within two samples, under commands that change at each."""
    rng = np.random.default_rng(seed)
    u = rng.choice([-1.0, 1.0], 2000) * rng.uniform(0.2, 1.0, 2000)
    clean = lfilter([0.0, 6.0], [1.0, -0.4], u)
    y = clean + noise * rng.standard_normal(2000)
    if quantum:
        y = quantum * np.rint(y / quantum)
    return Record(u, y, 0.05), clean[:, None]


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.5])
def test_a_floor_that_a_model_went_below_is_read_off_what_it_left(noise: float) -> None:
    record, clean = quick_plant(noise)
    errors = record.y - clean
    rough = LogFacts((record,)).noise
    assert rough[0] > 2.0 * noise  # jerk at every sample: the readings alone mislead
    gap = measure_gap([record.y], [errors], rough, record.y.std(axis=0), ["speed"])
    # the median of 2000 third differences is known within 4 %
    assert gap.channels["speed"].noise_floor == pytest.approx(noise, rel=0.15)
    assert gap.closed_percent == pytest.approx(100.0, abs=1.0)


def test_what_is_smooth_in_the_errors_is_no_noise() -> None:
    record, clean = quick_plant(0.1)
    missed = 0.5 * np.sin(0.05 * np.arange(2000))[:, None]
    errors = record.y - clean + missed
    assert floor_of_errors([errors])[0] == pytest.approx(0.1, rel=0.15)


def test_coarse_readings_have_at_least_the_floor_of_their_rounding() -> None:
    """Slow and coarse: most third differences vanish, and still q/√12 cannot be explained."""
    t = np.arange(2000) * 0.05
    y = 0.5 * np.rint(5.0 * np.sin(0.1 * t) / 0.5)
    record = Record(np.sign(np.sin(0.1 * t)), y, 0.05)
    assert LogFacts((record,)).noise[0] >= 0.5 / np.sqrt(12.0)
