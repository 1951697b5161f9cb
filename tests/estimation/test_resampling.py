"""Other sample times: python-control as peer, instants that both grids have, what is refused."""

import control
import numpy as np
import pytest
from hand_made import hand_made

from sysid.data.record import Array
from sysid.errors import ModelError, UsageError
from sysid.estimation.assessment.forecast import innovation_responses
from sysid.estimation.resampling import resampled
from sysid.structures.model import Model
from sysid.structures.registry import structure_class
from sysid.structures.state_space.innovations import StateSpace

PLANT = control.tf([2.0, 1.0], [1.0, 0.8, 4.0])


def sampled(dt: float) -> control.StateSpace:
    return control.ss(control.c2d(PLANT, dt, "zoh"))


def of_control(system: control.StateSpace):  # type: ignore[no-untyped-def]
    s = StateSpace.from_orders({"n": 2}, 1, 1, {"noise": "none"})
    theta = s.theta_of((system.A, system.B, system.C, system.D, np.zeros((2, 1))))
    assert theta is not None
    return hand_made(s, theta)


@pytest.mark.parametrize("ratio", [0.2, 0.5, 1.3, 2.0, 5.0])
def test_it_is_the_plant_sampled_so(ratio: float) -> None:
    model = of_control(sampled(0.05))
    found = resampled(model, 0.05 * ratio)
    assert found.dt == 0.05 * ratio
    peer = sampled(0.05 * ratio)
    for k in range(1, 6):
        ours = found.structure.matrices(found.theta)  # type: ignore[attr-defined]
        one, other = (
            m[2] @ np.linalg.matrix_power(m[0], k) @ m[1] for m in (ours, (peer.A, peer.B, peer.C))
        )
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)


def test_a_dead_time_takes_whole_multiples_alone() -> None:
    made = structure_class("oe").from_orders({"nb": 1, "nf": 1, "nk": 4}, 1, 1)
    model = hand_made(made, np.array([0.5, -0.8]))
    slow = resampled(model, 3 * model.dt)
    u = np.repeat(np.random.default_rng(0).standard_normal(30), 3)[:, None]
    np.testing.assert_allclose(slow.simulate(u[::3]), model.simulate(u)[::3], atol=1e-9)
    with pytest.raises(ModelError, match="whole multiple"):
        resampled(model, 0.5 * model.dt)


def test_process_models_keep_their_numbers() -> None:
    made = structure_class("process").from_orders({"np": 1}, 1, 1)
    model = hand_made(made, np.array([2.0, 0.4, 0.13]) if made.nu == 1 else np.zeros(0))
    found = resampled(model, 0.01)
    np.testing.assert_array_equal(found.theta, model.theta)
    assert found.structure.dt == 0.01  # type: ignore[attr-defined]


NOISY = {
    "arx": ({"na": 2, "nb": 1, "nk": 1}, [-1.5, 0.6, 0.1]),
    "armax": ({"na": 1, "nb": 1, "nc": 1, "nk": 1}, [-0.9, 0.1, 0.4]),
    "bj": ({"nb": 1, "nc": 1, "nd": 2, "nf": 1, "nk": 1}, [0.1, 0.3, -1.2, 0.5, -0.7]),
    "ss": ({"n": 2}, [-0.5, 1.4, 0.1, 0.2, 0.9, 0.6]),
}


def autocovariance(model: Model, step: int) -> Array:
    """Λ Σ h(l) h(l + τ) of the disturbance, τ = 0, step …"""
    h = innovation_responses(model, model.theta, 600)[:, 0, 0]
    every = [h[: len(h) - tau] @ h[tau:] for tau in range(0, 6 * step, step)]
    return model.noise_covariance[0, 0] * np.array(every)


@pytest.mark.parametrize("name", NOISY)
def test_the_disturbance_is_the_same_at_the_instants_that_remain(name: str) -> None:
    orders, theta = NOISY[name]
    model = hand_made(structure_class(name).from_orders(orders, 1, 1), np.array(theta))
    slow = resampled(model, 3 * model.dt)
    np.testing.assert_allclose(autocovariance(slow, 1), autocovariance(model, 3), rtol=1e-7)


def test_a_noise_model_between_samples_is_not_invented() -> None:
    orders, theta = NOISY["ss"]
    model = hand_made(structure_class("ss").from_orders(orders, 1, 1), np.array(theta))
    found = resampled(model, 1.5 * model.dt)
    assert "noise model is gone" in found.warnings[0]


def test_what_is_no_sample_time_is_refused() -> None:
    with pytest.raises(UsageError, match="positive"):
        resampled(of_control(sampled(0.05)), 0.0)
