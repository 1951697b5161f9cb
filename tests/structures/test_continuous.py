"""Continuous-time structures: exact discretisation, dead times, and what a fit recovers."""

from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from scipy import optimize, signal
from scipy.linalg import expm

import sysid
from sysid.data.record import Array, Channel, Record
from sysid.errors import UsageError
from sysid.estimation import pem
from sysid.estimation.assessment.step_response import step_responses
from sysid.fitting.options import FitOptions
from sysid.methods.outcome import FitOutcome
from sysid.structures.continuous.process import Process
from sysid.structures.continuous.transfer import ContinuousTransfer
from sysid.structures.model import Model
from sysid.structures.state_space.structure import RealizedErrors

DT = 0.1


def finely(num: Any, den: Any, delay: float, u: Array, per: int = 50) -> Array:
    """y of G(s) e^{−τ s} at the samples, stepped ``per`` times a sample by matrix exponentials.

    Args:
        num, den: the highest power first.
    """
    sys = control.tf2ss(control.tf(num, den))
    n = sys.nstates
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n:] = sys.A, sys.B
    power = expm(whole * DT / per)
    held = np.concatenate([np.full(round(delay / DT * per), 0.0), np.repeat(u, per)])
    x, y = np.zeros(n), []
    for k in range(len(u) * per):
        if k % per == 0:
            y.append(float((sys.C @ x)[0]))
        x = power[:n, :n] @ x + power[:n, n] * held[k]
    return np.array(y)


def levels(n: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, n // 8 + 1), 8)[:n]
    u[:20] = 0.0
    return u


CASES: dict[str, Any] = {
    "P1D": ([2.0], [1.5, 1.0], 0.33, np.array([2.0, 1.5, 0.33])),
    "P2D": ([2.0], [0.6, 1.9, 1.0], 0.1, np.array([2.0, 1.5, 0.4, 0.1])),
    "P2DU": ([-3.0], [0.25, 0.2, 1.0], 0.02, np.array([-3.0, 0.5, 0.2, 0.02])),
    "P2DZ": ([2.0 * -0.4, 2.0], [0.6, 1.9, 1.0], 0.5, np.array([2.0, 1.5, 0.4, -0.4, 0.5])),
    "P1DI": ([0.7], [0.8, 1.0, 0.0], 0.18, np.array([0.7, 0.8, 0.18])),
    "P3": ([1.0], np.polymul([0.5, 1], np.polymul([1.0, 1], [0.2, 1])), 0.0, [1, 1.0, 0.5, 0.2]),
}


@pytest.mark.parametrize("kind", CASES)
def test_runs_are_those_of_the_plant(kind: str) -> None:
    num, den, delay, theta = CASES[kind]
    s = replace(Process.from_orders({}, 1, 1, {"type": kind}), dt=DT)
    u = levels(120, 0)
    got = s.simulate(np.asarray(theta, dtype=float), u[:, None])[:, 0]
    np.testing.assert_allclose(got, finely(num, den, delay, u), atol=1e-9)


@pytest.mark.parametrize("kind", ["P1D", "P2D", "P2DU", "P2DZ", "P1DI"])
def test_numbers_are_recovered_with_their_errors(kind: str) -> None:
    num, den, delay, theta = CASES[kind]
    u = levels(500, 4)
    y = finely(num, den, delay, u)
    y += 0.01 * np.std(y) * np.random.default_rng(5).standard_normal(len(y)) + 7.0
    record = Record(u[:, None], y[:, None], DT)
    model = sysid.fit(record, sysid.structure(record, "process", {}, {"type": kind}))
    for p, wanted in zip(model.parameter_table(), theta, strict=True):
        assert abs(p.value - wanted) < 4.0 * p.std_error, p.name
        assert p.std_error < 0.05 * max(abs(wanted), 0.5)


def test_time_constants_fall_unless_one_is_named() -> None:
    s = Process((), 2, 1, DT, True, 2, 0, 0, 0)
    theta = np.array([2.0, 0.4, 1.5, 0.1, 3.0, 0.2, 0.7, 0.0])
    table = s.parameters((Channel("a"), Channel("b")), (Channel("y"),))
    assert s.in_order(theta, table).tolist() == [0, 2, 1, 3, 4, 6, 5, 7]
    named = (table[0], replace(table[1], fixed=0.4), *table[2:])
    assert s.in_order(theta, named).tolist() == [0, 1, 2, 3, 4, 6, 5, 7]
    found = FitOutcome(s, table, theta, np.diag(theta), np.eye(8)[:, 1:2], at_bound=("T2[y,b]",))
    moved = found.permuted(s.in_order(theta, table))
    assert moved.theta.tolist() == np.diag(moved.covariance).tolist()
    assert moved.theta[1:3].tolist() == [1.5, 0.4]
    assert (moved.null[2, 0], moved.at_bound) == (1.0, ("T1[y,b]",))


def test_transfer_function_of_two_inputs_and_outputs() -> None:
    u = np.column_stack([levels(400, 1), levels(400, 2)])
    gains = np.array([[2.0, -1.0], [0.5, 3.0]])
    y = np.zeros((400, 2))
    for i in range(2):
        for j in range(2):
            y[:, i] += finely([gains[i, j]], [1.0 + i + j, 1.0], 0.05 * (1 + j), u[:, j], 20)
    y += 0.01 * np.random.default_rng(0).standard_normal(y.shape)
    record = Record(u, y, DT)
    model = sysid.fit(record, "tf", "np=1")
    w = np.array([1e-3])
    _, response = model.bode(w)
    np.testing.assert_allclose(np.real(response[0]), gains, rtol=0.02)
    assert min(model.fit_percent(record).values()) > 97.0


def test_slopes_are_those_of_differences() -> None:
    s = replace(Process.from_orders({}, 1, 1, {"type": "P2DUZ"}), dt=DT)
    u = levels(150, 3)[:, None]
    theta = np.array([1.5, 0.6, 0.3, 0.4, 0.234])
    problem = RealizedErrors(s, [(u, s.simulate(theta, u))], True, False)
    p = np.concatenate([1.1 * theta, [0.1, -0.1]])
    J = problem.jacobian(p)
    for k in range(len(p)):
        h = np.zeros(len(p))
        h[k] = 1e-7
        wanted = (problem.residual(p + h) - problem.residual(p - h)) / 2e-7
        np.testing.assert_allclose(J[:, k], wanted, atol=1e-5 * np.abs(wanted).max() + 1e-9)


def test_another_sample_time_is_the_same_plant() -> None:
    """The numbers are seconds: at half the sample time every second sample is the same."""
    s = replace(Process.from_orders({}, 1, 1, {"type": "P2D"}), dt=DT)
    theta = np.array([2.0, 1.5, 0.4, 0.33])
    u = levels(60, 6)[:, None]
    slow = s.simulate(theta, u)
    fast = replace(s, dt=DT / 2).simulate(theta, np.repeat(u, 2, axis=0))
    np.testing.assert_allclose(fast[::2], slow, atol=1e-12)


def test_in_python_control_it_is_the_formula() -> None:
    """With a dead time by Padé of order 4: exact to 1e-4 up to τ ω = 2."""
    s = replace(ContinuousTransfer.from_orders({"np": 2, "nz": 1}, 1, 1), dt=DT)
    theta = np.array([1.0, 0.5, 2.0, 0.3, 0.7])
    jw = 1j * np.array([0.1, 1.0, 3.0])
    wanted = (1.0 + 0.5 * jw) / (2.0 + 0.3 * jw + jw**2) * np.exp(-0.7 * jw)
    plant = control.StateSpace(*s.in_continuous_time(theta, DT))
    np.testing.assert_allclose(plant(jw), wanted, rtol=1e-4)


def test_a_discrete_model_in_continuous_time_has_the_same_samples() -> None:
    rng = np.random.default_rng(1)
    u = np.repeat(rng.standard_normal(100), 4)
    y = finely([2.0], [0.6, 1.9, 1.0], 0.0, u) + 1e-3 * rng.standard_normal(400)
    model = sysid.fit(Record(u[:, None], y[:, None], DT), "oe", "nb=2 nf=2 nk=1")
    again = control.c2d(model.to_control(continuous=True), DT)
    w = np.array([0.5, 5.0])
    own = model.bode(w)[1][:, 0, 0]
    np.testing.assert_allclose(again(np.exp(1j * w * DT)), own, rtol=1e-8)


def test_a_plant_without_dead_time_ends_at_the_bound() -> None:
    """Slopes are asked on both sides of Td = 0."""
    u = levels(400, 9)
    y = finely([2.0], [0.6, 1.9, 1.0], 0.0, u)
    y += 0.02 * np.random.default_rng(9).standard_normal(400)
    record = Record(u[:, None], y[:, None], DT)
    model = sysid.fit(record, sysid.structure(record, "process", {}, {"type": "P2DZ"}))
    (step,) = step_responses(model)
    assert abs(step.gain.value - 2.0) < 4.0 * step.gain.std_error
    s = model.structure
    theta = model.theta.copy()
    runs = []
    for delay in (-1e-7, 1e-7):
        theta[-1] = delay
        runs.append(s.simulate(theta, u[:, None]))
    np.testing.assert_allclose(runs[0], runs[1], atol=1e-5)


def test_read_back_as_it_was() -> None:
    u = levels(300, 7)
    y = finely([2.0], [1.5, 1.0], 0.33, u)
    record = Record(u[:, None], y[:, None] + 0.01 * np.cos(np.arange(300))[:, None], DT)
    model = sysid.fit(record, "process", "np=1")
    again = Model.from_json(model.to_json())
    np.testing.assert_array_equal(again.simulate(u[:, None]), model.simulate(u[:, None]))


@pytest.mark.parametrize("text", ["P4D", "2DZ", "P2DD", "P1U", "PxD"])
def test_unknown_types_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="no process model"):
        Process.from_orders({}, 1, 1, {"type": text})


def test_more_zeros_than_poles_are_refused() -> None:
    with pytest.raises(UsageError, match="fewer zeros"):
        ContinuousTransfer.from_orders({"np": 1, "nz": 1}, 1, 1)


@pytest.mark.parametrize(
    ("name", "orders", "options", "truth"),
    [
        ("process", {}, {"type": "P2"}, [2.0, 1.5, 0.4]),
        ("tf", {"np": 2, "nz": 1}, {"delay": "none"}, [3.0, 2.0, 4.0, 1.2]),
    ],
)
def test_a_fit_is_the_least_squares_of_scipy_over_its_own_runs(
    name: str, orders: dict[str, int], options: dict[str, str], truth: list[float]
) -> None:
    u, t = levels(300, 8), DT * np.arange(300)

    def output(theta: Array) -> Array:
        num, den = theta[:1], np.polymul([theta[1], 1.0], [theta[2], 1.0])
        if name == "tf":
            num, den = theta[1::-1], np.array([1.0, *theta[:1:-1]])
        return np.asarray(signal.lsim((num, den), u, t, interp=False)[1])

    y = output(np.array(truth))
    y = y + 0.05 * np.std(y) * np.random.default_rng(1).standard_normal(300)
    record = Record(u[:, None], y[:, None], DT)
    asked = FitOptions(initial="zero")  # type: ignore[arg-type]
    made = sysid.structure(record, name, orders, options)
    model = pem.fit(made, [record], asked, detrend="none")

    def errors_of(theta: Array) -> Array:
        return y - output(theta)

    peer: Any = optimize.least_squares(errors_of, truth)
    errors = np.sqrt(np.diag(np.linalg.inv(peer.jac.T @ peer.jac)) * 2.0 * peer.cost / 297)
    assert np.all(np.abs(model.theta - peer.x) < 1e-3 * errors)
    np.testing.assert_allclose(np.sqrt(np.diag(model.covariance)), errors, rtol=0.01)


def test_the_sampled_servo_of_astroem_and_wittenmark() -> None:
    """1/(s (s + 1)) every second: (0.368 z + 0.264)/(z² − 1.368 z + 0.368), in e⁻¹ exactly."""
    s = replace(Process.from_orders({}, 1, 1, {"type": "P1I"}), dt=1.0)
    g = s.transfer(np.array([1.0, 1.0])).groups[0]
    e = np.exp(-1.0)
    np.testing.assert_allclose(g.num[0], [0.0, e, 1.0 - 2.0 * e], atol=1e-12)
    np.testing.assert_allclose(g.den, [1.0, -1.0 - e, e], atol=1e-12)


def test_a_step_of_the_search_that_overflows_is_no_run() -> None:
    """Rates as large as floating point has: e^{A Δt} is no number, and the step is refused."""
    rng = np.random.default_rng(5)
    log = Record(rng.standard_normal((60, 1)), rng.standard_normal((60, 1)), 0.1)
    structure = sysid.structure(log, "tf", "np=2 nz=1")
    problem = RealizedErrors(structure, [(log.u, log.y)], states=False, ahead=False)
    with np.errstate(all="ignore"):  # as the search runs it
        assert problem.runs(np.full(problem.n_theta, -1e300)) is None
