"""Levenberg-Marquardt against MINPACK and the problems of Moré, Garbow & Hillstrom (1981)."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares, leastsq

from sysid.errors import Termination
from sysid.fitting.marquardt import Conditions, Method, marquardt, products

Array = NDArray[np.float64]
Function = Callable[[Array], Array]
TOLERANCE = 1e-12

T = np.arange(1.0, 61.0)
DECAY = 3.0 * np.exp(-0.1 * T) + 0.01 * np.sin(7.0 * T)


def rosenbrock(x: Array) -> Array:
    return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])


def rosenbrock_slope(x: Array) -> Array:
    return np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])


def badly_scaled(x: Array) -> Array:
    """Brown: the solution is (1e6, 2e-6)."""
    return np.array([x[0] - 1e6, x[1] - 2e-6, x[0] * x[1] - 2.0])


def badly_scaled_slope(x: Array) -> Array:
    return np.array([[1.0, 0.0], [0.0, 1.0], [x[1], x[0]]])


def powell(x: Array) -> Array:
    """The Jacobian is singular at the solution 0."""
    a, b, c, d = x
    return np.array(
        [a + 10.0 * b, np.sqrt(5.0) * (c - d), (b - 2.0 * c) ** 2, np.sqrt(10.0) * (a - d) ** 2]
    )


def powell_slope(x: Array) -> Array:
    a, b, c, d = x
    s, t, root = 2.0 * (b - 2.0 * c), 2.0 * np.sqrt(10.0) * (a - d), np.sqrt(5.0)
    return np.array(
        [[1.0, 10.0, 0.0, 0.0], [0.0, 0.0, root, -root], [0.0, s, -2.0 * s, 0.0], [t, 0.0, 0.0, -t]]
    )


def decay(x: Array) -> Array:
    return x[0] * np.exp(-x[1] * T) - DECAY


def decay_slope(x: Array) -> Array:
    e = np.exp(-x[1] * T)
    return np.column_stack([e, -x[0] * T * e])


PROBLEMS: dict[str, tuple[Function, Function, Array]] = {
    "Rosenbrock": (rosenbrock, rosenbrock_slope, np.array([-1.2, 1.0])),
    "Rosenbrock, far": (rosenbrock, rosenbrock_slope, np.array([-120.0, 100.0])),
    "Brown, badly scaled": (badly_scaled, badly_scaled_slope, np.array([1.0, 1.0])),
    "Powell, singular": (powell, powell_slope, np.array([3.0, -1.0, 0.0, 1.0])),
    "decay, residuals left": (decay, decay_slope, np.array([1.0, 0.5])),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_reaches_the_cost_of_minpack_in_as_many_evaluations(name: str) -> None:
    residual, slope, start = PROBLEMS[name]
    x, evaluations, termination = marquardt(residual, start, slope, Conditions(TOLERANCE, 500))
    theirs, _, facts, _, _ = leastsq(
        residual,
        start,
        Dfun=slope,
        full_output=True,
        ftol=TOLERANCE,
        xtol=TOLERANCE,
        gtol=1e-14,
        maxfev=500,
    )
    cost, their_cost = (float(r @ r) for r in (residual(x), residual(theirs)))
    assert termination.good
    # 1e-20 where the cost is 0, else the tolerance on cost
    assert cost <= their_cost * (1.0 + 1e-9) + 1e-20
    # the damping may differ within the slack of the trust radius, so paths part a little
    assert evaluations <= 1.3 * facts["nfev"] + 2


def test_a_linear_problem_takes_one_step() -> None:
    rng = np.random.default_rng(4)
    A, b = rng.standard_normal((40, 5)), rng.standard_normal(40)
    x, evaluations, _ = marquardt(
        lambda x: A @ x - b, np.zeros(5), lambda x: A, Conditions(1e-9, 50)
    )
    np.testing.assert_allclose(x, np.linalg.lstsq(A, b, rcond=None)[0], atol=1e-12)
    assert evaluations <= 3  # the start, the solution, and a step that confirms it


def test_a_direction_without_information_is_not_walked() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.standard_normal(40), rng.standard_normal(40)
    A = np.column_stack([a, a, np.zeros(40)])
    x, _, termination = marquardt(
        lambda x: A @ x - b, np.full(3, 7.0), lambda x: A, Conditions(1e-9, 50)
    )
    assert termination.good
    np.testing.assert_allclose(x[0] + x[1], a @ b / (a @ a), atol=1e-12)
    np.testing.assert_allclose(x[[0, 2]] - x[[1, 2]], [0.0, 0.0], atol=1e-12)
    assert x[2] == 7.0


@pytest.mark.parametrize(
    ("residual", "slope", "expected"),
    [
        (lambda x: np.array([3.0, x[0] - x[0]]), lambda x: np.zeros((2, 1)), "CONVERGED_GRADIENT"),
        (lambda x: np.zeros(3), lambda x: np.ones((3, 1)), "CONVERGED_GRADIENT"),
        (lambda x: np.ones(3), lambda x: np.full((3, 1), np.nan), "DIVERGED"),
        (lambda x: np.array([np.exp(-x[0]), 1e-9]), lambda x: np.array([[-np.exp(-x[0])], [0.0]]),
         "MAX_ITERATIONS"),
    ],
    ids=["flat", "solved", "not a number", "no minimum"],
)  # fmt: skip
def test_endings(residual: Function, slope: Function, expected: str) -> None:
    _, evaluations, termination = marquardt(residual, np.array([0.5]), slope, Conditions(1e-12, 8))
    assert termination is Termination[expected]
    assert evaluations <= 8


def test_a_step_into_overflow_is_taken_back() -> None:
    """The first Gauss-Newton step lands where the residual is huge."""

    def residual(x: Array) -> Array:
        return np.array([x[0] - 1.0, 0.1]) if abs(x[0]) < 5.0 else np.full(2, 1e100)

    def slope(x: Array) -> Array:
        return np.array([[0.05], [0.0]])  # twenty times too flat: the step overshoots

    x, _, termination = marquardt(residual, np.array([0.0]), slope, Conditions(1e-9, 200))
    assert abs(x[0]) < 5.0
    assert abs(x[0] - 1.0) < 1.0
    assert termination is not Termination.DIVERGED


def damped(x: Array) -> Array:
    """A decay with a weak prior on both parameters."""
    return np.concatenate([x[0] * np.exp(-x[1] * T) - DECAY, 1e-3 * x])


def damped_slope(x: Array) -> Array:
    return np.concatenate([decay_slope(x), 1e-3 * np.eye(2)])


@pytest.mark.parametrize("summed", [False, True])
@pytest.mark.parametrize("highest", [np.inf, 1.0])
def test_the_minimum_within_bounds_is_that_of_scipy(highest: float, summed: bool) -> None:
    lower, upper = np.zeros(2), np.array([highest, np.inf])
    start, c = np.array([0.5, 0.5]), Conditions(1e-12, 60, lower, upper)
    normal = products(damped_slope) if summed else None
    x, _, ended = marquardt(damped, start, damped_slope, c, normal)
    wanted = least_squares(damped, start, damped_slope, bounds=(lower, upper), xtol=1e-15)
    # the cost is flat to first order: parameters are known to the root of its tolerance
    np.testing.assert_allclose(x, wanted.x, atol=1e-5)
    assert ended.good
    assert np.all((x >= lower) & (x <= upper))


@pytest.mark.parametrize("bounded", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_hubers_loss_has_the_minimum_of_scipy(seed: int, bounded: bool) -> None:
    """Every tenth value is an outlier; both losses are 2 Σ ρ(r/k) k²."""
    rng = np.random.default_rng(seed)
    y = 3.0 * np.exp(-0.1 * T) + 0.02 * rng.standard_normal(len(T))
    y[::10] += rng.standard_normal(6)
    width = 0.03

    def error(x: Array) -> Array:
        return np.asarray(x[0] * np.exp(-x[1] * T) - y)

    limits = (np.zeros(2), np.array([2.9, 1.0])) if bounded else (None, None)
    c = Conditions(1e-12, 100, *limits, huber=np.full(len(y), width))
    x, evaluations, ended = marquardt(error, np.array([1.0, 0.5]), decay_slope, c)
    wanted = least_squares(
        error,
        np.array([1.0, 0.5]),
        decay_slope,
        bounds=limits if bounded else (-np.inf, np.inf),
        loss="huber",
        f_scale=width,
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-12,
    )
    np.testing.assert_allclose(x, wanted.x, rtol=1e-5)
    assert ended.good
    assert evaluations < 60


@pytest.mark.parametrize("method", list(Method))
def test_every_method_reaches_the_minimum(method: Method) -> None:
    """Gradient iterations take long and end early in a valley, the others do not."""
    start, c = np.array([2.0, 0.2]), Conditions(1e-10, 2000, method=method)
    x, evaluations, ended = marquardt(decay, start, decay_slope, c)
    best, few, _ = marquardt(decay, start, decay_slope, Conditions(1e-12, 100))
    assert ended.good
    np.testing.assert_allclose(x, best, rtol=1e-2 if method is Method.GRADIENT else 1e-6)
    if method is Method.GRADIENT:
        assert evaluations > 2 * few


def test_a_parameter_that_is_hardly_felt_cannot_run_away() -> None:
    def error(x: Array) -> Array:
        return np.array([x[0] + 1e-9 * x[1] - 1.0, 1e-9 * x[1] + 1.0])

    J = np.array([[1.0, 1e-9], [0.0, 1e-9]])
    c = Conditions(1e-9, 4, least_scale=np.array([0.0, 1e-2]))
    held, *_ = marquardt(error, np.zeros(2), lambda x: J, c)
    loose, *_ = marquardt(error, np.zeros(2), lambda x: J, Conditions(1e-9, 4))
    assert abs(held[1]) < 1e-3 * abs(loose[1])
    np.testing.assert_allclose(held[0], 1.0, atol=1e-3)
