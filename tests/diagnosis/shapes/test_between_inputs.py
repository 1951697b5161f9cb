"""Shapes of several inputs: an effect that goes with another input, and an input that is late."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sysid.data.record import Channel, Record
from sysid.diagnosis.diagnose import diagnose

Array = NDArray[np.float64]
DT = 0.02


def _held(rng: np.random.Generator, n: int, least: int, most: int) -> Array:
    levels: list[float] = []
    while len(levels) < n:
        levels += [float(rng.uniform(-1.0, 1.0))] * int(rng.integers(least, most))
    return np.array(levels[:n])


def _lagged(u: Array, tau: float, dt: float = DT) -> Array:
    y, k = np.zeros(len(u)), 1.0 - np.exp(-dt / tau)
    for n in range(1, len(u)):
        y[n] = y[n - 1] + k * (u[n - 1] - y[n - 1])
    return y


def _record(u: Array, y: Array, names: tuple[str, str], dt: float = DT) -> Record:
    inputs = tuple(Channel(n, "") for n in names)
    return Record(u, y[:, None], dt, inputs, (Channel("yaw", "rad/s"),))


@pytest.mark.slow
def test_a_car_turns_by_its_speed_and_its_steering() -> None:
    """ψ̇ = v tan δ / L: no sum of both inputs follows it, and nothing changes with time."""
    rng = np.random.default_rng(4)
    steering, throttle = _held(rng, 2000, 20, 80), 0.55 + 0.4 * _held(rng, 2000, 60, 150)
    yaw = _lagged(throttle, 0.6) * 2.0 * _lagged(steering, 0.08) + rng.normal(0.0, 0.01, 2000)
    found = diagnose(
        [_record(np.column_stack([steering, throttle]), yaw, ("steering", "throttle"))]
    )
    assert not found.effects
    (shape,) = found.shapes
    assert shape.id == "input-product"
    assert shape.share > 0.8
    assert "steering on yaw is in proportion to throttle" in shape.sentence
    assert not found.grown


def test_water_is_heated_in_proportion_to_the_time_that_it_stays() -> None:
    """T = T₀ + P/(c ṁ): no curve of the sum of both inputs follows it."""
    rng = np.random.default_rng(6)
    power, flow = 7.0 + 4.0 * _held(rng, 1800, 30, 120), 6.0 + 3.0 * _held(rng, 1800, 40, 150)
    warm = 12.0 + _lagged(14.3 * power / flow, 5.0, 1.0) + rng.normal(0.0, 0.08, 1800)
    log = _record(np.column_stack([power, flow]), warm, ("power", "flow"), 1.0)
    found = diagnose([replace(log, outputs=(Channel("T_out", "degC"),))])
    assert not found.effects
    (shape,) = found.shapes
    assert shape.id == "input-product"
    assert shape.share > 0.9
    assert "power on T_out is in proportion to 1/flow" in shape.sentence


def test_a_column_that_is_not_used_comes_before_time() -> None:
    """The same car by its steering alone: its gain does not wander with time."""
    rng = np.random.default_rng(4)
    steering, throttle = _held(rng, 2000, 20, 80), 0.55 + 0.4 * _held(rng, 2000, 60, 150)
    speed = _lagged(throttle, 0.6)
    yaw = speed * 2.0 * _lagged(steering, 0.08) + rng.normal(0.0, 0.01, 2000)
    inputs, outputs = (Channel("steering", ""),), (Channel("yaw", "rad/s"),)
    log = Record(steering[:, None], yaw[:, None], DT, inputs, outputs)
    copied = yaw + rng.normal(0.0, 0.01, 2000)  # a second gyro says the same
    unused = np.column_stack([copied, speed + rng.normal(0.0, 0.02, 2000)])
    found = diagnose([replace(log, unused=unused, unused_names=("gyro_2", "speed"))])
    (shape,) = found.shapes
    assert shape.place == "unused column"
    assert "is in proportion to speed, which is not used here; give it" in shape.sentence
    assert all(s.place != "unused column" for s in diagnose([log]).shapes)


def test_an_effect_is_compared_where_the_log_has_been() -> None:
    """Milk that is warmed by steam, at flows from 2400 to 3600 l/h: none of it at a flow of 0."""
    rng = np.random.default_rng(7)
    valve = 45.0 + 12.0 * _held(rng, 2000, 40, 110)
    flow = 3000.0 + 600.0 * _held(rng, 2000, 100, 300)
    warm = 8.0 + _lagged(4140.0 * valve / flow, 30.0, 2.0) + rng.normal(0.0, 0.06, 2000)
    inputs, outputs = (Channel("valve", ""),), (Channel("T_out", "degC"),)
    log = Record(valve[:, None], warm[:, None], 2.0, inputs, outputs)
    found = diagnose([replace(log, unused=flow[:, None], unused_names=("flow",))])
    (shape,) = found.shapes
    assert "goes with flow, which is not used here: where that is largest" in shape.sentence
    times = re.search(r"it is ([\d.]+) times that where it is smallest", shape.sentence)
    assert times is not None
    assert float(times[1]) == pytest.approx(2400.0 / 3600.0, abs=0.15)


def test_a_weight_is_compared_as_it_acts() -> None:
    """A hoist that is slower and later under load, also where the base has another lag."""
    rng = np.random.default_rng(9)
    drive = 0.6 + 0.35 * _held(rng, 3000, 30, 120)
    weight = 10.0 + 9.0 * _held(rng, 3000, 300, 700)
    slow = 0.3 * (1.0 + 0.1 * weight)
    v, speed = 0.0, np.zeros(3000)
    for k in range(2999):
        v += (8.0 * drive[k] / (1.0 + 0.045 * weight[k]) - v) * DT / slow[k]
        speed[k + 1] = v
    speed += rng.normal(0.0, 0.02, 3000)
    log = Record(drive[:, None], speed[:, None], DT, (Channel("pwm"),), (Channel("v", "m/s"),))
    (shape,) = diagnose([replace(log, unused=weight[:, None], unused_names=("weight",))]).shapes
    times = re.search(r"it is ([\d.]+) times that where it is smallest", shape.sentence)
    assert times is not None
    ends = 1.0 + 0.045 * np.array([weight.min(), weight.max()])
    assert float(times[1]) == pytest.approx(ends[0] / ends[1], abs=0.1)


def test_a_transport_delay_that_goes_with_the_flow_is_a_matter_of_time() -> None:
    """A mixing valve at the end of a pipe: what arrives is as much, only later."""
    rng = np.random.default_rng(5)
    valve, flow = 50.0 + 40.0 * _held(rng, 2400, 25, 90), 7.0 + 4.0 * _held(rng, 2400, 300, 600)
    volume = np.cumsum(flow)
    at = np.searchsorted(volume, volume - 60.0)
    warm = 20.0 + 0.4 * _lagged(valve[at], 8.0, 1.0) + rng.normal(0.0, 0.05, 2400)
    log = Record(valve[:, None], warm[:, None], 1.0, (Channel("valve"),), (Channel("T", "degC"),))
    (shape,) = diagnose([replace(log, unused=flow[:, None], unused_names=("flow",))]).shapes
    assert "the time that valve takes to act on T goes with flow" in shape.sentence


def test_a_switch_that_the_output_settles_is_no_cause() -> None:
    """A train that does not roll back at standstill, and its doors, which open there."""
    rng = np.random.default_rng(6)
    notch, v = np.round(4.0 * _held(rng, 3000, 30, 90)), np.zeros(3000)
    for k in range(2999):
        v[k + 1] = max(v[k] + DT * (2.0 * notch[k] - 0.4 * v[k]), 0.0)
    doors = ((v < 0.05) & (notch <= 0.0)).astype(float)
    weighed = np.repeat(rng.integers(0, 2, 30), 100).astype(float)  # goes its own way
    v += rng.normal(0.0, 0.02, 3000)
    log = Record(notch[:, None], v[:, None], DT, (Channel("notch"),), (Channel("v", "m/s"),))
    log = replace(log, unused=np.column_stack([doors, weighed]), unused_names=("doors", "weighed"))
    found = diagnose([log])
    assert all("doors" not in s.sentence for s in found.shapes)


@pytest.mark.slow
def test_weather_that_is_not_used_is_no_slow_state() -> None:
    """A greenhouse by its flap alone: no drift, no further state, and no integrator."""
    rng = np.random.default_rng(1)
    n, tau = 2000, 60.0
    flap = np.repeat(rng.choice([0.0, 20.0, 40.0, 60.0, 80.0, 100.0], n // 80), 80)
    outside = 12.0 + 6.0 * np.sin(4e-4 * np.arange(n) * 2.0 * np.pi + 1.0)
    outside += np.cumsum(rng.normal(0.0, 0.02, n))
    inside = _from(22.0, 14.0 + outside - 0.08 * flap, tau) + rng.normal(0.0, 0.05, n)
    log = Record(flap[:, None], inside[:, None], 10.0, (Channel("flap", ""),), (Channel("in", ""),))
    outdoors = np.round(outside, 1)[:, None]
    (shape,) = diagnose([replace(log, unused=outdoors, unused_names=("out",))]).shapes
    assert "in also follows out, which is not used here" in shape.sentence


@pytest.mark.slow
def test_two_motors_take_no_third_input() -> None:
    """A wind on one of two motors is told; but each output takes an input of its own."""
    rng = np.random.default_rng(8)
    u = np.column_stack([_held(rng, 2400, 20, 80), _held(rng, 2400, 20, 80)])
    wind = _lagged(rng.normal(0.0, 4.0, 2400), 0.5)
    y = np.column_stack([_lagged(10.0 * u[:, 0] + 6.0 * wind, 0.3), _lagged(9.0 * u[:, 1], 0.3)])
    inputs, outputs = (Channel("a"), Channel("b")), (Channel("v", "rad/s"), Channel("w", "rad/s"))
    log = Record(u, y + rng.normal(0.0, 0.05, y.shape), DT, inputs, outputs)
    found = diagnose([replace(log, unused=wind[:, None], unused_names=("wind",))])
    (sentence,) = (s.sentence for s in found.shapes if s.output == "v")
    assert sentence == "v also follows wind, which is not used here"


def _from(start: float, u: Array, tau: float) -> Array:
    y, k = np.full(len(u), start), 1.0 - np.exp(-1.0 / tau)
    for n in range(1, len(u)):
        y[n] = y[n - 1] + k * (u[n - 1] - y[n - 1])
    return y


@pytest.mark.slow
def test_each_input_has_a_dead_time_of_its_own() -> None:
    """A valve 40 samples away and the weather at the sensor: one dead time for both hides each."""
    rng = np.random.default_rng(5)
    valve, weather = _held(rng, 4000, 80, 300), _lagged(rng.normal(0.0, 3.0, 4000), 40.0, 1.0)
    late = np.append(np.full(40, valve[0]), valve[:-40])
    y = (
        20.0
        + 9.0 * (late[0] + _lagged(late - late[0], 60.0, 1.0))
        + 4.0 * _lagged(weather, 60.0, 1.0)
    )
    log = _record(
        np.column_stack([valve, weather]),
        y + rng.normal(0.0, 0.05, 4000),
        ("valve", "weather"),
        1.0,
    )
    found = diagnose([log])
    assert found.verdict == "no-missing-effect"
    # an order more holds one of the 40 samples
    assert re.search("one sample of delay, (39|40) more from valve", found.base_words)
    model = found.before
    assert model.structure.order_values()["nk"] == 1
    again = type(model).from_json(model.to_json())
    x0 = model.structure.fitted_state(model.theta, log.u, log.y, 0)
    run = again.structure.simulate(again.theta, log.u, x0)[:, 0]
    assert np.sqrt(np.mean((y - run)[400:] ** 2)) < 0.05


@pytest.mark.slow
def test_a_load_that_is_engaged_changes_gain_and_time_constant_by_what_it_does() -> None:
    """Both numbers come from fits with the speed simulated: a third less, 0.18 to 0.26 s."""
    rng = np.random.default_rng(6)
    n, dt, at = 2400, 0.02, 1400
    u, w, y = 12.0 + 10.0 * _held(rng, n, 20, 80), 0.0, np.zeros(n)
    for k in range(n):
        y[k] = w
        gain, tau = (12.0, 0.18) if k < at else (8.0, 0.26)
        w += (1.0 - np.exp(-dt / tau)) * (gain * u[k] - w)
    inputs, outputs = (Channel("volts", "V"),), (Channel("shaft", "rad/s"),)
    log = Record(u[:, None], (y + rng.normal(0.0, 0.5, n))[:, None], dt, inputs, outputs)
    (shape,) = diagnose([log]).shapes
    assert shape.id == "plant-step"
    assert "falls by 33 % and its time constant goes from 0.18 to 0.26" in shape.sentence
