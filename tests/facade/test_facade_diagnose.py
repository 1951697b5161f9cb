"""``sysid.diagnose``: what a script learns of a motor behind a dead zone, and what is refused."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import sysid
from sysid.diagnosis.diagnose import diagnose as engine
from sysid.diagnosis.diagnosis import Diagnosis

ZONE, GAIN, POLE, NOISE = 0.2, 15.0, 0.8, 0.1


def motor(seed: int, samples: int = 400) -> sysid.Record:
    """ω(t) = a ω(t−1) + (1 − a) K z(u(t−1)): z takes 2 V off a command of 10 V at most."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, samples // 10), 10)
    acting = np.sign(u) * np.maximum(np.abs(u) - ZONE, 0.0) / (1.0 - ZONE)
    y = np.zeros(samples)
    for t in range(1, samples):
        y[t] = POLE * y[t - 1] + (1.0 - POLE) * GAIN * acting[t - 1]
    y += NOISE * rng.standard_normal(samples)
    channels = {"inputs": (sysid.Channel("volts", "V"),), "outputs": (sysid.Channel("w", "rad/s"),)}
    return sysid.Record(10.0 * u[:, None], y[:, None], 0.05, name=f"motor {seed}", **channels)


@cache
def found() -> Diagnosis:
    return sysid.diagnose(motor(1), motor(2))


@pytest.mark.slow
def test_the_dead_zone_is_named_with_its_size_and_the_gap_closes() -> None:
    result = found()
    assert result.verdict == "effects-found"
    assert "dead-zone" in {result.effects[0].id, *result.effects[0].indistinguishable}
    assert result.gap.closed_percent > 90.0
    assert [t.record.name for t in result.traces if t.role == "held-out"] == ["motor 2"]
    after = sysid.Model.from_json(result.after.to_json())
    np.testing.assert_array_equal(after.simulate(motor(3).u), result.after.simulate(motor(3).u))


@pytest.mark.slow
def test_it_is_the_diagnosis_of_the_engine() -> None:
    again = engine([motor(1)], [motor(2)]).to_json("before", "after")
    mine = found().to_json("before", "after")
    assert {k: v for k, v in again.items() if k != "seconds"} == {
        k: v for k, v in mine.items() if k != "seconds"
    }


@pytest.mark.slow
def test_a_log_alone_is_divided_and_a_given_model_is_doubted() -> None:
    model = sysid.fit(motor(1), "oe", "nb=1 nf=1 nk=1")
    result = sysid.diagnose([motor(1)], model=model)
    assert result.before is model
    assert result.effects
    assert {t.record.name for t in result.traces} == {"motor 1"}


@pytest.mark.parametrize(
    ("judge", "words"),
    [
        (motor(1), r"both a log and a `validation` log.*omit `validation`"),
        (replace(motor(2), inputs=(sysid.Channel("amps", "A"),)), r"amps -> w but motor 1 has"),
    ],
    ids=["itself", "other channels"],
)
def test_what_proves_nothing_is_refused(judge: sysid.Record, words: str) -> None:
    with pytest.raises(sysid.SysidError, match=words):
        sysid.diagnose(motor(1), judge)


def test_too_short_a_log_and_a_missing_mission_are_refused(tmp_path: Path) -> None:
    with pytest.raises(sysid.DataError, match="40 samples are too few"):
        sysid.diagnose(motor(1, 40))
    with pytest.raises(sysid.UsageError, match="file not found"):
        sysid.diagnose(motor(1), mission=tmp_path / "none.yaml")
