"""What shapes are made of: B-splines and plays, against SciPy and against their own recursion."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from sysid.diagnosis.shapes.over_command import played
from sysid.diagnosis.shapes.smoother import DEGREE, spline


@pytest.mark.parametrize(("low", "high", "pieces"), [(0.0, 1.0, 1), (-3.0, 7.0, 16)])
def test_splines_are_those_of_scipy(low: float, high: float, pieces: int) -> None:
    x = np.append(np.random.default_rng(0).uniform(low - 1.0, high + 1.0, 200), [low, high])
    step = (high - low) / pieces
    knots = low + step * np.arange(-DEGREE, pieces + DEGREE + 1)
    wanted = BSpline.design_matrix(np.clip(x, low, low + step * pieces), knots, DEGREE).toarray()
    # a few units in the last place of numbers up to 1, times the knots' own rounding
    np.testing.assert_allclose(spline(low, high, pieces)(x), wanted, atol=1e-13)


@pytest.mark.parametrize("starts", [(0, 300), (0, 1, 120, 300)])
def test_play_is_its_recursion(starts: tuple[int, ...]) -> None:
    d = np.cumsum(np.random.default_rng(1).standard_normal(300))
    widths = np.array([0.0, 0.5, 3.0])
    state, wanted = np.zeros(3), []
    for n, value in enumerate(d):
        state = np.full(3, value) if n in starts else state
        state = np.maximum(value - widths, np.minimum(value + widths, state))
        wanted.append(state)
    np.testing.assert_array_equal(played(d, widths, starts), wanted)
