"""Levenberg-Marquardt within bounds against SciPy's trust region."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from sysid.data.record import Array
from sysid.errors import Termination
from sysid.fitting.bounded_marquardt import bounded_marquardt

T = np.linspace(0.0, 3.0, 60)
Y = 2.0 * np.exp(-1.3 * T) + 0.1 * np.sin(7.0 * T)


def residual(x: Array) -> Array:
    """A decay with a weak prior on both parameters."""
    return np.concatenate([x[0] * np.exp(-x[1] * T) - Y, 1e-3 * x])


def jacobian(x: Array) -> Array:
    """∂r/∂x."""
    e = np.exp(-x[1] * T)
    return np.concatenate([np.stack([e, -x[0] * T * e], axis=1), 1e-3 * np.eye(2)])


@pytest.mark.parametrize("highest", [np.inf, 1.0])
def test_same_minimum_as_scipy(highest: float) -> None:
    lower, upper = np.zeros(2), np.array([np.inf, highest])
    start = np.array([1.0, 0.5])
    x, evaluations, ended = bounded_marquardt(residual, start, jacobian, (lower, upper), 1e-12, 60)
    wanted = least_squares(residual, start, jacobian, bounds=(lower, upper), xtol=1e-14)
    # the cost is flat to first order: parameters are known to the root of its tolerance
    np.testing.assert_allclose(x, wanted.x, atol=1e-5)
    assert ended.good
    assert evaluations < 60
    assert np.all((x >= lower) & (x <= upper))


def test_limit_is_kept() -> None:
    free = (np.full(2, -np.inf), np.full(2, np.inf))
    _, evaluations, ended = bounded_marquardt(residual, np.ones(2), jacobian, free, 1e-12, 2)
    assert (evaluations, ended) == (2, Termination.MAX_ITERATIONS)
