"""Which lag is the motor's shows beside what acts between them: it is looked for beside either."""

import numpy as np
import pytest

from sysid import diagnose
from sysid.data.record import Channel, Record

DT, GAIN, NOISE, FRICTION = 0.05, 20.0, 0.12, 0.06


def log(seed: int, motor: float, sensor: float, samples: int = 1200) -> Record:
    """A motor with dry friction under sines, and a filter behind it; 50 steps of Euler a sample."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(samples)
    waves = [np.sin(2 * np.pi * f * t + rng.uniform(0, 6.3)) for f in np.geomspace(0.05, 2.0, 8)]
    u = np.sum(waves, axis=0) / 3.0
    y, speed, read, h = np.zeros(samples), 0.0, 0.0, DT / 50
    for k in range(1, samples):
        for _ in range(50):
            push = GAIN * u[k - 1] - speed
            most = GAIN * FRICTION
            if speed == 0.0 and abs(push) <= most:
                change = 0.0
            else:
                way = np.sign(speed) if speed != 0.0 else np.sign(push)
                change = h / motor * (push - most * way)
            after = speed + change
            speed = 0.0 if speed * after < 0.0 else after
            read += h / sensor * (speed - read)
        y[k] = read
    y += rng.normal(0.0, NOISE, samples)
    names = (Channel("duty"),), (Channel("omega", "rad/s"),)
    return Record(u[:, None], y[:, None], DT, *names)


@pytest.mark.slow
def test_friction_before_the_filter_of_a_sensor_is_friction() -> None:
    """It was named a dead zone beside a lag of the actuator."""
    motor, sensor = 0.1, 0.2
    found = diagnose(log(1, motor, sensor), log(2, motor, sensor))
    by_id = {e.id: e for e in found.effects}
    assert set(by_id) == {"sensor-lag", "coulomb-friction"}
    (lag,) = (p for p in by_id["sensor-lag"].parameters if p.name.startswith("lag"))
    assert lag.value == pytest.approx(sensor, rel=0.05)  # Euler's steps are a percent
