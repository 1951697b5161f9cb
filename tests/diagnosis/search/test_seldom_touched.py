"""What acts seldom changes few blocks, and t stays below 2 however sure they are."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.diagnosis.policies import RULE
from sysid.diagnosis.search.evidence import Evidence, compare_errors
from sysid.fitting.holdout import Errors

EVERY = np.array([True])


def evidence(bursts: dict[int, float], tried: int = 30, samples: int = 2400) -> Evidence:
    """White errors, in which some of 24 blocks hold an error of a size that an effect removes."""
    rng = np.random.default_rng(5)
    after = rng.normal(0.0, 0.1, (samples, 1))
    before = after.copy()
    for block, size in bursts.items():
        before[100 * block + 40 : 100 * block + 60, 0] += size
    half = samples // 2
    old, new = (Errors((e[:half],), (e[half:],)) for e in (before, after))
    return compare_errors(old, new, 2, tried, EVERY, np.array([half]))


def test_few_blocks_of_very_different_sizes_are_evidence_by_their_ranks() -> None:
    one_is_far_larger = {1: 0.2, 3: 0.3, 5: 3.0, 7: 0.25, 9: 0.4, 14: 0.6, 16: 0.3, 18: 0.5}
    sizes = dict.fromkeys(range(0, 24, 2), 0.3) | one_is_far_larger
    found = evidence(sizes)
    assert found.t < RULE.t
    assert found.p_value < RULE.p
    assert found.accepted


@pytest.mark.parametrize("bursts", [{5: 3.0}, {5: 3.0, 14: 0.6, 16: 0.3}], ids=["one", "three"])
def test_one_or_a_few_blocks_are_not(bursts: dict[int, float]) -> None:
    found = evidence(bursts)
    assert found.ratio < 1.0 or found.delta_bic < 0.0
    assert not found.significant


def test_ranks_must_stand_the_correction() -> None:
    six = {1: 0.2, 3: 0.3, 5: 3.0, 14: 0.25, 16: 0.6, 18: 0.4}  # by ranks 1 in 64, of 30 tried
    assert not evidence(six).significant


def test_what_only_its_numbers_cost_acceptance_may_be_right_too() -> None:
    """A dead zone has two widths and friction one level: in a short log ΔBIC decides by that."""
    friction = Evidence(-6.3, 5.0, 1.0, 0.57, 0.003)
    dead_zone = Evidence(-2.1, 5.3, 1.0, 0.53, 0.002)
    assert not dead_zone.accepted
    assert dead_zone.rivals(friction)
    assert not dead_zone.rivals(replace(friction, delta_bic=-9.0))  # more than 6 apart
    assert not replace(dead_zone, ratio=0.95).rivals(friction)
    in_loop = replace(dead_zone, ratio=0.71, needed=0.7)  # whether to name, not what
    assert in_loop.rivals(replace(friction, ratio=0.67, needed=0.7))
    assert replace(dead_zone, delta_bic=-7.0).rivals(replace(friction, delta_bic=-90.0))
