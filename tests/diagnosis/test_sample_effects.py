"""Coarse and lost readings are seen in the samples, and nothing else is taken for them."""

from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter
from sysid_datasets.hidden_logs import NOISE, TYPICAL_SPEED, Request, hide

from sysid.data.record import Channel, Record
from sysid.diagnosis.findings import sample_effects
from sysid.diagnosis.samples import blurred_step, inspect_samples, smallest_named, with_steps_of


@cache
def logs(effects: tuple[str, ...], seed: int, noise: str = "low", style: str = "steps") -> Record:
    """The estimation log of a hidden effect."""
    request = Request(effects=effects, seed=seed, noise=noise, style=style, duration=40.0)
    rows = [line.split(",") for line in hide(request).files["est.csv"].splitlines()[1:]]
    a = np.array(rows, dtype=np.float64)
    return Record(
        u=a[:, 1:3],
        y=a[:, 3:5],
        dt=0.05,
        inputs=(Channel("pwm_l"), Channel("pwm_r")),
        outputs=(Channel("omega_l"), Channel("omega_r")),
    )


@pytest.mark.parametrize(("noise", "style"), [("low", "steps"), ("high", "driving")])
@pytest.mark.parametrize("effect", ["quantisation", "dropouts"])
def test_both_are_found(effect: str, noise: str, style: str) -> None:
    assert inspect_samples([logs((effect,), 1, noise, style)]).ids == (effect,)


@pytest.mark.parametrize(
    "effects",
    [
        (),
        ("sensor-saturation",),
        ("unsigned-speed",),
        ("dead-zone",),
        ("stiction",),
        ("freewheel",),
    ],
)
def test_nothing_else_is_taken_for_them(effects: tuple[str, ...]) -> None:
    assert inspect_samples([logs(effects, 2, style="pulses")]).ids == ()


def test_the_step_is_measured() -> None:
    record = logs((), 3)
    coarse = Record(u=record.u, y=0.8 * np.round(record.y / 0.8), dt=0.05)
    found = inspect_samples([coarse]).coarse
    assert [c.output for c in found] == ["y1", "y2"]
    assert [c.step for c in found] == pytest.approx([0.8, 0.8], rel=1e-6)


def test_what_is_read_off_the_samples_has_no_evidence_that_was_never_computed() -> None:
    record = logs((), 3)
    coarse = Record(u=record.u, y=0.8 * np.round(record.y / 0.8), dt=0.05)
    (named,) = sample_effects(inspect_samples([coarse]))
    stored = named.to_json()
    assert stored["id"] == "quantisation"
    assert stored["evidence"] is None
    assert stored["error_ratio_without"] is None


def test_a_fine_converter_does_not_matter() -> None:
    record = logs((), 3)
    fine = 0.5 * NOISE["low"] * TYPICAL_SPEED
    rounded = Record(u=record.u, y=fine * np.round(record.y / fine), dt=0.05)
    assert inspect_samples([rounded]).ids == ()


@pytest.mark.parametrize("holds", [True, False])
def test_the_mask_hides_what_was_lost(holds: bool) -> None:
    record = logs((), 3)
    y = record.y.copy()
    rng = np.random.default_rng(1)
    lost = np.zeros(len(y), dtype=bool)
    for k in rng.choice(np.arange(20, len(y) - 5, 8), 40, replace=False):
        lost[k : k + 2] = True
    for k in np.flatnonzero(lost):
        y[k, 0] = y[k - 1, 0] if holds else 0.0
    found = inspect_samples([Record(u=record.u, y=y, dt=0.05)])
    assert [entry.holds for entry in found.lost] == [holds]
    mask = found.weights[0][:, 0] == 0.0
    moving = lost & (np.abs(record.y[:, 0]) > 3.0)
    assert np.mean(mask[moving]) > 0.8
    # at most a few repeats by chance of four written digits
    assert int(np.sum(mask & ~lost)) <= 3
    assert found.hidden == int(mask.sum())


def test_the_smallest_that_would_be_named() -> None:
    sizes = smallest_named([logs((), 3)])
    step, share = sizes["quantisation"], sizes["dropouts"]
    assert step is not None
    assert share is not None
    assert 0.05 < step < 1.0
    assert 0.0 < share < 0.01


@pytest.mark.parametrize("limit", [np.inf, 14.0])
def test_readings_alike_by_their_last_digit_are_not_lost(limit: float) -> None:
    """Five digits in all are 0.001 above 10, 0.00001 below 1; a clip repeats its level."""
    rng = np.random.default_rng(4)
    levels = np.repeat(rng.uniform(-18.0, 18.0, 100), 30)
    noise = np.zeros(3000)
    for k in range(1, 3000):
        noise[k] = 0.9 * noise[k - 1] + 0.015 * rng.standard_normal()
    y = np.clip(levels + noise, -limit, limit)
    written = np.array([float(f"{v:.5g}") for v in y])
    repeated = (np.diff(written) == 0.0) & (np.abs(written[1:]) < 13.9)
    assert np.sum(repeated) >= 10
    found = inspect_samples([Record(u=levels[:, None], y=written[:, None], dt=0.05)])
    assert found.ids == ()


@pytest.mark.parametrize(("step", "named"), [(1.0, True), (0.0, False)])
def test_ticks_behind_a_noisy_line_are_seen(step: float, named: bool) -> None:
    record = logs((), 3)
    rng = np.random.default_rng(5)
    ticks = step * np.floor(record.y / step) if step else record.y
    y = ticks + 0.15 * rng.standard_normal(ticks.shape)
    found = inspect_samples([Record(u=record.u, y=y, dt=0.05)])
    assert [c.output for c in found.coarse] == ["y1", "y2"] * named
    # steps are tried at distances of a sixtieth
    assert [c.step for c in found.coarse] == pytest.approx([step, step] * named, rel=0.02)
    assert not found.lost


def test_readings_that_stand_twice_at_one_settled_speed_are_no_lattice() -> None:
    """A fine sensor whose readings repeat by chance where the wheel runs for long."""
    rng = np.random.default_rng(2)
    u = np.repeat(rng.choice([-1.0, 1.0], 200), 20)
    y = np.zeros(len(u))
    for k in range(1, len(u)):
        y[k] = 0.7 * y[k - 1] + 0.3 * 11.8 * u[k - 1]
    y = np.round(y + rng.normal(0.0, 0.06, len(u)), 3)
    assert np.sum(np.diff(y) == 0.0) >= 10
    names = (Channel("duty"),), (Channel("omega"),)
    assert inspect_samples([Record(u[:, None], y[:, None], 0.05, *names)]).ids == ()


@pytest.mark.parametrize("step", [0.0, 0.8])
@pytest.mark.parametrize("levels", [17, 41])
def test_equal_steps_of_a_staircase_are_no_step_of_the_sensor(levels: int, step: float) -> None:
    """Steady speeds lie at equal distances then; only readings in motion tell."""
    rng = np.random.default_rng(4)
    up = np.linspace(-1.0, 1.0, levels)
    u = np.repeat(np.concatenate([up, up[::-1]]), 1640 // levels)
    y = np.zeros(len(u))
    for k in range(1, len(u)):
        y[k] = 0.9 * y[k - 1] + 0.1 * 12.0 * u[k - 1]
    if step:
        y = step * np.round(y / step)
    y += 0.05 * rng.standard_normal(len(u))
    found = inspect_samples([Record(u=u[:, None], y=y[:, None], dt=0.05)]).coarse
    assert [c.step for c in found] == pytest.approx([step] if step else [], rel=0.02)


def test_a_command_of_one_size_gathers_readings_on_few_ways_which_is_no_step() -> None:
    """Some step suits the same few values: one of an eighteenth of the speed had been named."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.choice([-1.0, 1.0], 400), rng.integers(5, 12, 400))[:3000]
    speed = lfilter([0.0, 0.2], np.poly([0.6, 0.5]), 20.0 * u)  # a motor and a lag
    y = speed + rng.normal(0.0, 0.05, len(u))
    assert blurred_step(y) > 0.0
    channels = (Channel("u"),), (Channel("omega", "rad/s"),)
    assert not inspect_samples([Record(u[:, None], y[:, None], 0.05, *channels)]).coarse


def two_level(size: float, step: float) -> Record:
    """A motor under ± one size, read by a sensor of some step behind a little noise."""
    rng = np.random.default_rng(5)
    u = size * np.repeat(rng.choice([-1.0, 1.0], 400), rng.integers(5, 40, 400))[:3000]
    y = lfilter([0.0, 0.15], [1.0, -0.85], 20.0 * u)
    y = step * np.round(y / step) + step / 15.0 * rng.standard_normal(len(u))
    channels = (Channel("u"),), (Channel("omega", "rad/s"),)
    return Record(u[:, None], y[:, None], 0.05, *channels)


def test_clear_steps_behind_little_noise_are_steps_under_a_command_of_one_size_too() -> None:
    (coarse,) = inspect_samples([two_level(1.0, 0.9)]).coarse
    assert coarse.step == pytest.approx(0.9, rel=0.02)


def test_a_sensor_of_which_one_log_shows_the_steps_has_them_in_all() -> None:
    """One log of ± half, too little to tell; the one that judges shows them."""
    poor = two_level(0.1, 0.9)
    seen = inspect_samples([poor])
    assert not seen.coarse
    (coarse,) = with_steps_of(seen, [poor, two_level(1.0, 0.9)]).coarse
    assert coarse.step == pytest.approx(0.9, rel=0.02)
