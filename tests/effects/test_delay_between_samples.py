"""A delay that ends within a sample: a first-order motion behind it is exact at the samples."""

import numpy as np
import pytest

from sysid.effects.actuator import DELAY_LINE, INPUT_DELAY
from sysid.effects.base import Context

DT, TAU = 0.05, 0.08


def context() -> Context:
    nothing = np.zeros(1)
    return Context(DT, *(nothing,) * 10)


@pytest.mark.parametrize("delay", [0.0, 0.01, 0.025, 0.049, 0.05, 0.0745, 0.2])
def test_a_motion_behind_a_delay_is_exact(delay: float) -> None:
    """ẏ = (u(t − θ) − y)/τ, the command held; the closed form piece by piece."""
    rng = np.random.default_rng(0)
    u = rng.uniform(-1.0, 1.0, 60)
    kept = np.exp(-DT / TAU)
    numbers = {"delay": np.array([delay])}
    constants = INPUT_DELAY.constants
    assert constants is not None
    numbers |= constants(np, numbers, DT, np.array([kept]))
    state, y, found = (np.zeros(1),) * DELAY_LINE, 0.0, []
    for d in u:
        acting, state = INPUT_DELAY.step(np, np.array([d]), state, numbers, context())
        y = kept * y + (1.0 - kept) * float(acting[0])
        found.append(y)
    changes = delay + DT * np.arange(len(u))  # from here on the next command acts

    def true(t: float) -> float:
        y, now, level = 0.0, 0.0, 0.0
        for at, after in zip(changes, u, strict=True):
            if at >= t:
                break
            y, now, level = level + (y - level) * np.exp(-(at - now) / TAU), at, after
        return float(level + (y - level) * np.exp(-(t - now) / TAU))

    expected = [true(DT * (k + 1)) for k in range(len(u))]
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("kept", [0.0, 1.0], ids=["no motion", "an integrator"])
def test_without_such_a_motion_the_mean_over_the_sample_acts(kept: float) -> None:
    constants = INPUT_DELAY.constants
    assert constants is not None
    found = constants(np, {"delay": np.array([0.06])}, DT, np.array([kept]))
    assert found["whole"] == 1.0
    np.testing.assert_allclose(found["old"], 0.2, atol=1e-12)
