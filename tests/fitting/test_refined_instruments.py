"""Refined instrumental variables against the truth, the textbook's steps and least squares."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from sysid.data.record import Array, Record
from sysid.errors import UsageError
from sysid.estimation.identify import Request, identify
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.structures.base import Structure
from sysid.structures.continuous.transfer import ContinuousTransfer
from sysid.structures.linear.families import ARX, OE

TRUTH = np.array([1.0, 0.5, -1.5, 0.7])
DT = 0.05
OUTPUT_ERROR = OE.from_orders({"nb": 2, "nf": 2, "nk": 1}, 1, 1)
TRANSFER = ContinuousTransfer.from_orders({"np": 2, "nz": 1}, 1, 1, {"delay": "none"})
SRIV = FitOptions(method="sriv")  # type: ignore[arg-type]


def noise(rng: np.random.Generator, samples: int) -> Array:
    return lfilter([0.6], [1.0, -0.9], rng.standard_normal(samples))


def log(seed: int, samples: int = 1000) -> Record:
    """A plant whose output a slow disturbance adds to."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], samples // 5), 5)
    y = lfilter([0.0, *TRUTH[:2]], [1.0, *TRUTH[2:]], u) + noise(rng, samples)
    return Record(u[:, None], y[:, None], DT)


def in_seconds(seed: int, num: list[float], den: list[float], delay: int = 0) -> Record:
    """The same of a plant in continuous time, its input held."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], 100), 10)
    top, bottom, _ = cont2discrete((np.array(num), np.array(den)), DT)
    late = np.concatenate([np.zeros(delay), u])[: len(u)]
    x = lfilter(top.ravel(), bottom, late)
    return Record(u[:, None], (x + 0.3 * np.std(x) * noise(rng, len(u)))[:, None], DT)


def by_the_book(record: Record) -> Array:
    """Young (2011), Recursive Estimation and Time-Series Analysis, ch. 7: in plain loops."""
    u, y = record.u[:, 0], record.y[:, 0]

    def regressors(out: Array, u: Array) -> Array:
        return np.column_stack([u[1:-1], u[:-2], -out[1:-1], -out[:-2]])

    theta = np.linalg.lstsq(regressors(y, u), y[2:], rcond=None)[0]
    for _ in range(60):
        F = [1.0, *theta[2:]]
        x = lfilter([0.0, *theta[:2]], F, u)
        uf, yf, xf = (lfilter([1.0], F, s) for s in (u, y, x))
        Z, phi = regressors(xf, uf), regressors(yf, uf)
        theta = np.linalg.solve(Z.T @ phi, Z.T @ yf[2:])
    return np.asarray(theta)


def spread_and_bias(structure: Structure, records: list[Record], truth: Array) -> Array:
    """(θ̂ − θ)/σ of each log, (logs, n)."""
    found = [fit(structure, [r], SRIV, detrend="none") for r in records]
    return np.array([(m.theta - truth) / np.sqrt(np.diag(m.covariance)) for m in found])


def test_the_truth_is_found_within_the_errors_that_are_told() -> None:
    z = spread_and_bias(OUTPUT_ERROR, [log(seed) for seed in range(20)], TRUTH)
    assert np.all(np.abs(np.mean(z, axis=0)) < 4.0 / np.sqrt(20))
    # 80 numbers in fours that go together: a mean square of one, ± 0.3
    assert 0.4 < np.mean(np.square(z)) < 1.9


def test_the_truth_is_found_in_seconds() -> None:
    records = [in_seconds(seed, [2.0, 3.0], [1.0, 0.8, 4.0]) for seed in range(8)]
    z = spread_and_bias(TRANSFER, records, np.array([3.0, 2.0, 4.0, 0.8]))
    assert np.all(np.abs(np.mean(z, axis=0)) < 4.0 / np.sqrt(8))
    assert 0.3 < np.mean(np.square(z)) < 2.5


@pytest.mark.parametrize("seed", range(2))
def test_the_fixed_point_is_that_of_the_book(seed: int) -> None:
    record = log(seed)
    found = fit(OUTPUT_ERROR, [record], FitOptions(method="sriv", initial="zero"), detrend="none")  # type: ignore[arg-type]
    # the book's run from rest begins two samples later than ours
    errors = np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(found.theta - by_the_book(record)) < 0.02 * errors)


def test_it_ends_where_least_squares_end() -> None:
    two = OE.from_orders({"nb": [[1, 2]], "nf": [[2, 1]], "nk": [[1, 2]]}, 2, 1)
    parts = log(3), log(4)
    u = np.column_stack([r.u[:, 0] for r in parts])
    y = parts[0].y + lfilter([0.0, 0.0, 0.5, 0.2], [1.0, -0.8], u[:, 1])[:, None]
    cases: list[tuple[Structure, list[Record]]] = [
        (two, [Record(u[:500], y[:500], DT), Record(u[500:], y[500:], DT)]),
        (
            ContinuousTransfer.from_orders({"np": 2, "nz": 0}, 1, 1),
            [in_seconds(1, [3.0], [1.0, 2.0, 4.0], delay=3)],
        ),
    ]
    for structure, records in cases:
        found = fit(structure, records, SRIV, detrend="none")
        least = fit(structure, records, detrend="none")
        assert found.termination.good
        errors = np.sqrt(np.diag(least.covariance))
        assert np.all(np.abs(found.theta - least.theta) < 0.05 * errors)
        # measured outputs among the regressors change the errors by what a log's noise can
        assert np.allclose(np.sqrt(np.diag(found.covariance)), errors, rtol=0.35)


def test_what_it_cannot_do_is_refused() -> None:
    arx = ARX.from_orders({"na": 2, "nb": 2, "nk": 1}, 1, 1)
    with pytest.raises(UsageError, match="fits oe and tf, not arx"):
        fit(arx, [log(0)], SRIV, detrend="none")
    with pytest.raises(UsageError, match="no `robust`"):
        fit(OUTPUT_ERROR, [log(0)], FitOptions(method="sriv", robust=True), detrend="none")  # type: ignore[arg-type]


def test_rounds_that_do_not_settle_are_said_with_what_helps() -> None:
    options = FitOptions(method="sriv", max_evaluations=3)  # type: ignore[arg-type]
    asked = Request(("oe",), orders="nb=4 nf=4 nk=1", options=options)
    (found,) = identify([log(0)], (), asked).assessments
    assert [w for w in found.warnings if "did not settle" in w and "omit `method`" in w]
    assert not any("Stopped at the iteration limit" in w for w in found.warnings)
