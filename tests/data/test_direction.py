"""Which way signals go: what acts on an output, and what follows it."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from sysid.data.checks.direction import acts_on

Array = NDArray[np.float64]
N = 3000


def _lagged(x: Array, tau: float) -> Array:
    return np.asarray(lfilter([1.0 / tau], [1.0, -(1.0 - 1.0 / tau)], x))


@pytest.mark.parametrize("tau", [5.0, 20.0, 60.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_what_acts_and_what_follows(tau: float, seed: int) -> None:
    """A load, weather and a factor act; a current, sensors, what lies downstream, noise do not."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.choice([0.0, 0.3, 0.6, 1.0], N // 40), 40)
    load = 3.0 * _lagged(rng.normal(0.0, 1.0, N), 15.0)
    still = _lagged(5.0 * command + load, tau)
    noise = rng.normal(0.0, 0.02, (3, N))
    speed = still + noise[0]
    walk = np.cumsum(rng.normal(0.0, 0.1, N))
    factor = _lagged(np.repeat(rng.choice([0.2, 0.5, 1.0], N // 100), 100), 25.0)
    acting = {
        "load": (load + noise[1], speed),
        "weather": (np.round(walk, 1), _lagged(walk - 5.0 * command, tau) + noise[1]),
        "factor": (factor, _lagged(command * factor, tau) + noise[1]),
    }
    following = {
        "current": (2.5 * command - 0.5 * still + noise[1], speed),
        "second sensor": (_lagged(still, 2.0) + noise[1], speed),
        "downstream": (_lagged(still, 30.0) + noise[1], speed),
        "another walk": (walk, speed),
        "noise": (noise[2], speed),
        "clock": (np.arange(N, dtype=np.float64), speed),
    }
    rows = max(int(tau / 4.0), 1)
    told = {k: acts_on([(*v, command[:, None])], rows) for k, v in (acting | following).items()}
    assert told == {k: k in acting for k in told}


def test_short_and_lost_columns_act_on_nothing() -> None:
    """Too few blocks, or values that are missing."""
    y, u = np.random.default_rng(0).normal(0.0, 1.0, (2, 40))
    assert not acts_on([(y, y, u[:, None])], 10)
    assert not acts_on([(np.full(40, np.nan), y, u[:, None])], 1)
