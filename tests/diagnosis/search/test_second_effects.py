"""A second effect beside a large one: looked for while it is above the noise, and no mere mend."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sysid.data.record import Channel
from sysid.diagnosis.base_model import Base
from sysid.diagnosis.rules.outside_catalogue import least_damping, outside_catalogue
from sysid.diagnosis.search.evidence import Evidence
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.selection import (
    CandidateModel,
    SelectedEffect,
    Selection,
)
from sysid.diagnosis.session import DiagnosisSession
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
    study = session(search=SimpleNamespace(needed=0.9), model=node(50 * NOISE))
    monkeypatch.setattr(DiagnosisSession, "noise_with", lambda study, _: study.noise)
    assert (study.remains(node(left * NOISE, "load-bias")) > 0.0) is searched


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
    monkeypatch.setattr("sysid.diagnosis.rules.outside_catalogue.least_damping", lambda _: damping)
    structured: Any = SimpleNamespace(p_value=0.0)
    monkeypatch.setattr(DiagnosisSession, "residual_structure", lambda *_, **__: structured)
    monkeypatch.setattr(DiagnosisSession, "gap", lambda *_: SimpleNamespace(closed_percent=closed))
    record = SimpleNamespace(inputs=(Channel("u", "V"),), outputs=(Channel(output),), nu=1, ny=1)
    study = session(parts=SimpleNamespace(estimation=(record,)))
    named = selection(node(10.0), node(5.0, id), selected(id, node(10.0)))
    assert (outside_catalogue(study, named) is not None) is doubted


@pytest.mark.parametrize("damping", [0.05, 0.3, 1.5])
def test_the_damping_of_a_base_is_that_of_its_swing(damping: float) -> None:
    poles = np.roots([1.0, 2.0 * damping * 8.0, 64.0])  # s² + 2 ζ ω s + ω²
    f = np.poly(np.exp(poles * 0.05))[1:]
    model = FullModel((), 2, 1, np.ones(1), 0.05)
    q = model.null
    model.set_core(q, 0, 1.0, f)
    base: Any = SimpleNamespace(search=SimpleNamespace(model=model), model=SimpleNamespace(q=q))
    base.poles = Base.poles.fget(base)  # type: ignore[attr-defined]
    assert least_damping(base) == pytest.approx(min(damping, 1.0))
