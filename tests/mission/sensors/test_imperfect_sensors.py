"""The errors that all sensors have: rate, noise, bias, drop-outs, latency, saturation, steps."""

import math

from sysid.mission.sensors.gyroscope import Gyroscope


def test_figures_are_those_of_the_plants_samples_where_the_sensor_is_faster() -> None:
    gyro = Gyroscope(
        rate=50.0, noise=(0.01,), bias_std=(0.2,), bias_walk=(0.3,), latency=0.25, resolution=(0.6,)
    )
    slow, fast = gyro.figures(0.1)["gyro_z"], gyro.figures(0.001)["gyro_z"]
    assert math.isclose(slow.variance, 0.01**2 * 10 + 0.6**2 / 12)
    assert math.isclose(fast.variance, 0.01**2 * 50 + 0.6**2 / 12)
    assert (slow.interval, slow.delay, fast.interval, fast.delay) == (0.1, 3, 0.02, 250)
    assert math.isclose(slow.bias_variance, 0.04)
    assert math.isclose(slow.bias_drift, 0.09)
