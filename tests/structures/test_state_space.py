"""State space: subspace and refined estimates against truths solved by dense algebra."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Channel, Record
from sysid.errors import UsageError
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus
from sysid.structures.model import Model
from sysid.structures.state_space.innovations import StateSpace
from sysid.structures.state_space.subspace import subspace

A = np.array([[0.8, 0.3, 0.0], [-0.3, 0.8, 0.1], [0.0, 0.0, 0.6]])
B = np.array([[1.0, 0.0], [0.5, 0.3], [0.0, 1.0]])
C = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -0.5]])
Q, R = 0.02 * np.diag([1.0, 2.0, 0.5]), 0.1 * np.array([[1.0, 0.3], [0.3, 0.5]])
"""Two inputs, two outputs, three states; covariances of the noise on states and outputs."""

NOTHING = Detrend.none(2, 2)


def driven(
    samples: int, seed: int, noise: bool = True, feedback: Array | None = None
) -> tuple[Array, Array]:
    """u and y of the truth, sample by sample; u = r − F y(t−1) under feedback F."""
    rng = np.random.default_rng(seed)
    w = rng.multivariate_normal(np.zeros(3), Q, samples) * noise
    v = rng.multivariate_normal(np.zeros(2), R, samples) * noise
    u, y, x = rng.choice([-1.0, 1.0], (samples, 2)), np.zeros((samples, 2)), np.zeros(3)
    for t in range(samples):
        y[t] = C @ x + v[t]
        if feedback is not None and t:
            u[t] -= feedback @ y[t - 1]
        x = A @ x + B @ u[t] + w[t]
    return u, y


def logs(samples: Sequence[int], **more: Array) -> list[Record]:
    """Records of several experiments."""
    inputs, outputs = (tuple(Channel(f"{s}{k}", "V") for k in (1, 2)) for s in "uy")
    return [
        Record(*driven(n, seed, **more), 0.1, inputs, outputs)  # type: ignore[arg-type]
        for seed, n in enumerate(samples)
    ]


def sorted_poles(matrix: Array) -> Array:
    return np.sort_complex(np.linalg.eigvals(matrix))


def markov(matrices: Sequence[Array], gain: Array, count: int = 6) -> Array:
    """C Aᵏ G."""
    return np.array(
        [matrices[1] @ np.linalg.matrix_power(matrices[0], k) @ gain for k in range(count)]
    )


@pytest.mark.parametrize("cva", [True, False])
def test_the_subspace_of_a_log_without_noise_is_the_plant(cva: bool) -> None:
    looked = subspace([driven(400, 1, noise=False), driven(300, 2, noise=False)], False, 6, cva)
    assert looked is not None
    # what is left beyond the third is rounding, raised by the long regression
    assert looked.singular[3] < 1e-6 * looked.singular[2]
    found = looked.matrices(3)
    np.testing.assert_allclose(sorted_poles(found[0]), sorted_poles(A), atol=1e-6)
    np.testing.assert_allclose(markov((found[0], found[2]), found[1]), markov((A, C), B), atol=1e-6)


def kalman_gain() -> tuple[Array, Array]:
    """K and the covariance of the innovations, by the Riccati equation."""
    P = solve_discrete_are(A.T, C.T, Q, R)
    S = C @ P @ C.T + R
    return A @ P @ C.T @ np.linalg.inv(S), S


def fitted(records: Sequence[Record], focus: Focus = Focus.PREDICTION) -> Model:
    s = StateSpace.from_orders({"n": 3}, 2, 2)
    return fit(s, records, FitOptions(focus=focus), detrend=NOTHING)


@pytest.mark.parametrize(
    "feedback", [None, np.array([[0.3, 0.0], [0.1, 0.2]])], ids=["open", "closed"]
)
def test_plant_kalman_gain_and_innovations_are_found_with_their_errors(
    feedback: Array | None,
) -> None:
    """Two experiments, with and without a controller; θ is unique, so every entry has its error."""
    model = fitted(logs((1500, 1000), feedback=feedback))  # type: ignore[arg-type]
    assert model.termination.good
    assert model.stable
    K, S = kalman_gain()
    truth = model.structure.theta_of((A, B, C, np.zeros((2, 2)), K))  # type: ignore[attr-defined]
    errors = np.sqrt(np.diag(model.covariance))
    # of 18 entries none beyond 4 errors: 1 in 900
    assert np.all(np.abs(model.theta - truth) < 4.0 * errors)
    # a covariance of 2500 samples is known to 3 %
    np.testing.assert_allclose(model.noise_covariance, S, rtol=0.12, atol=0.02)
    # the free run of the plant under new inputs, in units of what it moves
    u = np.random.default_rng(9).standard_normal((200, 2))
    run, x = [], np.zeros(3)
    for row in u:
        run.append(C @ x)
        x = A @ x + B @ row
    off = model.simulate(u) - np.array(run)
    assert np.sqrt(np.mean(off**2)) < 0.05 * np.std(run)


def test_the_predictor_stays_bounded_and_the_plant_if_asked() -> None:
    """A record that grows: without a controller, with and without ``stable``."""
    rng = np.random.default_rng(8)
    u, y = rng.standard_normal((150, 1)), np.zeros((150, 1))
    for t in range(1, 150):
        y[t] = 1.02 * y[t - 1] + u[t - 1] + 0.1 * rng.standard_normal()
    record, s = Record(u, y, 0.1), StateSpace.from_orders({"n": 1}, 1, 1)
    free, held = (
        fit(s, [record], FitOptions(stable=held), detrend=Detrend.none(1, 1))
        for held in (False, True)
    )
    np.testing.assert_allclose(free.poles(), 1.02, atol=0.002)
    assert np.abs(held.poles()[0]) < 1.0
    for model in (free, held):
        assert np.abs(np.linalg.eigvals(s.realization(model.theta).predictor().A))[0] <= 1.01


def test_free_runs_leave_the_gain_out() -> None:
    model = fitted(logs((600,)), focus=Focus.SIMULATION)
    assert not any(p.name.startswith("K") for p in model.parameters)
    np.testing.assert_allclose(np.sort_complex(model.poles()), sorted_poles(A), atol=0.05)


def test_a_response_within_the_sample_is_d() -> None:
    u, y = driven(800, 3)
    y = y + u @ np.array([[0.5, 0.0], [0.0, -0.4]])
    record = Record(u, y, 0.1)
    s = StateSpace.from_orders({"n": 3, "nk": 0}, 2, 2)
    model = fit(s, [record], detrend=NOTHING)
    _, _, _, D = model.structure.matrices(model.theta)  # type: ignore[attr-defined]
    # the noise of 0.4 over √800 samples, at five errors
    np.testing.assert_allclose(D, [[0.5, 0.0], [0.0, -0.4]], atol=0.07)


def test_an_offset_is_estimated_with_the_matrices() -> None:
    u, y = driven(800, 5)
    record = Record(u + np.array([2.0, -1.0]), y + np.array([10.0, 3.0]), 0.1)
    model = fit(StateSpace.from_orders({"n": 3}, 2, 2), [record])
    level = C @ np.linalg.solve(np.eye(3) - A, B @ (model.detrend.u_offset - [2.0, -1.0])) + [
        10.0,
        3.0,
    ]
    np.testing.assert_allclose(model.detrend.y_offset, level, atol=0.5)
    np.testing.assert_allclose(np.sort_complex(model.poles()), sorted_poles(A), atol=0.05)


@pytest.mark.parametrize(
    ("raw", "words"),
    [({}, "needs n"), ({"n": 1}, "from 2"), ({"n": 31}, "to 30"), ({"n": 3, "na": 1}, "needs n")],
)
def test_orders_that_do_not_fit_are_refused(raw: dict[str, int], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        StateSpace.from_orders(raw, 2, 2)


def moesp(u: Array, y: Array, order: int, rows: int = 10) -> Array:
    """Poles by PO-MOESP (Verhaegen 1994, Automatica 30, 61), as the paper has it."""

    def hankel(x: Array, first: int) -> Array:
        columns = len(x) - 2 * rows + 1
        return np.vstack([x[first + k : first + k + columns].T for k in range(rows)])

    past = np.vstack([hankel(u, 0), hankel(y, 0)])
    R = np.linalg.qr(np.vstack([hankel(u, rows), past, hankel(y, rows)]).T)[1].T
    free, known = rows * u.shape[1], rows * u.shape[1] + len(past)
    U = np.linalg.svd(R[known:, free:known])[0][:, :order]
    ny = y.shape[1]
    return sorted_poles(np.linalg.lstsq(U[:-ny], U[ny:], rcond=None)[0])


def test_poles_in_noise_err_no_more_than_those_of_a_textbook() -> None:
    ours, theirs = [], []
    for record in logs([2000] * 8):
        looked = subspace([(record.u, record.y)], False, 6, cva=False)
        assert looked is not None
        ours.append(np.abs(sorted_poles(looked.matrices(3)[0]) - sorted_poles(A)))
        theirs.append(np.abs(moesp(record.u, record.y, 3) - sorted_poles(A)))
    # 24 poles each: the ratio of two such root mean squares is known to 20 %
    assert np.mean(np.square(theirs)) < 0.02**2
    assert np.mean(np.square(ours)) < 1.4 * np.mean(np.square(theirs))
