"""Lateral friction and its moment against the sum over the points of a track."""

import math

import numpy as np
import pytest

from sysid import floats
from sysid.vehicle.lateral_friction import nearest, sliding

Q, LENGTH = 100.0, 0.14


@pytest.mark.parametrize("motion", [(0.1, 2.0), (0.02, -1.0), (-0.3, 1.0), (0.2, 0.0), (0.0, -1.0)])
def test_a_sliding_track_feels_the_sum_over_its_points(motion) -> None:
    x = (np.arange(20_000) + 0.5) / 20_000 * LENGTH - LENGTH / 2.0
    each = Q * np.sign(motion[0] + motion[1] * x) * LENGTH / len(x)
    found = sliding(*motion, Q, LENGTH, floats)
    assert found.side == pytest.approx(each.sum(), abs=2e-3)  # a point counts 7e-4 N
    assert found.turning == pytest.approx((x * each).sum(), abs=1e-4)


def test_the_published_forms_hold_between_the_ends() -> None:
    """(2.35), (2.36): 4μl(mg/2L)|x_ICR| and 2μl(mg/2L)(L²/4 − x_ICR²); μWL/4 in the middle."""
    mu, weight, icr = 0.5, 15.6, 0.03
    found = sliding(-icr * 2.0, 2.0, mu * weight / LENGTH, LENGTH, floats)
    half = mu * weight / 2.0 / LENGTH
    assert found.side == pytest.approx(-4.0 * half * icr)
    assert found.turning == pytest.approx(2.0 * half * (LENGTH**2 / 4.0 - icr**2))
    spot = sliding(0.0, 1.0, mu * weight / LENGTH, LENGTH, floats)
    assert spot.turning == pytest.approx(mu * weight * LENGTH / 4.0)


@pytest.mark.parametrize("ease", [(1.0 / 1.6, 1.0 / 0.065), (1.0, 1.0 / 0.002), (1.0, 0.1)])
def test_the_nearest_point_leaves_a_motion_that_its_friction_belongs_to(ease) -> None:
    rng = np.random.default_rng(1)
    for force, moment in rng.normal(size=(200, 2)) * (20.0, 1.0):
        found = nearest((float(force), float(moment)), Q, LENGTH / 2.0, ease, floats)
        left = ease[0] * (force - found.side), ease[1] * (moment - found.turning)
        if found.sticks:
            assert left == (0.0, 0.0)
            continue
        slides = sliding(float(left[0]), float(left[1]), Q, LENGTH, floats)
        if abs(left[1]) * LENGTH / 2.0 < 1e-9 * abs(left[0]):
            assert abs(found.side) == pytest.approx(Q * LENGTH)
        assert found.side == pytest.approx(slides.side, rel=1e-6, abs=1e-6)
        assert found.turning == pytest.approx(slides.turning, rel=1e-6, abs=1e-6)


def test_nothing_is_taken_where_nothing_pushes_or_nothing_rubs() -> None:
    assert nearest((0.0, 0.0), Q, 0.07, (1.0, 10.0), floats) == (0.0, 0.0, True)
    ice = nearest((3.0, -2.0), 0.0, 0.07, (1.0, 10.0), floats)
    assert math.hypot(ice.side, ice.turning) < 1e-9
    assert ice.sticks is False
