"""The errors that all sensors have: rate, noise, bias, drop-outs, latency, saturation, steps."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from sensor_cases import SCENE, measurements

from sysid.errors import ModelError
from sysid.robot.mission.sensors.inertial import Accelerometer, Gyroscope
from sysid.runners import floats


def gyro(**keys: Any) -> Gyroscope:
    """A gyroscope without errors but for those of ``keys``."""
    none: dict[str, Any] = {
        "noise": 0.0, "bias_std": 0.0, "bias_walk": 0.0, "saturation": None, "resolution": 0.0,
    }  # fmt: skip
    return Gyroscope.model_validate(none | keys)


def test_a_sensor_without_errors_reads_the_truth() -> None:
    result = measurements(gyro(), 100)
    np.testing.assert_array_equal(result["gyro_z"], result["yaw_rate"])


def test_figures_are_those_of_the_plants_samples_where_the_sensor_is_faster() -> None:
    sensor = gyro(
        rate=50.0,
        noise=0.01,
        bias_std=0.2,
        bias_walk=0.3,
        latency=0.25,
        resolution=0.6,
        dropout=0.1,
    )
    slow, fast = sensor.figures(0.1)["gyro_z"], sensor.figures(0.001)["gyro_z"]
    assert math.isclose(slow.variance, 0.01**2 * 10 + 0.6**2 / 12)
    assert math.isclose(fast.variance, 0.01**2 * 50 + 0.6**2 / 12)
    assert (slow.interval, slow.delay, fast.interval, fast.delay) == (0.1, 3, 0.02, 250)
    assert math.isclose(slow.bias_variance, 0.04)
    assert math.isclose(slow.bias_drift, 0.09)
    assert slow.dropout == 0.1


@pytest.mark.parametrize("dt", [0.1, 0.04])
@pytest.mark.parametrize("rate", [0.7, 3.0, 7.0, 10.0, 30.0])
def test_it_measures_at_the_first_sample_at_or_after_each_instant(rate: float, dt: float) -> None:
    read = ~np.isnan(measurements(gyro(rate=rate), 300, dt)["gyro_z"])
    exact_rate, exact_dt = Fraction(str(rate)), Fraction(str(dt))
    wanted = {math.ceil(j / exact_rate / exact_dt) for j in range(math.ceil(300 * dt * rate) + 1)}
    assert set(np.flatnonzero(read)) == {k for k in wanted if k < 300}


@pytest.mark.parametrize("rate", [2.0, 7.0, 10.0, 1000.0])
def test_the_variance_of_the_noise_grows_with_the_rate_up_to_that_of_the_plant(rate: float) -> None:
    sensor = gyro(rate=rate, noise=0.02)
    result = measurements(sensor, 4000)
    error = (result["gyro_z"] - result["yaw_rate"])[~np.isnan(result["gyro_z"])]
    wanted = 0.02**2 * min(rate, 10.0)
    assert sensor.variance(0.1) == pytest.approx((wanted,))
    # Var of n squares of normal numbers: 2/n; five standard deviations.
    assert np.mean(error**2) / wanted == pytest.approx(1.0, abs=5 * math.sqrt(2 / error.size))


def allan(y: np.ndarray, m: int) -> float:
    """Allan variance of averages of m values."""
    means = y[: y.size // m * m].reshape(-1, m).mean(axis=1)
    return float(0.5 * np.mean(np.diff(means) ** 2))


@pytest.mark.parametrize("m", [1, 4, 16])
def test_allan_variance_falls_with_noise_and_grows_with_the_walk_of_the_bias(m: int) -> None:
    white, walk = gyro(noise=0.02), gyro(bias_walk=0.03)
    noise, drift = (
        (result := measurements(sensor, 6000))["gyro_z"] - result["yaw_rate"]
        for sensor in (white, walk)
    )
    # n/(2m) differences of neighbours hold a third of them in independent numbers at least.
    slack = 5 * math.sqrt(2 / (6000 / m / 3))
    assert allan(noise, m) / (0.02**2 / (0.1 * m)) == pytest.approx(1.0, abs=slack)
    # w²τ/3 for a continuous walk; (2m² + 1)/(6m) w² dt for averages of m samples of it
    assert allan(drift, m) / (0.03**2 * 0.1 * (2 * m * m + 1) / (6 * m)) == pytest.approx(
        1.0, abs=slack
    )


def test_the_bias_is_fixed_and_drawn_once_a_run() -> None:
    fixed = measurements(gyro(bias=0.3), 20)
    np.testing.assert_allclose(fixed["gyro_z"] - fixed["yaw_rate"], 0.3, rtol=1e-12)
    sensor, starts = gyro(bias=0.3, bias_std=0.1), []
    for seed in range(400):
        result = measurements(sensor, 3, seed=seed)
        error = result["gyro_z"] - result["yaw_rate"]
        np.testing.assert_allclose(error, error[0], rtol=1e-12)
        starts.append(error[0])
    assert np.mean(starts) == pytest.approx(0.3, abs=5 * 0.1 / 20)
    assert np.std(starts) == pytest.approx(0.1, rel=5 / math.sqrt(800))


@pytest.mark.parametrize("rate", [4.0, 10.0, 50.0])
@pytest.mark.parametrize(("latency", "samples"), [(0.3, 3), (0.25, 3), (0.1, 1), (0.7, 7)])
def test_latency_shifts_readings_by_whole_samples(
    rate: float, latency: float, samples: int
) -> None:
    errors: dict[str, Any] = {"rate": rate, "noise": 0.1, "bias_walk": 0.1, "dropout": 0.2}
    at_once = measurements(gyro(**errors), 200)["gyro_z"]
    late = measurements(gyro(**errors, latency=latency), 200)["gyro_z"]
    np.testing.assert_array_equal(late[samples:], at_once[:-samples])
    assert np.isnan(late[:samples]).all()


def test_a_latency_of_too_many_samples_is_refused() -> None:
    with pytest.raises(ModelError, match=r"latency of 2 s of gyro_z is 2000 samples .* shorten it"):
        gyro(latency=2.0).start(SCENE._replace(dt=0.001), floats)


def test_the_share_of_readings_that_are_lost_and_nothing_else_changes() -> None:
    all_of_them, some = (
        measurements(gyro(noise=0.1, dropout=p), 4000)["gyro_z"] for p in (0.0, 0.2)
    )
    lost = np.isnan(some)
    assert np.mean(lost) == pytest.approx(0.2, abs=5 * math.sqrt(0.2 * 0.8 / 4000))
    np.testing.assert_array_equal(some[~lost], all_of_them[~lost])
    after_a_loss = np.mean(lost[1:][lost[:-1]])
    assert after_a_loss == pytest.approx(0.2, abs=5 * math.sqrt(0.2 * 0.8 / (0.2 * 4000)))


def test_saturation_and_steps() -> None:
    whole = measurements(gyro(), 300)["gyro_z"]
    limit = 0.3 * np.abs(whole).max()
    limited = measurements(gyro(saturation=limit), 300)["gyro_z"]
    np.testing.assert_array_equal(limited, np.clip(whole, -limit, limit))
    stepped = measurements(gyro(resolution=0.01), 300)["gyro_z"]
    np.testing.assert_allclose(stepped, 0.01 * np.round(stepped / 0.01), rtol=0, atol=1e-15)
    assert np.abs(stepped - whole).max() <= 0.005 * (1 + 1e-9)


def test_a_figure_for_each_axis() -> None:
    sensor = Accelerometer(
        noise=(0.0,), bias=(0.1, 0.2), bias_std=(0.0,), bias_walk=(0.0,), resolution=(0.0,)
    )
    result = measurements(sensor, 50)
    np.testing.assert_allclose(result["acc_y"] - result["v"] * result["yaw_rate"], 0.2, rtol=1e-12)
    forward = np.diff(result["v"]) / 0.1
    np.testing.assert_allclose(result["acc_x"][1:] - forward, 0.1, rtol=1e-9)


def test_two_sensors_of_one_seed_are_independent() -> None:
    one, other = (
        (result := measurements(gyro(noise=0.1), 4000, seed=3, name=name))["gyro_z"]
        - result["yaw_rate"]
        for name in ("gyroscope", "accelerometer")
    )
    assert abs(np.corrcoef(one, other)[0, 1]) < 5 / math.sqrt(4000)
