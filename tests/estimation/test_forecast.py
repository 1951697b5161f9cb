"""Forecasts against closed forms, a Kalman filter by hand, and what was then measured."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made import hand_made

from sysid.data.record import Record
from sysid.errors import ModelError, UsageError
from sysid.estimation.assessment.forecast import forecast
from sysid.structures.model import Model
from sysid.structures.registry import structure_class
from sysid.structures.state_space.innovations import StateSpace


def model_of(name: str, orders: dict[str, int], theta: list[float], nu: int, var: float) -> Model:
    made = hand_made(structure_class(name).from_orders(orders, nu, 1), np.array(theta))
    sure = np.zeros_like(made.covariance)
    return replace(made, noise_covariance=np.array([[var]]), covariance=sure)


def log_of(model: Model, samples: int, seed: int) -> Record:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, len(model.inputs)))
    return Record(u, rng.standard_normal((samples, 1)), model.dt, model.inputs, model.outputs)


def test_a_first_order_series_forgets_as_its_pole_does() -> None:
    """ŷ(T+k) = aᵏ y(T), variance λ (1 − a²ᵏ)/(1 − a²)."""
    a, var = 0.9, 0.3
    model = model_of("ar", {"na": 1}, [-a], 0, var)
    log = log_of(model, 60, 1)
    found = forecast(model, log, 30)
    k = np.arange(1, 31)
    np.testing.assert_allclose(found.y[:, 0], a**k * log.y[-1, 0], rtol=1e-9)
    spread = var * (1.0 - a ** (2 * k)) / (1.0 - a**2)
    np.testing.assert_allclose(found.error[:, 0] ** 2, spread, rtol=1e-9)
    np.testing.assert_allclose(found.high - found.y, 1.96 * found.error)


def test_state_space_is_the_kalman_filter_by_hand() -> None:
    """Two outputs: x⁺ = A x + B u + K e while there are outputs, without e afterwards."""
    s = StateSpace.from_orders({"n": 3}, 1, 2)
    rng = np.random.default_rng(2)
    theta = 0.25 * rng.standard_normal(s.n_plain)
    noise = np.array([[0.5, 0.2], [0.2, 0.4]])
    model = replace(hand_made(s, theta), noise_covariance=noise)
    model = replace(model, covariance=np.zeros_like(model.covariance))
    assert model.stable
    u, y = rng.standard_normal((80, 1)), rng.standard_normal((80, 2))
    log = Record(u, y, model.dt, model.inputs, model.outputs)
    at, steps = 59, 15
    found = forecast(model, log, steps, at=at * model.dt)
    assert found.first == at + 1
    assert found.held == 20
    r = s.realization(theta)
    x, P = np.zeros(3), np.zeros((3, 3))
    for t in range(80):
        if t <= at:
            x = r.A @ x + r.B @ u[t] + r.K @ (y[t] - r.C @ x)
            continue
        k = t - at - 1
        if k < steps:
            # 60 samples of a filter with poles within 0.8: what is left of the start is below 1e-5
            np.testing.assert_allclose(found.y[k], r.C @ x, atol=1e-4)
            np.testing.assert_allclose(found.error[k] ** 2, np.diag(r.C @ P @ r.C.T + noise))
        x, P = r.A @ x + r.B @ u[t], r.A @ P @ r.A.T + r.K @ noise @ r.K.T
    np.testing.assert_array_equal(found.measured, y[at + 1 : at + 1 + steps])


@pytest.mark.parametrize(
    ("name", "orders", "theta"),
    [
        ("arx", {"na": 1, "nb": 1, "nk": 1}, [-0.8, 0.5]),
        ("armax", {"na": 1, "nb": 1, "nc": 1, "nk": 1}, [-0.8, 0.5, 0.4]),
        ("bj", {"nb": 1, "nc": 1, "nd": 1, "nf": 1, "nk": 1}, [0.5, 0.4, -0.6, -0.8]),
    ],
)
def test_every_step_is_the_prediction_so_far_ahead(
    name: str, orders: dict[str, int], theta: list[float]
) -> None:
    model = model_of(name, orders, theta, 1, 1.0)
    log = log_of(model, 100, 3)
    found = forecast(model, log, 10, at=79 * model.dt)
    for k in range(10):
        ahead = model.predict(log, k + 1, 0)[80 + k]
        np.testing.assert_allclose(found.y[k], ahead, rtol=1e-6, atol=1e-6)


def test_a_model_without_noise_model_has_a_band_that_stays() -> None:
    model = model_of("oe", {"nb": 1, "nf": 1, "nk": 1}, [0.5, -0.8], 1, 0.04)
    found = forecast(model, log_of(model, 50, 4), 20)
    np.testing.assert_allclose(found.error, 0.2)


def test_what_is_not_sure_of_parameters_widens_the_band() -> None:
    model = model_of("oe", {"nb": 1, "nf": 1, "nk": 1}, [0.5, -0.8], 1, 0.04)
    unsure = replace(model, covariance=np.diag([1e-2, 0.0]))
    log = log_of(model, 50, 4)
    log = Record(np.ones_like(log.u), log.y, model.dt, model.inputs, model.outputs)
    found = forecast(unsure, log, 5)
    # at rest y = b u / 0.2: an error of 0.1 of b is one of 0.5; what is left of the start adds
    np.testing.assert_allclose(found.error[-1], np.hypot(0.2, 0.5), rtol=0.02)


def test_bands_hold_what_comes() -> None:
    """2000 forecasts of 5 samples: 95 % ± 4 errors of such a share, neighbours being alike."""
    model = model_of("armax", {"na": 1, "nb": 1, "nc": 1, "nk": 1}, [-0.8, 0.5, 0.4], 1, 0.25)
    rng = np.random.default_rng(5)
    inside = []
    for _ in range(400):
        u, e = rng.standard_normal(60), 0.5 * rng.standard_normal(60)
        y = np.zeros(60)
        for t in range(1, 60):
            y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1] + e[t] + 0.4 * e[t - 1]
        log = Record(u[:, None], y[:, None], model.dt, model.inputs, model.outputs)
        found = forecast(model, log, 5, at=54 * model.dt)
        inside.append((found.low <= found.measured) & (found.measured <= found.high))
    share = np.mean(inside, axis=0)[:, 0]
    assert np.all(np.abs(share - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / 400))


def test_what_cannot_be_predicted_is_said() -> None:
    model = model_of("ar", {"na": 1}, [-0.9], 0, 1.0)
    log = log_of(model, 20, 1)
    with pytest.raises(UsageError, match="outside the log"):
        forecast(model, log, 5, at=99.0)
    with pytest.raises(UsageError, match="`steps`"):
        forecast(model, log, 0)
    narmax = structure_class("narmax")
    terms = {"terms": "y(t-1), u(t-1)", "selection": "err"}
    made = replace(
        narmax.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1, terms),
        output_range=((-3.0, 3.0),),
        input_range=((-1.0, 1.0),),
        input_step=(2.0,),
    )
    bent = hand_made(made, np.array([0.6, 0.5]))
    with pytest.raises(ModelError, match="not linear"):
        forecast(bent, log_of(bent, 20, 1), 5)
