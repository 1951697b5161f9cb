"""Short logs: what is missing is named or said to be untold, never "nothing is missing"."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.data.io import read_log
from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.diagnosis import NamedEffect
from sysid.diagnosis.gap import ChannelGap, Gap
from sysid.diagnosis.search.evidence import Evidence
from sysid.diagnosis.validation.error_tests import f_test
from sysid.diagnosis.validation.model_error import ResidualStructure
from sysid.diagnosis.verdict import LONG_ENOUGH, Remaining, story
from sysid.report.diagnosis_words import evidence_sentence, headline, nothing_named

STORED = Path(__file__).parents[1] / "data" / "0.1" / "log.csv"
POLE, NOISE = 0.82, 0.02


def short_log(effect: str, samples: int, seed: int = 1) -> Record:
    """A first-order motor of 12 V, its command held for 10 samples, and one effect."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-12.0, 12.0, samples // 10), 10)
    drive = {
        "dead-zone": np.sign(u) * np.maximum(np.abs(u) - 2.0, 0.0),
        "input-saturation": np.clip(u, -7.0, 7.0),
        "direction-asymmetry": np.where(u < 0.0, 0.7 * u, u),
    }.get(effect, u)
    shock = 0.12 * rng.standard_normal(samples) * (effect == "load")
    y, load = np.zeros(samples), 0.0
    motor = 0.0
    for k in range(samples):
        y[k] = motor + load
        motor = POLE * motor + (1.0 - POLE) * drive[k]
        load = 0.95 * load + shock[k]
    y += NOISE * rng.standard_normal(samples)
    volts, speed = (Channel("voltage", "V"),), (Channel("omega", "rad/s"),)
    return Record(u[:, None], y[:, None], 0.02, volts, speed, name="log.csv")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "samples"),
    [("dead-zone", 120), ("input-saturation", 200), ("direction-asymmetry", 400)],
)
def test_what_a_short_log_proves_is_named(effect: str, samples: int) -> None:
    found = diagnose([short_log(effect, samples)])
    assert [e.id for e in found.effects] == [effect]


def test_the_log_of_an_earlier_version_is_not_without_its_dead_zone() -> None:
    found = diagnose([read_log(STORED)])
    assert [e.id for e in found.effects] == ["dead-zone"]


@pytest.mark.slow
def test_a_load_on_a_short_log_is_neither_named_nor_nothing() -> None:
    found = diagnose([short_log("load", 300)])
    assert found.effects == ()
    assert headline(found) == "The log is too short for a diagnosis"
    assert f"at least {LONG_ENOUGH} samples" in found.story
    assert "No effect is missing" not in nothing_named(found)


@pytest.mark.slow
@pytest.mark.parametrize("held", [60, 10])
def test_sixty_rows_say_nothing_of_an_effect_but_that_they_are_few(held: int) -> None:
    """A step, and levels, through two lags and a dead time: the held-out block is 18 samples."""
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(2.0, 4.0, 60 // held), held) * (np.arange(60) > 5)
    bottom = np.polymul([1.0, -np.exp(-0.2)], [1.0, -np.exp(-0.4)])
    y = lfilter(np.append(np.zeros(5), 4.2 * np.sum(bottom)), bottom, u)
    y += 0.05 * rng.standard_normal(60)
    found = diagnose([Record(u, np.round(y, 2), 0.1, name="step.csv")])
    assert found.effects == found.where == ()
    assert all("may be chance" in r.reason for r in found.rejected)
    assert found.description == ""
    if held == 60:  # the model that diagnosis starts from describes the step: nothing is missing
        assert headline(found) == "Nothing is missing that this log could show"
        return
    assert headline(found) == "The log is too short for a diagnosis"
    assert nothing_named(found) == "No effect is reported."


def test_a_test_of_few_blocks_is_no_evidence() -> None:
    evidence = Evidence(-70.0, 1.0, 1.0, 0.5, 0.34)
    effect = NamedEffect("backlash", "motor", (), (), evidence, (), "")
    assert "0.34" not in evidence_sentence(effect)


def test_nothing_is_missing_from_a_short_log_of_the_model_itself() -> None:
    found = diagnose([short_log("", 120)])
    assert found.effects == ()
    assert headline(found) == "Nothing is missing that this log could show"


@pytest.mark.parametrize("ratio", [1.6, 5.0, 100.0])
@pytest.mark.parametrize(
    "left", [None, ResidualStructure(1.0, 0.0, ()), ResidualStructure(1e-4, 0.1, ())]
)
@pytest.mark.parametrize("ids", [(), ("quantisation",)])
def test_errors_above_the_noise_are_never_nothing(
    ratio: float, left: ResidualStructure | None, ids: tuple[str, ...]
) -> None:
    gap = Gap(ratio, ratio, 1.0, 0.0, (0.0, 0.0), {"y": ChannelGap(ratio, ratio, 1.0)})
    verdict = "effects-found" if ids else "no-missing-effect"
    text = story(verdict, ids, Remaining(left, gap))
    assert "othing" not in text
    assert f"y {ratio:.1f} times" in text
    effects = tuple(SimpleNamespace(id=id) for id in ids)
    found: Any = SimpleNamespace(verdict=verdict, effects=effects, unfollowed="", undecided=text)
    assert "othing" not in headline(found)


def test_a_test_without_samples_gives_no_p_value() -> None:
    rng = np.random.default_rng(0)
    X: Array = rng.standard_normal((40, 35))
    assert np.isnan(f_test(X[:, 0], X, 0))
    assert f_test(X[:, 0] + 0.1 * X[:, 9], X[:, :5], 0) < 1e-6
