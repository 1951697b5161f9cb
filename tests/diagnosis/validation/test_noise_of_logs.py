"""The noise of the readings from all logs, where no command ever rests, and never nothing."""

import numpy as np
import pytest

from sysid.data.facts import LogFacts
from sysid.data.record import Channel, Record
from sysid.diagnosis.base_model import fit_baseline, full_drive
from sysid.diagnosis.gap import ChannelGap, Gap
from sysid.diagnosis.samples import inspect_samples
from sysid.diagnosis.session import DiagnosisSession, noise_of
from sysid.diagnosis.validation.model_error import ResidualStructure
from sysid.diagnosis.verdict import Remaining, story, verdict_of

DT, TAU, GAIN = 0.02, 0.15, 24.0


def two_level(noise: float, friction: float = 0.0, hold: int = 5, seed: int = 1) -> Record:
    """A motor under +-0.7 of full drive that never rests; dry friction by steps of 1 ms."""
    rng = np.random.default_rng(seed)
    d = np.repeat(np.where(rng.random(1200 // hold) < 0.5, 0.7, -0.7), hold)
    y, w, h = np.zeros(len(d)), 0.0, 0.001
    for k, drive in enumerate(d):
        y[k] = w
        for _ in range(round(DT / h)):
            free = w + h / TAU * (GAIN * drive - w)
            dry = h / TAU * GAIN * friction
            w = np.sign(free) * max(abs(free) - dry, 0.0)
    y += noise * rng.standard_normal(len(d))
    volts, speed = (Channel("volts", "V"),), (Channel("omega", "rad/s"),)
    return Record(7.2 * d, y, DT, volts, speed)


def studied(record: Record) -> DiagnosisSession:
    half = len(record) // 2
    parts = [record.rows(0, half)], [record.rows(half, len(record))]
    base = fit_baseline(*parts, ())
    return DiagnosisSession(base, noise_of(base), full_drive(parts[0]), 0)


def test_a_log_that_never_settles_shows_its_noise() -> None:
    record = two_level(0.1, hold=1)
    assert LogFacts((record,)).noise[0] > 0.19  # jerk passes for noise
    noise = studied(record).noise
    assert noise.value[0] == pytest.approx(0.1, rel=0.15)  # 1200 samples: known to 10 %
    assert noise.low[0] < 0.1 < noise.high[0] * 1.05


def test_dry_friction_under_two_levels_is_not_called_noise() -> None:
    study = studied(two_level(0.05, friction=0.1))
    assert study.needs_explanation
    assert study.far_above_noise(study.base.model)
    assert study.required_ratio() > 0.0
    # neither way takes the friction itself for noise
    assert study.floor[0] < 0.1


def test_noise_is_never_nothing() -> None:
    study = studied(two_level(0.0))
    assert study.floor[0] > 0.0
    assert study.noise.low[0] > 0.0


def test_errors_are_loud_only_beyond_what_the_noise_may_be() -> None:
    gap = Gap(1.0, 1.0, 0.1, 0.0, (0.0, 0.0), {"y": ChannelGap(1.6, 1.6, 1.0)})
    assert Remaining(None, gap).above_noise
    unsure = {"y": ChannelGap(1.6, 1.6, 1.0, (0.8, 1.2))}
    assert not Remaining(None, Gap(1.0, 1.0, 0.1, 0.0, (0.0, 0.0), unsure)).above_noise


def test_steps_of_a_coarse_sensor_are_noise_although_its_line_blurs_them() -> None:
    rng, step = np.random.default_rng(5), 1.2
    d = np.repeat(rng.uniform(-1.0, 1.0, 80), 60)
    y = np.convolve(d, 0.12 * 0.88 ** np.arange(60))[: len(d)] * GAIN
    blurred = np.round(y / step) * step + 0.05 * rng.standard_normal(len(d))
    channels = (Channel("volts", "V"),), (Channel("omega", "rad/s"),)
    record = Record(7.2 * d, blurred, DT, *channels)
    assert LogFacts((record,)).noise[0] < 0.2  # long at one level: no difference shows it
    noise = studied(record).noise
    assert noise.value[0] >= step / np.sqrt(12.0) * 0.99
    assert noise.low[0] <= noise.value[0] <= noise.high[0]


@pytest.mark.parametrize("steps", [5.7, 7.0])
def test_a_step_as_large_as_a_sixth_of_all_speeds_is_found_behind_noise(steps: float) -> None:
    rng = np.random.default_rng(6)
    d = np.repeat(rng.uniform(-1.0, 1.0, 80), 60)
    y = np.convolve(d, 0.12 * 0.88 ** np.arange(60))[: len(d)] * GAIN
    step = float(np.quantile(np.abs(y), 0.95)) / steps
    blurred = np.round(y / step) * step + 0.06 * step * rng.standard_normal(len(d))
    channels = (Channel("volts", "V"),), (Channel("omega", "rad/s"),)
    (coarse,) = inspect_samples([Record(7.2 * d, blurred, DT, *channels)]).coarse
    assert coarse.step == pytest.approx(step, rel=0.01)
    smooth = Record(7.2 * d, y + 0.06 * step * rng.standard_normal(len(d)), DT, *channels)
    assert not inspect_samples([smooth]).coarse


def test_structure_of_errors_that_may_all_be_noise_is_nothing_missing() -> None:
    structure = ResidualStructure(1e-20, 0.4, ())
    for rmse, verdict in ((1.02, "no-missing-effect"), (1.3, "unexplained")):
        channel = ChannelGap(rmse, rmse, 1.0, (0.95, 1.05))
        left = Remaining(structure, Gap(0.1, 0.1, 1.0, 0.0, (0.0, 0.0), {"y": channel}))
        assert verdict_of([], left, False) == verdict
    assert "no larger than the noise" not in story("unexplained", [], left)
