"""Four-stage instrumental variables against the truth and against the textbook's own steps."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.data.record import Array, Record
from sysid.errors import UsageError
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.fitting.problem import Focus
from sysid.structures.linear.families import ARMAX, ARX, OE

A, B = np.array([1.0, -1.5, 0.7]), np.array([0.0, 1.0, 0.5])
TRUTH = np.array([-1.5, 0.7, 1.0, 0.5])
STRUCTURE = ARX.from_orders({"na": 2, "nb": 2, "nk": 1}, 1, 1)
IV4 = FitOptions(method="iv4")  # type: ignore[arg-type]


def log(seed: int, samples: int = 1500, inputs: int = 1) -> Record:
    """A plant whose output a slow disturbance moves: least squares of ARX are biased."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], (samples // 5, inputs)), 5, axis=0)
    v = 0.5 * lfilter([1.0], [1.0, -0.9], rng.standard_normal(samples))
    y = sum((k + 1) * lfilter(B, A, u[:, k]) for k in range(inputs)) + v
    return Record(u, y[:, None], 0.1)


def by_the_book(record: Record) -> Array:
    """Ljung (1999), §15.3, in its own words: loops, explicit filters, no code of the library."""
    u, y = record.u[:, 0], record.y[:, 0]

    def phi(out: Array) -> Array:
        return np.column_stack([-out[1:-1], -out[:-2], u[1:-1], u[:-2]])

    theta = np.linalg.lstsq(phi(y), y[2:], rcond=None)[0]
    for whitened in (False, True):
        x = lfilter([0.0, *theta[2:]], [1.0, *theta[:2]], u)
        P, Z, target = phi(y), phi(x), y[2:]
        if whitened:
            w = target - P @ theta
            rows = range(20, len(w))
            past = np.column_stack([[w[t - k] for t in rows] for k in range(1, 21)])
            ar = np.linalg.lstsq(past, w[20:], rcond=None)[0]
            P, Z, target = (lfilter([1.0, *-ar], [1.0], m, axis=0)[20:] for m in (P, Z, target))
        theta = np.linalg.solve(Z.T @ P, Z.T @ target)
    return np.asarray(theta)


def test_the_truth_is_found_where_least_squares_are_biased() -> None:
    found = [fit(STRUCTURE, [log(seed)], IV4, detrend="none") for seed in range(30)]
    plain = [fit(STRUCTURE, [log(seed)], detrend="none").theta for seed in range(30)]
    mean = np.mean([m.theta for m in found], axis=0)
    spread = np.std([m.theta for m in found], axis=0) / np.sqrt(30)
    assert np.all(np.abs(mean - TRUTH) < 4.0 * spread)
    assert np.abs(np.mean(plain, axis=0) - TRUTH)[0] > 10.0 * spread[0]
    z = [(m.theta - TRUTH) / np.sqrt(np.diag(m.covariance)) for m in found]
    # 120 of a mean square of one: 1.5 is beyond four standard errors
    assert 0.5 < np.mean(np.square(z)) < 1.5


@pytest.mark.parametrize("seed", range(3))
def test_the_steps_are_those_of_the_book(seed: int) -> None:
    record = log(seed)
    found = fit(STRUCTURE, [record], IV4, detrend="none")
    # Burg's autoregression against least squares: a tenth of a standard error
    errors = np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(found.theta - by_the_book(record)) < 0.1 * errors)


def test_several_inputs_and_records() -> None:
    structure = ARX.from_orders({"na": 2, "nb": 2, "nk": 1}, 2, 1)
    found = fit(structure, [log(1, inputs=2), log(2, inputs=2)], IV4, detrend="none")
    off = found.theta - np.array([-1.5, 0.7, 1.0, 0.5, 2.0, 1.0])
    assert np.all(np.abs(off) < 4.0 * np.sqrt(np.diag(found.covariance)))


@pytest.mark.parametrize(
    ("structure", "options", "says"),
    [
        (OE.from_orders({"nb": 2, "nf": 2, "nk": 1}, 1, 1), {}, "fits arx, not oe"),
        (STRUCTURE, {"focus": Focus.SIMULATION}, "no `focus`"),
        (STRUCTURE, {"robust": True}, "no `robust`"),
    ],
)
def test_what_it_cannot_do_is_refused(structure: ARX | OE, options: dict, says: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(UsageError, match=says):
        fit(structure, [log(0)], FitOptions(method="iv4", **options), detrend="none")


def test_the_example_of_soederstroem_and_stoica() -> None:
    """System Identification (1989), example 2.3, second system: a = −0.8, b = 1, c = −0.8, where
    least squares go to a − c λ²/E y² = −0.8 + 0.8 · 0.36/1.36 = −0.588."""
    rng = np.random.default_rng(5)
    u, e = rng.choice([-1.0, 1.0], 40_000), rng.standard_normal(40_000)
    y = lfilter([0.0, 1.0], [1.0, -0.8], u) + lfilter([1.0, -0.8], [1.0, -0.8], e)
    record = Record(u[:, None], y[:, None], 1.0)
    arx = ARX.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1)
    armax = ARMAX.from_orders({"na": 1, "nb": 1, "nc": 1, "nk": 1}, 1, 1)
    # standard errors of 40 000 samples are 0.004
    assert fit(arx, [record], detrend="none").theta == pytest.approx([-0.588, 1.0], abs=0.015)
    assert fit(arx, [record], IV4, detrend="none").theta == pytest.approx([-0.8, 1.0], abs=0.015)
    theta = fit(armax, [record], detrend="none").theta
    assert theta == pytest.approx([-0.8, 1.0, -0.8], abs=0.02)
