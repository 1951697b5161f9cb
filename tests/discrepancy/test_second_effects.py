"""A second effect beside a large one: looked for while it is above the noise, and no mere mend."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sysid.data.record import Channel
from sysid.discrepancy.proof.noise import NoiseFloor
from sysid.discrepancy.search.named_sets import Naming, Node
from sysid.discrepancy.search.naming import _mends
from sysid.discrepancy.study import Study
from sysid.fitting.holdout import Errors

NOISE = 0.1


def node(rmse: float, *effects: str) -> Node:
    """A model of one output with errors of this size on both parts."""
    errors = (np.full((100, 1), rmse),)
    return Node(effects, np.zeros(1), (), Errors(errors, errors), np.ones(1, dtype=bool))


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
    monkeypatch.setattr(Study, "residual_structure", lambda *_, **__: structured)
    base: Any = SimpleNamespace(search=SimpleNamespace(needed=0.9))
    floor = np.array([NOISE])
    study = Study(base, NoiseFloor(floor, floor, floor), np.ones(1), 0)
    naming = Naming(node(50 * NOISE), node(left * NOISE, "load-bias"), (), (), ())
    assert (study.remains(naming) > 0.0) is searched


@pytest.mark.parametrize(
    ("second", "after", "mends"),
    [("speed-ripple", 0.4, True), ("speed-ripple", 0.1, False), ("cross-coupling", 0.4, False)],
    ids=["look-alike-of-little", "look-alike-of-much", "another"],
)
def test_what_only_mends_the_formula_of_its_look_alike_is_no_second_effect(
    second: str, after: float, mends: bool
) -> None:
    """Beside gravity, which takes 99.75 of 100 % of the gap in the first case."""
    base, rest = node(5.0), node(0.45 if after > 0.2 else 1.0, "gravity-load")
    assert _mends(base, rest, node(after, "gravity-load", second)) is mends


def test_a_look_alike_must_take_more_of_the_gap_than_another_effect() -> None:
    """A curve by a stick's expo leaves 2 % of its gap to a formula that bends a little else."""
    base, rest, left = node(5.0), node(0.75, "concave-gain"), 0.4  # 1.6 % of the gap
    assert _mends(base, rest, node(left, "concave-gain", "input-saturation"))
    assert not _mends(base, rest, node(left, "concave-gain", "cross-coupling"))


@pytest.mark.parametrize(
    ("third", "after", "mends"),
    [
        ("input-saturation", 0.4, True),
        ("input-saturation", 0.1, False),
        ("sampling-lag", 0.4, False),
    ],
    ids=["of-little", "of-much", "how-the-log-was-made"],
)
def test_a_third_effect_of_little_mends_the_formulas_of_two(
    third: str, after: float, mends: bool
) -> None:
    two = ("sensor-bias", "dead-time")
    base, rest = node(5.0), node(0.45 if after > 0.2 else 1.0, *two)
    assert _mends(base, rest, node(after, *two, third)) is mends


@pytest.mark.parametrize(
    ("output", "closed", "doubted"),
    [("level_cm", 70.0, True), ("level_cm", 95.0, False), ("speed_rpm", 70.0, False)],
)
def test_what_explains_a_process_in_part_may_stand_for_other_physics(
    output: str, closed: float, doubted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    structured: Any = SimpleNamespace(p_value=0.0)
    monkeypatch.setattr(Study, "residual_structure", lambda *_, **__: structured)
    monkeypatch.setattr(Study, "gap", lambda *_: SimpleNamespace(closed_percent=closed))
    record = SimpleNamespace(outputs=(Channel(output),))
    base: Any = SimpleNamespace(parts=SimpleNamespace(estimation=(record,)))
    study = Study(base, NoiseFloor(np.ones(1), np.ones(1), np.ones(1)), np.ones(1), 0)
    naming = Naming(node(1.0), node(0.5, "dead-zone"), (), (), ())
    assert study.stand_in(naming) is doubted
