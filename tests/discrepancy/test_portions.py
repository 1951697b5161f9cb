"""Simulations of the super-model are parted into calls that end soon, side by side."""

import pytest

from sysid.discrepancy.search.supermodel import LANES, portions


@pytest.mark.parametrize("lanes", [1, 2, 3, 16, 17, 40, 64, 65, 97, 128, 129, 390, 1000])
def test_every_lane_goes_once_in_a_call_that_holds_it(lanes: int) -> None:
    parts = portions(lanes)
    assert sum(parts) == lanes
    assert min(parts) > 0
    assert max(parts) <= LANES[-1]


def test_single_runs_go_alone_and_few_lanes_keep_both_cores_busy() -> None:
    assert portions(1) == [1]
    assert portions(32) == [16, 16]
    assert portions(64) == [16] * 4  # two turns of the middle size beat one of the largest
    assert portions(128) == [64, 64]
