"""Fit figures, information criteria and the algebra of coloured residuals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from sysid.criteria import coloured
from sysid.criteria.coloured import AutoRegression, ar_fit, coloured_gram, effective_sample_size
from sysid.criteria.fit import complete_rows, fit_percent, rmse, rrse
from sysid.criteria.information import information_criteria, on_common_samples
from sysid.criteria.table import BUILT_IN, Loss, weighed
from sysid.errors import DataError

laws = settings(max_examples=40, deadline=None, derandomize=True)
seeds = st.integers(0, 10_000)
Y = np.array([[0.0, 1.0], [1.0, 1.0], [2.0, 1.0], [3.0, 1.0]])


# --- fit ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("y_hat", "expected"),
    [
        (Y, [100.0, np.nan]),
        (np.full_like(Y, 1.5), [0.0, np.nan]),
        (Y + np.array([1.0, 0.0]), [100.0 * (1.0 - np.sqrt(4.0 / 5.0)), np.nan]),
        (np.where(np.arange(4)[:, None] == 3, np.inf, Y), [-np.inf, np.nan]),
        (np.full_like(Y, np.nan), [np.nan, np.nan]),
    ],
    ids=["perfect", "mean", "offset", "runaway", "nothing-predicted"],
)
def test_fit_percent_of_closed_forms(y_hat: np.ndarray, expected: list[float]) -> None:
    # a few roundings of numbers near 100
    np.testing.assert_allclose(fit_percent(Y, y_hat), expected, atol=1e-12)


def test_error_sizes_of_closed_forms() -> None:
    y_hat = Y + np.array([[1.0, 0.0], [-1.0, 0.0], [3.0, 0.0], [-3.0, 0.0]])
    np.testing.assert_allclose(rmse(Y, y_hat), [np.sqrt(5.0), 0.0], rtol=1e-14)
    np.testing.assert_allclose(rrse(Y, y_hat)[0], 2.0, rtol=1e-14)  # √20 / √5


def test_samples_not_predicted_are_left_out_on_every_channel() -> None:
    rng = np.random.default_rng(1)
    y, y_hat = rng.standard_normal((2, 50, 2))
    y_hat[:3, 0] = np.nan
    for figure in (fit_percent, rmse):
        np.testing.assert_array_equal(figure(y, y_hat), figure(y[3:], y_hat[3:]))
        np.testing.assert_array_equal(figure(y, y_hat, 5), figure(y[5:], y_hat[5:]))
    np.testing.assert_array_equal(complete_rows(y - y_hat), (y - y_hat)[3:])


def test_records_are_pooled_about_their_own_means() -> None:
    """A model of the records' levels alone explains nothing, however far apart they are."""
    rng = np.random.default_rng(2)
    ys = [rng.standard_normal((40, 1)), 1000.0 + rng.standard_normal((60, 1))]
    levels = [np.full_like(y, y.mean()) for y in ys]
    # both norms carry rounding at level 1000: 1e-13 relative to a spread of 1
    np.testing.assert_allclose(fit_percent(ys, levels), 0.0, atol=1e-9)
    assert fit_percent(np.vstack(ys), np.vstack(levels))[0] > 99.0
    assert rmse(ys, levels) == pytest.approx(rmse(np.vstack(ys), np.vstack(levels)))


@laws
@given(seeds, st.floats(-150, 150), st.floats(-100, 100))
def test_fit_does_not_depend_on_unit_or_origin(seed: int, exponent: float, shift: float) -> None:
    y, y_hat = np.random.default_rng(seed).standard_normal((2, 30, 2))
    scale = 10.0**exponent
    # shifting by 100 costs three of sixteen digits of y − ȳ, ‖y − ŷ‖ is a few units
    moved = fit_percent(scale * (y + shift), scale * (y_hat + shift))
    np.testing.assert_allclose(moved, fit_percent(y, y_hat), rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: fit_percent(Y, Y[:3]), "same shapes"),
        (lambda: fit_percent([], []), r"shape \(N, n\)"),
        (lambda: fit_percent([Y, Y[:, :1]], [Y, Y[:, :1]]), r"shape \(N, n\)"),
        (lambda: fit_percent(np.zeros((2, 2, 2)), np.zeros((2, 2, 2))), r"shape \(N, n\)"),
        (lambda: information_criteria(np.full((5, 2), np.nan), 1), "longer record"),
        (lambda: Loss(0.0, 0, 1), "N ≥ 1"),
        (lambda: information_criteria(Y, -1), "n ≥ 0"),
        (lambda: on_common_samples([Y, Y[:2]]), "same records"),
        (lambda: ar_fit(Y), "one output"),
        (lambda: ar_fit(np.array([1.0, np.inf])), "unstable"),
        (lambda: ar_fit(np.full(4, np.nan)), "needs samples"),
        (lambda: ar_fit(np.ones(4), -1), "order ≥ 0"),
        (lambda: coloured_gram(Y, np.ones(3)), "4.*3"),
        (lambda: AutoRegression(np.ones(1), 1.0).gram(np.zeros((0, 2))), "one sample"),
    ],
)
def test_misfits_are_told_in_one_sentence(call: object, says: str) -> None:
    with pytest.raises(DataError, match=says):
        call()  # type: ignore[operator]


# --- information criteria ---------------------------------------------------------------------


SIZE_CRITERIA = [name for name, c in BUILT_IN.items() if not c.of_free_run]


def test_published_criteria() -> None:
    """A published example: N = 300, V = 1.6575, n = 6, to the digits printed."""
    found = weighed(Loss(float(np.log(1.6575)), 300, 6))
    printed = {"fpe": 1.7252, "aic": 1015.0, "aicc": 1015.2, "naic": 0.5453, "bic": 1037.2}
    for name, value in printed.items():
        digits = 1 if value > 100.0 else 4
        assert round(found[name], digits) == value, name
    assert found["mdl"] == pytest.approx(1.6575 * (1.0 + 6.0 * np.log(300.0) / 300.0), rel=1e-14)


def test_criteria_table_names_every_criterion() -> None:
    assert [n for n, c in BUILT_IN.items() if c.of_free_run] == ["fit", "rmse"]
    assert [n for n, c in BUILT_IN.items() if not c.smaller_is_better] == ["fit"]
    assert all(c.sentence.endswith(".") for c in BUILT_IN.values())


@laws
@given(seeds, st.integers(1, 3), st.integers(0, 12))
def test_criteria_of_errors_are_those_of_their_loss(seed: int, ny: int, n: int) -> None:
    errors = np.random.default_rng(seed).standard_normal((60, ny))
    loss = float(np.linalg.det(errors.T @ errors / 60))
    found, expected = information_criteria(errors, n), weighed(Loss(float(np.log(loss)), 60, n, ny))
    assert set(found) == set(SIZE_CRITERIA)
    for name in SIZE_CRITERIA:
        # determinants of well-conditioned 3 × 3 matrices: a few roundings
        assert found[name] == pytest.approx(expected[name], rel=1e-10, abs=1e-9)
    gaussian = -2.0 * sum(
        -0.5 * (ny * np.log(2.0 * np.pi) + np.log(loss) + e @ np.linalg.inv(cov) @ e)
        for cov in [errors.T @ errors / 60]
        for e in errors
    )
    assert found["aic"] == pytest.approx(gaussian + 2.0 * n, rel=1e-10)  # −2 ln L + 2n


@laws
@given(seeds, st.floats(-150, 150), st.floats(-150, 150))
def test_ranking_does_not_depend_on_units(seed: int, first: float, second: float) -> None:
    a, b = np.random.default_rng(seed).standard_normal((2, 40, 2))
    units = 10.0 ** np.array([first, second])
    before = information_criteria(a, 3)["aic"] - information_criteria(b, 5)["aic"]
    after = information_criteria(a * units, 3)["aic"] - information_criteria(b * units, 5)["aic"]
    # AIC itself reaches 40 · 2 · ln 1e300 ≈ 6e4, of which the difference keeps 1e-11
    assert after == pytest.approx(before, abs=1e-8)


@pytest.mark.parametrize(
    ("found", "infinite"),
    [
        (weighed(Loss(float(np.log(2.0)), 8, 6)), {}),
        (weighed(Loss(float(np.log(2.0)), 7, 6)), {"aicc": np.inf}),
        (weighed(Loss(float(np.log(2.0)), 6, 6)), {"aicc": np.inf, "fpe": np.inf}),
        (weighed(Loss(float(np.log(2.0)), 3, 6)), {"aicc": np.inf, "fpe": np.inf}),
        (weighed(Loss(-np.inf, 50, 2)), dict.fromkeys(("aic", "aicc", "naic", "bic"), -np.inf)),
        (
            information_criteria(np.zeros((50, 2)), 2),
            dict.fromkeys(("aic", "aicc", "naic", "bic"), -np.inf),
        ),
        (
            information_criteria(np.array([[np.inf], [1.0], [2.0], [1.0]]), 1),
            dict.fromkeys(SIZE_CRITERIA, np.inf),
        ),
    ],
    ids=["enough", "N=n+1", "N=n", "N<n", "V=0", "perfect", "runaway"],
)
def test_criteria_at_their_limits(found: dict[str, float], infinite: dict[str, float]) -> None:
    for name in SIZE_CRITERIA:
        value = found[name]
        assert value == infinite[name] if name in infinite else np.isfinite(value), name


def test_models_are_ranked_on_the_samples_all_of_them_predict() -> None:
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal((2, 30, 1))
    a[:4], b[10] = np.nan, np.nan
    first, second = on_common_samples([[a, a], [b, b]])
    for mine, given_errors in ((first, a), (second, b)):
        for record in mine:
            assert np.flatnonzero(np.isnan(record[:, 0])).tolist() == [0, 1, 2, 3, 10]
            known = ~np.isnan(record)
            np.testing.assert_array_equal(record[known], given_errors[known])


# --- coloured residuals -----------------------------------------------------------------------

POLES = {"white": [], "slow": [0.95, 0.7, -0.3], "ringing": [0.97 * np.exp(0.4j)], "fast": [-0.9]}


def _alpha(name: str) -> np.ndarray:
    poles = [q for p in POLES[name] for q in ({p, np.conj(p)} if np.iscomplex(p) else {p})]
    return np.real(np.atleast_1d(np.poly(poles)))


def _autocovariance(model: AutoRegression, lags: int) -> np.ndarray:
    h = lfilter([1.0], model.alpha, np.concatenate([[1.0], np.zeros(4000)]))
    return model.variance * np.array([h[: len(h) - k] @ h[k:] for k in range(lags)])


@pytest.mark.parametrize("name", POLES)
@pytest.mark.parametrize("block", [7, 300])
def test_gram_is_that_of_the_toeplitz_covariance(
    name: str, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(coloured, "BLOCK", block)
    model = AutoRegression(_alpha(name), 2.0)
    j = np.random.default_rng(4).standard_normal((200, 3))
    r = _autocovariance(model, 200)
    expected = j.T @ toeplitz(r) @ j
    # the impulse response is cut at 0.97^4000 ≈ 1e-53: only rounding differs
    np.testing.assert_allclose(model.gram(j), expected, rtol=1e-10, atol=1e-10 * expected.max())
    assert model.stationary_variance == pytest.approx(r[0], rel=1e-10)
    long_run = 2.0 * _autocovariance(model, 2000).sum() - r[0]
    assert model.long_run_variance == pytest.approx(long_run, rel=1e-9)


@pytest.mark.parametrize("name", POLES)
def test_ar_fit_recovers_its_truth_from_several_records(name: str) -> None:
    rng = np.random.default_rng(5)
    alpha = _alpha(name)
    records = [lfilter([1.0], alpha, rng.standard_normal(5500))[500:] for _ in range(4)]
    found = ar_fit(records, order=len(alpha) - 1)
    # coefficients of an AR(3) from 20 000 samples: standard error about 1/√N = 0.007, ×4
    np.testing.assert_allclose(found.alpha, alpha, atol=0.03)
    assert found.variance == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 20_000))


@laws
@given(seeds, st.integers(0, 30), st.sampled_from(["noise", "sine", "constant", "spike", "ramp"]))
def test_ar_fit_is_stable_and_finite_whatever_it_is_given(seed: int, order: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    t = np.arange(120.0)
    e = {
        "noise": rng.standard_normal(120),
        "sine": np.sin(rng.uniform(0.1, 3.0) * t),
        "constant": np.full(120, 1e-160),
        "spike": (t == rng.integers(120)) * 1e150,
        "ramp": t,
    }[kind]
    e = np.where(rng.random(120) < 0.05, np.nan, e)
    model = ar_fit(e, order)
    most = min(order, np.isfinite(e).sum() // 10)
    assert (most if kind == "noise" else 0) <= model.order <= most
    assert np.isfinite(model.gram(np.ones((50, 1)))).all()
    impulse = lfilter([1.0], model.alpha, np.concatenate([[1.0], np.zeros(20_000)]))
    # stable: an impulse response bounded by that of a few poles at the very edge of the circle
    assert np.abs(impulse[-100:]).max() <= np.abs(impulse).max()


def test_zero_residuals_have_no_colour() -> None:
    model = ar_fit(np.zeros(50))
    assert (model.order, model.variance) == (0, 0.0)
    assert effective_sample_size(np.zeros(50)) == 50.0
    assert coloured_gram(np.ones((50, 2)), np.zeros(50)).tolist() == [[0.0, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize(("pole", "per_sample"), [(0.0, 1.0), (0.8, 1.0 / 9.0), (-0.5, 3.0)])
def test_effective_sample_size_of_an_ar1(pole: float, per_sample: float) -> None:
    """N (1 − a)/(1 + a) for pole a: below N for slow noise, above for alternating."""
    e = lfilter([1.0], [1.0, -pole], np.random.default_rng(6).standard_normal(40_500))[500:]
    # spectral density at 0 from an AR(20) fit: relative error √(2·20/N) = 3 %, ×3
    assert effective_sample_size(e) == pytest.approx(per_sample * 40_000, rel=0.1)


def test_sandwich_covariance_matches_the_spread_of_estimates() -> None:
    """(JᵀJ)⁻¹JᵀΣ̂J(JᵀJ)⁻¹ tells the scatter of least squares in slow noise; σ²(JᵀJ)⁻¹ does not."""
    rng = np.random.default_rng(7)
    j = lfilter([1.0], [1.0, -0.9], rng.standard_normal((800, 1)), axis=0)
    inverse = 1.0 / (j.T @ j)[0, 0]
    estimates, sandwich, naive = [], [], []
    for _ in range(400):
        v = lfilter([1.0], [1.0, -0.9], rng.standard_normal(1300))[500:]
        theta = inverse * (j[:, 0] @ v)
        e = v - theta * j[:, 0]
        estimates.append(theta)
        sandwich.append(inverse**2 * coloured_gram([j[:300], j[300:]], [e[:300], e[300:]])[0, 0])
        naive.append(inverse * (e @ e) / 799)
    spread = np.var(estimates)
    # variance of 400 draws is known to √(2/400) = 7 %, the estimate takes a few percent too little
    assert np.mean(sandwich) == pytest.approx(spread, rel=0.25)
    assert np.mean(naive) < 0.3 * spread
