"""State space beside nfoursid, where that is installed (the extra bench)."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.data.record import Array, Record
from sysid.estimation.pem import fit
from sysid.structures.state_space.innovations import StateSpace

RUNS = 10
TRUTH = np.array([0.75 + 0.3j, 0.75 - 0.3j])


def theirs(u: Array, y: Array) -> Array:
    """Poles by N4SID of nfoursid, 10 block rows."""
    frame = pytest.importorskip("pandas").DataFrame({"u": u, "y": y})
    made = pytest.importorskip("nfoursid.nfoursid").NFourSID(
        frame, ["y"], input_columns=["u"], num_block_rows=10
    )
    made.subspace_identification()
    return np.linalg.eigvals(made.system_identification(rank=2)[0].a)


def ours(u: Array, y: Array) -> Array:
    """Poles of ``ss`` of two states."""
    record = Record(u[:, None], y[:, None], 1.0)
    return fit(StateSpace.from_orders({"n": 2}, 1, 1), [record], detrend="none").poles()


def off(poles: Array) -> float:
    """Distance of a pair of poles from the truth."""
    upper = poles[np.argmax(poles.imag)]
    return float(abs(upper - TRUTH[0]))


def test_without_noise_both_find_the_plant_and_with_it_ours_errs_no_more() -> None:
    """The prediction error method attains the bound of Cramér and Rao, N4SID need not."""
    pytest.importorskip("nfoursid", reason="the extra bench is not installed")
    a = np.poly(TRUTH).real
    errors = []
    for seed in range(RUNS):
        rng = np.random.default_rng(seed)
        u, e = rng.standard_normal(1000), rng.standard_normal(1000)
        y = lfilter([0.0, 1.0, 0.5], a, u)
        if not seed:
            assert off(ours(u, y)) < 1e-6
            assert off(theirs(u, y)) < 1e-6
        noisy = y + lfilter([1.0, -0.2], a, e)
        errors.append((off(ours(u, noisy)), off(theirs(u, noisy))))
    of_ours, of_theirs = np.sqrt(np.mean(np.square(errors), axis=0))
    # an RMS of ten runs has a standard error of 1/√20 of itself
    assert of_ours < (1.0 + 2.0 / np.sqrt(2.0 * RUNS)) * of_theirs
