"""What a diagnosis says of logs that are no robot's, and of models that are none."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import quick_diagnosis
from command_line import Capture, run, write_log

from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.advise import next_experiments
from sysid.diagnosis.base_model import _possible, fit_baseline
from sysid.diagnosis.gap import ChannelGap, Gap
from sysid.diagnosis.validation.localise import localise, regimes
from sysid.diagnosis.validation.model_error import ResidualStructure
from sysid.diagnosis.verdict import Remaining, not_followed, story
from sysid.effects.catalogue import catalogue, chain_effects
from sysid.report import diagnosis_words
from sysid.report.diagnosis_words import headline, left_sentence

ROBOTS_OWN = ("track", "robot", "speed", "stands", "runs")


def heated(n: int = 800, seed: int = 0) -> tuple[Array, Array]:
    """An oven: a heater of 0 to 100 %, a temperature that follows slowly."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.integers(0, 11, n // 40 + 1) * 10.0, 40)[:n]
    y = np.full(n, 20.0)
    for k in range(1, n):
        y[k] = y[k - 1] + (20.0 + 1.5 * u[k - 1] - y[k - 1]) / 30.0
    return u, y + 0.3 * rng.standard_normal(n)


def oven(seed: int = 0) -> Record:
    u, y = heated(seed=seed)
    return Record(u, y, 1.0, (Channel("u_heater", "%"),), (Channel("y_temp", "°C"),))


def test_an_oven_is_not_spoken_of_as_a_track() -> None:
    record = oven()
    words = " ".join(regimes(record, 0, np.array([100.0])))
    said = [
        *localise([record], [record.y - 60.0], np.array([0.3]), np.array([100.0])),
        *next_experiments(
            record,
            np.array([100.0]),
            ["concave-gain", "supply-sag", "freewheel", "dead-zone", "backlash", "stiction"],
            most=9,
        ),
    ]
    words += " ".join(r.region if hasattr(r, "region") else r.purpose for r in said)
    for word in ROBOTS_OWN:
        assert word not in words, (word, words)
    assert "backlash" not in words  # a heater cannot reverse


@pytest.mark.parametrize(
    ("name", "unit", "moves"),
    [
        ("temperature_degC", "degC", False),
        ("level_cm", "m", False),
        ("y_force", "", False),
        ("y", "K", False),
        ("PIC204.PV", "", False),
        ("y_tacho_V", "V", True),
        ("angle_rad", "rad", False),  # it does not integrate: a spring or a weight holds it
        ("y", "", True),
    ],
)
def test_friction_is_offered_only_to_what_may_move(name: str, unit: str, moves: bool) -> None:
    """The level that a base has counts as none: it is a part of it."""
    record = replace(oven(), outputs=(Channel(name, unit),))
    offered = {e.id for e in _possible(chain_effects(), record)}
    of_motion = {"coulomb-friction", "backlash", "gravity-load", "current-limit", "speed-ripple"}
    assert offered >= {"input-saturation", "sensor-lag", "load-bias", "battery-discharge"}
    assert offered & of_motion == (of_motion if moves else set())


def test_shares_are_of_what_is_known_to_be_full_drive() -> None:
    u, y = heated()
    volts = Record(u, y, 1.0, (Channel("u_heater", "V"),), (Channel("y_temp", "°C"),))
    names = [n for n in regimes(volts, 0, np.array([100.0])) if "command is" in n]
    moving = [n for n in names if "zero" not in n]
    assert len(moving) > 1
    assert all("of its largest" in n for n in moving)
    pwm = Record(u, y, 1.0, (Channel("pwm_l", "µs"),), (Channel("omega_l", "rad/s"),))
    assert any("of full drive" in n for n in regimes(pwm, 0, np.array([20000.0])))


def test_no_sentence_of_the_catalogue_knows_whether_wheels_or_tracks_carry_the_robot() -> None:
    for e in catalogue().values():
        t = e.texts
        said = f"{t.sentence} {t.opposite} {t.looks_like} {t.experiment}".lower()
        assert "track" not in said.replace("wheels or tracks", ""), e.id


def test_of_a_position_it_is_said_where_play_is_looked_for() -> None:
    gap = Gap(1.0, 0.5, 0.1, 50.0, (40.0, 60.0), {"y": ChannelGap(9, 3, 1)})
    left = Remaining(ResidualStructure(1e-9, 0.5, ()), gap)
    axis = story("unexplained", (), left, on_rate=True)
    assert "to show backlash: record the speed" in axis
    assert "backlash" not in story("unexplained", (), left)
    u = np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, 40), 20)
    place = Record(u, np.cumsum(u) * 0.05, 0.05, (Channel("volts", "V"),), (Channel("y", "m"),))
    assert fit_baseline([place], None, chain_effects()).on_rate


def test_a_robot_is_still_spoken_of_as_one() -> None:
    u = 8000.0 * np.sign(np.sin(np.arange(400)[:, None] / np.array([9.0, 13.0])))
    outputs = (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s"))
    record = Record(u, u / 1000.0, 0.1, (Channel("pwm_l"), Channel("pwm_r")), outputs)
    assert "the robot turns" in regimes(record, 0, np.full(2, 20000.0))
    (told, *_) = next_experiments(record, np.full(2, 20000.0), ["cross-coupling"])
    assert "hold one side" in told.purpose


def test_a_model_that_does_not_follow_is_called_none() -> None:
    record = oven()
    floor = np.array([0.3])
    lost = not_followed([record], [1.4 * (record.y - record.y.mean())], floor, ())
    assert lost.startswith("The model does not follow the log (y_temp -40 % fit")
    assert "sysid inspect" in lost
    noise = np.random.default_rng(1).standard_normal(record.y.shape)
    still = replace(record, y=noise)
    assert not_followed([still], [noise], np.array([1.0]), ()) == (
        "u_heater does not explain y_temp: its measurements look like noise. Check the columns, or "
        "use larger commands."
    )
    assert not not_followed([record], [0.1 * (record.y - record.y.mean())], floor, ())


@pytest.mark.parametrize("closed", [99.9, 60.0])
def test_what_is_left_is_said_in_words(closed: float) -> None:
    gap = Gap(1.0, 1.0 - closed / 100.0, 0.1, closed, (closed, closed), {"y": ChannelGap(9, 3, 1)})
    text = story("effects-found", ["dead-zone"], Remaining(ResidualStructure(1e-9, 0.5, ()), gap))
    assert " 0 % of" not in text
    assert ("Less than 1 %" in text) == (closed > 99.0)
    assert "structured" not in text


@pytest.mark.parametrize(("after", "said"), [(1.2, "looks like noise"), (14.5, "14.5 times the")])
def test_errors_far_above_the_noise_do_not_look_like_it(after: float, said: str) -> None:
    gap = Gap(1.0, 0.45, 0.1, 55.0, (40.0, 60.0), {"height": ChannelGap(29.0, after, 1.0)})
    result: Any = SimpleNamespace(grown=True, gap=gap, excess_error=None)
    assert said in left_sentence(result)


@pytest.mark.parametrize(
    ("verdict", "ids", "words"),
    [
        ("effects-found", ("dead-zone", "held-telemetry"), "Missing: dead-zone; its telemetry"),
        (
            "effects-found",
            ("dropouts", "dead-zone"),
            "Missing: dead-zone; some measurements are lost",
        ),
        ("effects-found", ("quantisation",), "Nothing is missing that this log could show; its"),
        ("unexplained", ("held-telemetry",), "Something is missing, but no effect"),
        ("effects-found", ("held-telemetry",), "Nothing is missing that this log could show; its"),
        ("no-missing-effect", (), "Nothing is missing that this log could show"),
    ],
)
def test_held_telemetry_is_no_missing_effect(
    verdict: str, ids: tuple[str, ...], words: str
) -> None:
    effects = tuple(SimpleNamespace(id=id, indistinguishable=()) for id in ids)
    found: Any = SimpleNamespace(verdict=verdict, effects=effects, unfollowed="", undecided="")
    assert headline(found).startswith(words)
    assert "held-telemetry" not in headline(found)


def test_names_that_a_log_cannot_tell_apart_stand_beside_each_other() -> None:
    effects = (
        SimpleNamespace(id="coulomb-friction", indistinguishable=("dead-zone",)),
        SimpleNamespace(id="rate-limit", indistinguishable=()),
    )
    found: Any = SimpleNamespace(
        verdict="effects-found",
        effects=effects,
        unfollowed="",
        story="Missing: coulomb-friction, rate-limit. Less than 1 % remains.",
    )
    assert headline(found) == "Missing: coulomb-friction (or dead-zone), rate-limit"
    assert diagnosis_words.story(found) == "Less than 1 % remains."


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sysid.report.diagnosis_page.diagnosis_page", quick_diagnosis.no_page)
    return tmp_path


@pytest.mark.slow
def test_a_log_that_no_input_moves_is_never_nothing_missing(here: Path, capsys: Capture) -> None:
    rng = np.random.default_rng(3)
    u, _ = heated(600)
    slow = np.convolve(rng.standard_normal(900), np.hanning(120), "valid")[:600]
    write_log(here / "slow.csv", ["u_valve", "y_level"], [u, slow])
    told = run(capsys, "diagnose", "slow.csv")
    assert "The log is too short for a diagnosis\nThe errors (y_level" in told.out, told.out[:300]
    for words in ("Nothing is missing", "No effect is missing", "hold one side"):
        assert words not in told.out


def test_a_headline_is_not_taken_out_of_the_name_of_a_column() -> None:
    shape = SimpleNamespace(place="speed", share=0.9)
    text = "Shape known, physics open: speed_rpm follows pwm linearly."
    result: Any = SimpleNamespace(
        unfollowed="", effects=(), verdict="shape-found", shapes=(shape,), undecided="", story=text
    )
    assert headline(result) == "Shape known, physics open: speed"
    assert diagnosis_words.story(result) == "speed_rpm follows pwm linearly."


@pytest.mark.parametrize(
    ("share", "said"), [(0.9, "Shape known, physics"), (0.6, "Shape known in part, physics")]
)
def test_a_shape_that_leaves_much_is_known_in_part(share: float, said: str) -> None:
    shape: Any = SimpleNamespace(id="load-step", share=share, sentence="a load sets in", output="y")
    remaining: Any = None
    assert story("shape-found", [], remaining, shapes=(shape,)).startswith(said)


def test_a_run_that_left_the_log_is_said_to_be_far_off() -> None:
    assert [diagnosis_words._in_words(v) for v in (97.46, -12.3, -2.4e30)] == [
        "97.5",
        "-12.3",
        "< -100",
    ]
