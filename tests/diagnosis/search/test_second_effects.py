"""A second effect beside a large one: looked for while it is above the noise, and no mere mend."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sysid.data.record import Channel
from sysid.diagnosis.search.evidence import Evidence
from sysid.diagnosis.search.forward_selection import (
    ForwardSelection,
    SmallGain,
    explains_most_of_remainder,
    small_gain,
)
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.selection import (
    CandidateModel,
    ScoredCandidate,
    SelectedEffect,
    Selection,
)
from sysid.diagnosis.session import DiagnosisSession, least_damping, stand_in
from sysid.diagnosis.validation.noise import NoiseFloor
from sysid.fitting.holdout import Errors

NOISE = 0.1
EVIDENCE = Evidence(-900.0, 9.0, 1.0, 0.5, 1e-9)


def node(rmse: float, *effects: str) -> CandidateModel:
    """A model of one output with errors of this size on both parts."""
    errors = (np.full((100, 1), rmse),)
    return CandidateModel(effects, np.zeros(1), (), Errors(errors, errors), np.ones(1, dtype=bool))


def session(**base: Any) -> DiagnosisSession:
    """A session of which a test gives what it looks at."""
    floor = np.array([NOISE])
    return DiagnosisSession(SimpleNamespace(**base), NoiseFloor(floor, floor, floor), np.ones(1), 0)  # type: ignore[arg-type]


def selected(id: str, without: CandidateModel) -> SelectedEffect:
    """An accepted effect, and the model without it."""
    return SelectedEffect(id, EVIDENCE, (), without.touched, {}, without)


def selection(base: CandidateModel, final: CandidateModel, *effects: SelectedEffect) -> Selection:
    return Selection(base, final, effects, (), ())


@pytest.mark.parametrize(
    ("left", "searched"),
    [(1.5, True), (1.2, True), (1.05, False)],
    ids=["clearly-above-noise", "above-noise", "noise"],
)
def test_a_small_share_of_a_large_gap_is_looked_into_while_it_is_above_the_noise(
    left: float, searched: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The base misses by fifty times the noise: all these are far below 1 % of its gap."""
    structured: Any = SimpleNamespace(p_value=0.0)
    monkeypatch.setattr(DiagnosisSession, "residual_structure", lambda *_, **__: structured)
    study = session(search=SimpleNamespace(needed=0.9))
    naming = selection(node(50 * NOISE), node(left * NOISE, "load-bias"))
    assert (study.remains(naming) > 0.0) is searched


@pytest.mark.parametrize(
    ("second", "before", "after", "little"),
    [
        ("speed-ripple", 0.45, 0.4, SmallGain.LOOK_ALIKE),
        ("speed-ripple", 1.0, 0.1, SmallGain.PARTIAL),
        ("speed-ripple", 2.0, 0.1, SmallGain.NO),
        ("cross-coupling", 0.45, 0.4, SmallGain.NO),
    ],
    ids=["look-alike-of-little", "look-alike-of-a-part", "look-alike-of-much", "another"],
)
def test_what_only_mends_the_formula_of_its_look_alike_is_no_second_effect(
    second: str, before: float, after: float, little: SmallGain
) -> None:
    """Beside gravity, which takes 99.75 of 100 % of the gap in the first case."""
    base, rest = node(5.0), node(before, "gravity-load")
    assert small_gain(base, rest, node(after, "gravity-load", second)) is little


@pytest.mark.parametrize(
    ("after", "is_redundant"), [(0.9, True), (0.5, False)], ids=["part", "most"]
)
def test_a_look_alike_that_takes_a_part_of_the_gap_takes_most_of_what_is_left(
    after: float, is_redundant: bool
) -> None:
    """A fan and a weight: of what the weight's law left a curve of the command took a fifth."""
    search: Any = ForwardSelection.__new__(ForwardSelection)
    search.data = SimpleNamespace(noise=np.array([NOISE]))
    base, rest = node(5.0), node(1.0, "quadratic-drag")
    whole = node(after, "quadratic-drag", "concave-gain")
    assert small_gain(base, rest, whole) in (SmallGain.PARTIAL, SmallGain.LOOK_ALIKE)
    assert search.is_redundant(base, rest, whole, ()) is is_redundant


def test_a_look_alike_must_take_more_of_the_gap_than_another_effect() -> None:
    """A curve by a stick's expo leaves 2 % of its gap to a formula that bends a little else."""
    base, rest, left = node(5.0), node(0.75, "concave-gain"), 0.4  # 1.6 % of the gap
    alike = node(left, "concave-gain", "input-saturation")
    assert small_gain(base, rest, alike) is SmallGain.LOOK_ALIKE
    assert small_gain(base, rest, node(left, "concave-gain", "cross-coupling")) is SmallGain.NO


@pytest.mark.parametrize(
    ("third", "after", "is_redundant"),
    [
        ("input-saturation", 0.4, True),
        ("input-saturation", 0.1, False),
        ("sampling-lag", 0.4, False),
    ],
    ids=["of-little", "of-much", "how-the-log-was-made"],
)
def test_a_third_effect_of_little_mends_the_formulas_of_two(
    third: str, after: float, is_redundant: bool
) -> None:
    two = ("sensor-bias", "dead-time")
    base, rest = node(5.0), node(0.45 if after > 0.2 else 1.0, *two)
    little = small_gain(base, rest, node(after, *two, third))
    assert little is (SmallGain.AMONG_OTHERS if is_redundant else SmallGain.NO)


def judged(id: str, score: float, ratio: float = 0.5) -> ScoredCandidate:
    """An effect tried beside two others."""
    return ScoredCandidate(node(0.4, id), Evidence(-score, 9.0, 1.0, ratio, 1e-9), score)


@pytest.mark.parametrize(
    ("rival", "alone"), [(25.0, True), (600.0, False), (-40.0, True)], ids=["far", "near", "worse"]
)
def test_what_no_other_effect_comes_near_is_no_stand_in(rival: float, alone: bool) -> None:
    """However little of the gap it takes."""
    search = ForwardSelection.__new__(ForwardSelection)
    search.data = SimpleNamespace(noise=np.array([NOISE]))  # type: ignore[assignment]
    tried = [judged("dead-time", 926.0), judged("gravity-load", rival)]
    assert search.unrivalled(node(1.0), "dead-time", tried) is alone
    little = [judged("dead-time", 40.0), judged("gravity-load", 2.0)]
    assert not search.unrivalled(node(1.0), "dead-time", little)  # few units of BIC are chance
    base, rest = node(5.0), node(0.45, "rate-limit", "sensor-saturation")
    whole = node(0.4, *rest.effects, "dead-time")
    assert search.is_redundant(base, rest, whole, tried) is not alone


@pytest.mark.parametrize(
    ("id", "output", "damping", "closed", "doubted"),
    [
        ("dead-zone", "level_cm", 1.0, 70.0, True),
        ("dead-zone", "level_cm", 1.0, 95.0, False),
        ("dead-zone", "speed_rpm", 1.0, 70.0, False),
        ("quadratic-drag", "deflection", 0.05, 83.0, True),  # for a cubic spring
        ("quadratic-drag", "deflection", 0.05, 95.0, False),
        ("quadratic-drag", "deflection", 0.5, 83.0, False),
        ("unsigned-speed", "speed_rpm", 0.05, 64.0, False),
    ],
)
def test_what_explains_a_process_or_a_spring_in_part_may_stand_for_other_physics(
    id: str,
    output: str,
    damping: float,
    closed: float,
    doubted: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sysid.diagnosis.session.least_damping", lambda _: damping)
    structured: Any = SimpleNamespace(p_value=0.0)
    monkeypatch.setattr(DiagnosisSession, "residual_structure", lambda *_, **__: structured)
    monkeypatch.setattr(DiagnosisSession, "gap", lambda *_: SimpleNamespace(closed_percent=closed))
    record = SimpleNamespace(outputs=(Channel(output),))
    study = session(parts=SimpleNamespace(estimation=(record,)))
    named = selection(node(10.0), node(5.0, id), selected(id, node(10.0)))
    assert (stand_in(study, named) is not None) is doubted


@pytest.mark.parametrize("damping", [0.05, 0.3, 1.5])
def test_the_damping_of_a_base_is_that_of_its_swing(damping: float) -> None:
    poles = np.roots([1.0, 2.0 * damping * 8.0, 64.0])  # s² + 2 ζ ω s + ω²
    f = np.poly(np.exp(poles * 0.05))[1:]
    model = FullModel((), 2, 1, np.ones(1), 0.05)
    q = model.null
    model.set_core(q, 0, 1.0, f)
    base: Any = SimpleNamespace(search=SimpleNamespace(model=model), model=SimpleNamespace(q=q))
    assert least_damping(base) == pytest.approx(min(damping, 1.0))


@pytest.mark.parametrize(
    ("after", "most"), [(0.12, True), (0.18, False)], ids=["most-of-it", "a-part-of-it"]
)
def test_a_third_effect_that_takes_most_of_what_two_leave_is_no_mend(
    after: float, most: bool
) -> None:
    """Both are far below 1 % of the gap of the base; what two leave is twice the noise."""
    rest, whole = node(0.2, "dead-time", "input-delay"), node(after, "dead-time", "supply-sag")
    assert explains_most_of_remainder(rest, whole, np.array([NOISE])) is most
    assert not explains_most_of_remainder(node(0.9 * NOISE), node(0.8 * NOISE), np.array([NOISE]))
