"""Structures that run by their matrices: runs, slopes, offsets, what is stored."""

from dataclasses import replace

import control
import numpy as np
import pytest

import sysid
from sysid.data.record import Array, Record
from sysid.errors import UsageError
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus
from sysid.structures.model import Model
from sysid.structures.registry import structure_class
from sysid.structures.state_space.innovations import StateSpace
from sysid.structures.state_space.realization import run
from sysid.structures.state_space.structure import RealizedErrors

A = np.array([[0.9, 0.2, 0.0], [-0.2, 0.85, 0.1], [0.0, 0.0, 0.5]])
B = np.array([[0.4, 0.0], [0.1, 0.3], [0.0, 1.0]])
C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5]])
K = np.array([[0.3, 0.0], [0.1, 0.2], [0.0, 0.1]])


def stepped(A: Array, B: Array, C: Array, D: Array, u: Array, x: Array) -> Array:
    """Sample by sample, as the definition says."""
    y = []
    for row in u:
        y.append(C @ x + D @ row)
        x = A @ x + B @ row
    return np.array(y)


def mimo(n: int = 800, noise: float = 0.05, seed: int = 1) -> Record:
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((n, 2)), noise * rng.standard_normal((n, 2))
    driven = stepped(A, np.hstack([B, K]), C, np.zeros((2, 4)), np.hstack([u, e]), np.zeros(3))
    return Record(u, driven + e, 0.1)


@pytest.mark.parametrize("samples", [1, 5, 32, 33, 200])
def test_run_is_the_definition(samples: int) -> None:
    rng = np.random.default_rng(0)
    D, x0 = rng.standard_normal((2, 2)), rng.standard_normal(3)
    u = rng.standard_normal((samples, 2))
    np.testing.assert_allclose(
        run((A, B, C, D), u, x0), stepped(A, B, C, D, u, x0), rtol=1e-10, atol=1e-12
    )


def test_recovers_the_transfer_matrix_of_the_truth() -> None:
    model = sysid.fit(mimo(), "ss", "n=3")
    w = np.geomspace(0.1, 30.0, 20)
    _, got = model.bode(w)
    truth = control.StateSpace(A, B, C, 0, 0.1)
    wanted = np.moveaxis(truth(np.exp(1j * w * 0.1)), 2, 0)
    # 5 % noise, 800 samples: errors of a few thousandths of the largest gain
    assert np.max(np.abs(got - wanted)) < 0.02 * np.max(np.abs(wanted))
    own = np.sort(np.abs(model.poles()))
    np.testing.assert_allclose(own, np.sort(np.abs(np.linalg.eigvals(A))), atol=0.04)


def test_errors_are_white_only_with_the_kalman_gain() -> None:
    """The noise of the truth goes through K: without it, errors are coloured and larger."""
    record = mimo(noise=0.5)
    with_gain = sysid.fit(record, "ss", "n=3")
    without = sysid.fit(record, sysid.structure(record, "ss", "n=3", {"noise": "none"}))
    e, free = (np.std(m.residuals(record)[50:], axis=0) for m in (with_gain, without))
    np.testing.assert_allclose(e, 0.5, rtol=0.06)
    assert np.all(free > 1.1 * e)


def test_slopes_are_those_of_differences() -> None:
    record = mimo(200)
    s = structure_class("ss").from_orders({"n": 3}, 2, 2)
    assert isinstance(s, StateSpace)
    theta = s.theta_of((A, B, C, np.zeros((2, 2)), K))
    assert theta is not None
    for ahead in (True, False):
        problem = RealizedErrors(s, [(record.u, record.y)], True, ahead)
        p = np.concatenate([theta, [0.1, -0.2, 0.3]])
        J = problem.jacobian(p)
        for k in range(len(p)):
            h = np.zeros(len(p))
            h[k] = 1e-6
            by_difference = (problem.residual(p + h) - problem.residual(p - h)) / 2e-6
            np.testing.assert_allclose(J[:, k], by_difference, atol=1e-6)


def test_any_basis_gives_the_same_runs() -> None:
    s = StateSpace((), 2, 2, 3, 1)
    theta = s.theta_of((A, B, C, np.zeros((2, 2)), K))
    assert theta is not None
    u = np.random.default_rng(2).standard_normal((100, 2))
    wanted = stepped(A, B, C, np.zeros((2, 2)), u, np.zeros(3))
    np.testing.assert_allclose(s.simulate(theta, u), wanted, atol=1e-10)


def test_offset_and_feedthrough() -> None:
    rng = np.random.default_rng(3)
    u = rng.standard_normal((800, 1)) + 4.0
    D = np.array([[0.7]])
    y = stepped(A[:1, :1], B[:1, :1], C[:1, :1], D, u, np.zeros(1)) + 10.0
    record = Record(u, y + 0.01 * rng.standard_normal(y.shape), 1.0)
    model = sysid.fit(record, "ss", "n=1 nk=0")
    table = {p.name: p for p in model.parameter_table()}
    assert abs(table["D1,1"].value - 0.7) < 4 * table["D1,1"].std_error + 1e-3
    assert model.fit_percent(record)["y"] > 98.0


def test_several_logs_and_free_runs() -> None:
    logs = [mimo(400, seed=k) for k in (1, 2)]
    made = sysid.structure(logs, "ss", "n=3")
    model = sysid.fit(logs, made, options=FitOptions(focus=Focus.SIMULATION))
    assert not any(p.name.startswith("K") for p in model.parameters)
    assert min(model.fit_percent(logs[0]).values()) > 85.0


def test_read_back_as_it_was(tmp_path: object) -> None:
    model = sysid.fit(mimo(400), "ss", "n=3")
    again = Model.from_json(model.to_json())
    u = np.ones((20, 2))
    np.testing.assert_array_equal(again.simulate(u), model.simulate(u))


def test_too_few_states_are_refused() -> None:
    with pytest.raises(UsageError, match="one an output"):
        sysid.fit(mimo(100), "ss", "n=1")


def test_poles_outside_are_brought_in() -> None:
    s = StateSpace((), 1, 1, 2, 1)
    theta = np.array([-1.1, 2.0, 1.0, 1.0, 0.0, 0.0])  # poles beyond 1
    assert not s.stable(theta)
    assert s.stable(s.stabilised(theta))
    assert replace(s, noise=False).n_plain == 4
