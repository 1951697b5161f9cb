"""Balanced truncation: the Hankel matrix as peer, the bound, and what is refused."""

import control
import numpy as np
import pytest
from hand_made import hand_made

import sysid
from sysid.data.record import Record
from sysid.errors import ModelError, UsageError
from sysid.estimation.assessment.forecast import innovation_responses
from sysid.estimation.reduction import reduced
from sysid.structures.model import Model
from sysid.structures.state_space.innovations import StateSpace


def fourth_order() -> Model:
    """Two fast poles whose effect is small."""
    rng = np.random.default_rng(0)
    plant = control.tf2ss(
        control.tf([1.0], [1.0, -1.6, 0.64], 0.1) + control.tf([0.02], [1.0, -0.5, 0.06], 0.1)
    )
    u = rng.standard_normal(1500)
    y = control.forced_response(plant, U=u).outputs + 1e-3 * rng.standard_normal(1500)
    return sysid.fit(Record(u[:, None], y[:, None], 0.1), "oe", "nb=3 nf=4 nk=1")


def test_the_change_stays_below_the_bound() -> None:
    found = reduced(fourth_order(), 2)
    assert found.model.structure.n_states(found.model.theta) == 2
    assert 0.0 < found.reached <= found.bound
    assert found.bound < 0.1 * float(np.max(found.singular))


def test_singular_values_are_those_of_the_hankel_matrix() -> None:
    """Of the impulse response: the definition, without Gramians."""
    model = fourth_order()
    found = reduced(model, 2)
    A, B, C, _ = model.structure.matrices(model.theta)  # type: ignore[attr-defined]
    h = [(C @ np.linalg.matrix_power(A, k) @ B)[0, 0] for k in range(400)]
    hankel = np.array([h[k : k + 200] for k in range(200)])
    peer = np.linalg.svd(hankel, compute_uv=False)
    np.testing.assert_allclose(found.singular[:2], peer[:2], rtol=1e-6)


def test_the_disturbance_stays() -> None:
    """Its slow part is foreseen: the error one step ahead is what a log of it shows."""
    structure = StateSpace.from_orders({"n": 3}, 1, 1)
    A = np.diag([0.95, 0.8, 0.1])
    B, K = np.array([[0.1], [0.2], [0.1]]), np.array([[0.3], [0.1], [0.3]])
    theta = structure.theta_of((A, B, np.ones((1, 3)), np.zeros((1, 1)), K))
    assert theta is not None
    model = hand_made(structure, theta)
    found = reduced(model, 1)
    assert found.reached <= found.bound
    h = innovation_responses(model, theta, 300)[:, 0, 0]
    v = np.convolve(np.random.default_rng(0).standard_normal(20_000), h)[300:20_000, None]
    e = found.model.structure.errors(found.model.theta, 0.0 * v, v, 0)[100:, 0]
    # of 19 600 squares: a standard error of 1 %
    assert np.var(e) == pytest.approx(found.model.noise_covariance[0, 0], rel=0.04)
    assert 1.01 < found.model.noise_covariance[0, 0] < 1.3
    assert np.var(e) < 0.5 * np.var(v)


def test_what_cannot_be_reduced_is_refused() -> None:
    model = fourth_order()
    with pytest.raises(UsageError, match="must be 1 to"):
        reduced(model, 9)
    rng = np.random.default_rng(1)
    u = rng.standard_normal((300, 1))
    ramp = np.cumsum(u, axis=0)
    drifting = sysid.fit(
        Record(u, ramp, 1.0),
        sysid.structure(Record(u, ramp, 1.0), "process", {}, {"type": "P0I"}),
    )
    with pytest.raises(ModelError, match="unit circle"):
        reduced(drifting, 1)
