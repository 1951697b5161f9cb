"""Two lags in a row may change places: the interval of a lag says so."""

import numpy as np
import pytest

from sysid import diagnose
from sysid.data.record import Channel, Record

DT, GAIN, NOISE = 0.05, 20.0, 0.3


def log(seed: int, motor: float, sensor: float, samples: int = 2000) -> Record:
    """A motor and a filter behind it, 50 steps of Euler a sample."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, samples // 8), 8)
    y, speed, read, h = np.zeros(samples), 0.0, 0.0, DT / 50
    for k in range(1, samples):
        for _ in range(50):
            speed += h / motor * (GAIN * u[k - 1] - speed)
            read += h / sensor * (speed - read)
        y[k] = read
    y += rng.normal(0.0, NOISE, samples)
    names = (Channel("duty"),), (Channel("omega", "rad/s"),)
    return Record(u[:, None], y[:, None], DT, *names)


@pytest.mark.slow
@pytest.mark.parametrize(("motor", "sensor"), [(0.3, 0.15), (0.15, 0.3)])
def test_the_interval_of_a_lag_holds_both_places(motor: float, sensor: float) -> None:
    found = diagnose(log(1, motor, sensor), log(2, motor, sensor))
    (lag,) = found.effects
    assert {lag.id, *lag.indistinguishable} == {"actuator-lag", "sensor-lag"}
    (value,) = (p for p in lag.parameters if p.name.startswith("lag"))
    assert value.interval is not None
    low, high = value.interval
    assert low is not None
    assert high is not None
    for true in (motor, sensor):  # a percent: Euler's steps, and a filter between two samples
        assert 0.99 * low < true < 1.01 * high
