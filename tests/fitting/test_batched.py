"""Many small fits at once end where each of them ends alone, within bounds and after bad runs."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import least_squares

from sysid.data.record import Array, Index
from sysid.fitting.batched import (
    Damping,
    OneTrial,
    damped_steps,
    descend_alone,
    descend_together,
)

T = np.linspace(0.0, 4.0, 30)
TRUTH = np.array([[2.0, 0.8], [-1.0, 0.3], [0.5, 1.5]])
MEASURED = TRUTH[:, :1] * np.exp(-TRUTH[:, 1:] * T) + 0.05 * np.sin(9.0 * T)
EVERYWHERE = (np.array(-np.inf), np.array(np.inf))


@dataclass(frozen=True, eq=False)
class Decays:
    """a exp(−b t) of some of the fits."""

    theta: Array
    measured: Array

    @property
    def errors(self) -> Array:
        return self.measured - self.theta[:, :1] * np.exp(-self.theta[:, 1:] * T)

    @property
    def cost(self) -> Array:
        return np.sum(self.errors**2, axis=1, keepdims=True)

    def normal(self, of: Index) -> tuple[Array, Array]:
        a, b = self.theta[of, :1], self.theta[of, 1:]
        S = np.stack([np.exp(-b * T), -a * T * np.exp(-b * T)], axis=2)
        return S.transpose(0, 2, 1) @ S, np.einsum("ftk,ft->fk", S, self.errors[of])


def decays(theta: Array, which: Index) -> Decays:
    return Decays(theta[which], MEASURED[which])


@pytest.mark.parametrize("lowest", [-np.inf, 0.5])
def test_each_fit_ends_where_scipy_ends(lowest: float) -> None:
    start = np.tile([1.0, 1.0], (3, 1))
    bounds = (np.array([-np.inf, lowest]), np.array(np.inf))
    theta, cost = descend_together(
        decays, start, np.ones((3, 2), dtype=bool), bounds, Damping(), 60, 1e-14
    )
    for k, mine in enumerate(theta):
        alone = least_squares(
            lambda p, k=k: Decays(p[None], MEASURED[k : k + 1]).errors[0],
            start[k],
            bounds=([-np.inf, lowest], np.inf),
            xtol=1e-14,
            ftol=1e-14,
            gtol=1e-14,
        )
        # the cost is flat to the root of rounding around its minimum
        np.testing.assert_allclose(mine, alone.x, rtol=1e-5)
        assert cost[k, 0] == pytest.approx(2.0 * alone.cost, rel=1e-9)


def test_what_is_not_free_stays() -> None:
    start = np.tile([1.0, 1.0], (3, 1))
    free = np.array([[True, True], [True, False], [False, False]])
    theta, _ = descend_together(decays, start, free, EVERYWHERE, Damping(), 60, 1e-12)
    assert theta[1, 1] == 1.0
    assert theta[1, 0] != 1.0
    np.testing.assert_array_equal(theta[2], start[2])


def test_a_run_that_fails_is_stepped_back_from() -> None:
    """√x is no number below 0, where a full first step leads, and its slope at 0 is infinite."""

    def root(x: Array, _: Index) -> OneTrial:
        with np.errstate(divide="ignore"):
            inside = 0.5 / np.sqrt(x[0])
        return OneTrial(np.array([0.1]) - np.sqrt(x[0]), lambda: inside[:, None])

    found = descend_alone(root, np.array([4.0]), 60, 1e-14)
    assert found[0] == pytest.approx(0.01, rel=1e-6)
    assert descend_alone(root, np.zeros(1), 60, 1e-14)[0] == 0.0


def test_numbers_damped_alike_stay_where_they_are_hardly_felt() -> None:
    A, g = np.diag([1.0, 1e-8])[None], np.array([[1.0, 1e-4]])
    free, damping = np.ones((1, 2), dtype=bool), np.array([1e-3])
    by_slopes = damped_steps(A, g, free, damping)[0]
    alike = damped_steps(A, g, free, damping, alike=True)[0]
    assert by_slopes == pytest.approx([1.0 / 1.001, 1e4 / 1.001])
    assert alike == pytest.approx([1.0 / 1.001, 1e-4 / (1e-3 + 1e-8)])
