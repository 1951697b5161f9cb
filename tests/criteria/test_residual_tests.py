"""Residual tests: their algebra, their alarm rate on right models, their power on wrong ones.

The full table of rates is ``reports/residual_tests.md``; the same simulations run here in small.
"""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import toeplitz
from scipy.signal import lfilter
from scipy.special import chdtrc

from studies import residual_tests as study
from studies.residual_correlations import autocorrelation, cross_correlation
from sysid.criteria import portmanteau
from sysid.criteria.coloured import ar_fit
from sysid.criteria.output_residuals import OutputResiduals
from sysid.criteria.residuals import residual_report, whiteness_test
from sysid.errors import DataError

laws = settings(max_examples=12, deadline=None, derandomize=True)
seeds = st.integers(0, 10_000)

RIGHT = {c.name: c for c in study.RIGHT}
WRONG = {c.name: c for c in study.WRONG}


def _draw(seed: int, samples: int = 400, nu: int = 2, n: int = 3) -> tuple[np.ndarray, ...]:
    """Slow residuals and inputs and a Jacobian, unrelated."""
    rng = np.random.default_rng(seed)
    e = lfilter([1.0], [1.0, -0.7], rng.standard_normal(samples))
    u = lfilter([1.0], [1.0, -0.8], rng.standard_normal((samples, nu)), axis=0)
    return e, u, np.column_stack([rng.standard_normal((samples, n - 1)), u[:, 0]])


# --- algebra ------------------------------------------------------------------------------------


def _dense_independence(e: np.ndarray, u: np.ndarray, j: np.ndarray, lags: int) -> float:
    """The definition, with every matrix written out, for one record."""
    samples = len(e)
    known = ~np.isnan(e)
    model = ar_fit(np.where(known, e - np.nanmean(e), np.nan))
    h = lfilter([1.0], model.alpha, np.concatenate([[1.0], np.zeros(3000)]))
    r = model.variance * np.array([h[: len(h) - k] @ h[k:] for k in range(samples)])
    z = np.zeros((samples, u.shape[1] * (lags + 1)))
    centred = u - u.mean(axis=0)
    for i in range(u.shape[1]):
        for k in range(lags + 1):
            z[lags:, i * (lags + 1) + k] = centred[lags - k : samples - k, i]
    z[~known] = 0.0
    basis = np.linalg.qr(np.where(known[:, None], np.column_stack([j, np.ones(samples)]), 0.0))[0]
    z -= basis @ (basis.T @ z)
    c, sigma = z.T @ np.nan_to_num(e), toeplitz(r)
    share = np.trace(basis.T @ sigma @ basis) / (known.sum() * r[0])
    return float(c @ np.linalg.pinv(z.T @ sigma @ z / max(1.0 - share, 0.5), 1e-12) @ c)


@pytest.mark.parametrize("block", [64, 8192])
@pytest.mark.parametrize("missing", [False, True])
def test_independence_is_its_definition(
    block: int, missing: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(portmanteau, "BLOCK", block)
    e, u, j = _draw(1)
    if missing:
        e[[0, 1, 2, 200]] = np.nan
    found = OutputResiduals.of(e, u, j).independence(5)
    # u₁(t) is a column of J but Z lacks its first rows, so 12 instruments remain, one of them
    # nearly spent: C is conditioned like 1e3
    assert found.statistic == pytest.approx(_dense_independence(e, u, j, 5), rel=1e-8)
    assert found.dof == 12
    assert found.p_value == pytest.approx(chdtrc(found.dof, found.statistic), rel=1e-12)


def test_whiteness_is_ljung_box_for_a_long_series() -> None:
    e = np.random.default_rng(2).standard_normal(20_000)
    r = autocorrelation(e).values[1:, 0]
    box = len(e) * (len(e) + 2.0) * float(np.sum(r**2 / (len(e) - np.arange(1, 26))))
    found = whiteness_test(e)
    # the score form keeps the instruments' sample correlations, of size 1/√N = 0.7 %
    assert found.statistic == pytest.approx(box, rel=0.05)
    assert found.dof == 25


@laws
@given(seeds, st.floats(-8, 8), st.floats(-8, 8))
def test_units_and_parametrisation_do_not_matter(seed: int, first: float, second: float) -> None:
    e, u, j = _draw(seed)
    mixed = j @ np.random.default_rng(seed).uniform(1.0, 2.0, (3, 3)) @ np.diag([1.0, 1e-6, 1e6])
    units = 10.0 ** np.array([first, second])
    one = OutputResiduals.of(e, u, j)
    other = OutputResiduals.of(10.0**second * e - 3.0, u * units + units, mixed)
    for plain, moved in (
        (one.independence(), other.independence()),
        (one.feedback(), other.feedback()),
    ):
        # the fit of the shifted residual and the mixed basis cost digits: 1e-16 · 1e6 · cond
        assert moved.statistic == pytest.approx(plain.statistic, rel=1e-5)
        assert (moved.dof, moved.worst_lag) == (plain.dof, plain.worst_lag)


@laws
@given(seeds)
def test_collinear_inputs_add_no_evidence(seed: int) -> None:
    """Two inputs always commanded alike are one input."""
    e, u, j = _draw(seed, nu=1)
    once = OutputResiduals.of(e, u, j).independence(10)
    twice = OutputResiduals.of(e, np.column_stack([u, 2.0 * u, u]), j).independence(10)
    assert twice.dof == once.dof
    assert twice.statistic == pytest.approx(once.statistic, rel=1e-6)


def test_no_correlation_crosses_a_border_between_records() -> None:
    """An input that only the next record's residuals follow is no dependence."""
    rng = np.random.default_rng(3)
    u = [rng.standard_normal((30, 1)) for _ in range(40)]
    e = [0.1 * rng.standard_normal(30) for _ in range(40)]
    for before, after in zip(u[:-1], e[1:], strict=True):
        after[0] += 3.0 * before[-1, 0]
    whole = OutputResiduals.of(np.concatenate(e)[10:], np.concatenate(u)[10:])
    assert not whole.independence(5).passed
    assert OutputResiduals.of(e, u).independence(5).passed
    inside = cross_correlation(e, u, lags=2)
    across = cross_correlation(np.concatenate(e), np.concatenate(u), lags=2)
    # across: the 39 followers hold nearly all of ε's energy, so r ≈ √(39/1200) = 0.18 against a
    # band of 2.58/√1200 = 0.074; inside: chance
    assert abs(inside.values[3, 0]) < 1.5 * inside.bound[0]
    assert across.values[3, 0] > 2.0 * across.bound[0]


def test_correlations_are_their_sums() -> None:
    e, u, _ = _draw(4, 120)
    e[[0, 50]] = np.nan
    u *= [1.0, 1e6]
    filled = np.nan_to_num(e - np.nanmean(e))
    centred = u - u.mean(axis=0)
    found = cross_correlation(e, u, lags=30)
    known = centred * ~np.isnan(e)[:, None]
    norm = np.sqrt(filled @ filled * (known**2).sum(axis=0))
    for i, lag in enumerate(found.lags):
        t = np.arange(max(lag, 0), min(120, 120 + lag))
        expected = filled[t] @ centred[t - lag] / norm
        np.testing.assert_allclose(found.values[i], expected, atol=1e-14)  # FFT rounding
    auto = autocorrelation(e, lags=30)
    raw = np.nan_to_num(e)
    expected = [raw[: 120 - k] @ raw[k:] / (raw @ raw) for k in range(31)]
    np.testing.assert_allclose(auto.values[:, 0], expected, atol=1e-14)
    assert auto.bound[0] == pytest.approx(2.5758 / np.sqrt(118), rel=1e-4)


def test_cross_correlation_band_is_the_formula() -> None:
    """For AR(1) residuals and inputs P/(R_ε(0)R_u(0)) = (1 + ab)/(1 − ab)."""
    rng = np.random.default_rng(5)
    e, u = (lfilter([1.0], [1.0, -p], rng.standard_normal(100_000)) for p in (0.9, 0.8))
    widening = np.sqrt((1.0 + 0.72) / (1.0 - 0.72))
    found = cross_correlation(e, u).bound[0] / (2.5758 / np.sqrt(100_000))
    assert found == pytest.approx(widening, rel=0.03)  # autocovariances to √(2·10/N) = 1.4 %


# --- alarm rates on right models ------------------------------------------------------------------

REPLICATES = 60


@pytest.mark.parametrize(
    ("name", "replaced"),
    [
        ("ARX, slow input", None),
        ("ARX, little noise (3 %), slow input", None),
        ("OE, AR(1) noise, white input", "unprojected"),
        pytest.param("OE, AR(1) noise, steps", "naive_any", marks=pytest.mark.slow),
        pytest.param("OE, AR(2) noise, slow input", "unprojected", marks=pytest.mark.slow),
    ],
)
def test_right_models_alarm_at_the_nominal_rate(name: str, replaced: str | None) -> None:
    """At a true rate of 1 %, 5 alarms of 60 come up once in 3000; of single lags 2 % never."""
    found = study.rates([study.alarms(RIGHT[name], seed, 600) for seed in range(REPLICATES)])
    for test in ("independent", "feedback", "white"):
        assert found.get(test, 0.0) <= 100.0 * 4 / REPLICATES, test
    assert found["band_share"] < 2.0
    if replaced is not None:  # what these tests replace is wrong here, or nothing is shown
        assert found[replaced] > 100.0 * 5 / REPLICATES


def test_p_values_of_right_models_are_uniform() -> None:
    """Neither shy nor eager: Kolmogorov–Smirnov at 0.1 % (1.95/√n) over both kinds of test."""
    case = RIGHT["ARX, white input"]
    draws = [case.simulate(np.random.default_rng([9, s]), 1000) for s in range(100)]
    for p in (
        [whiteness_test(d.errors, d.jacobian).p_value for d in draws],
        [OutputResiduals.of(d.errors, d.inputs, d.jacobian).independence().p_value for d in draws],
    ):
        gap = np.abs(np.sort(p) - (np.arange(100) + 0.5) / 100).max()
        assert gap < 1.95 / np.sqrt(100)


# --- power on wrong models ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "alarm", "silent"),
    [
        ("ARX, a pole missing (na 1 for 2), slow input", "white", "feedback"),
        ("ARX, a pole missing (na 1 for 2), slow input", "independent", "feedback"),
        ("ARX, delay 1 too long, white input", "independent", "feedback"),
        ("OE, AR(1) noise, a pole missing, slow input", "independent", "feedback"),
        ("OE, AR(1) noise, a pole missing, steps", "independent", "feedback"),
        ("OE, AR(1) noise, delay 2 too short, slow input", "independent", "feedback"),
        ("OE, AR(1) noise, delay 2 too long, slow input", "independent", "feedback"),
        ("ARX right, but feedback with gain 0.5, as much noise as signal", "feedback", "white"),
    ],
)
def test_wrong_models_are_caught_and_by_the_right_test(name: str, alarm: str, silent: str) -> None:
    found = study.rates([study.alarms(WRONG[name], seed, 1000) for seed in range(20)])
    assert found[alarm] >= 95.0
    assert found[silent] <= 10.0


def test_the_missing_lag_and_signal_are_named() -> None:
    rng = np.random.default_rng(6)
    u = rng.standard_normal((1000, 2))
    e = rng.standard_normal(1000)
    e[7:] += 0.5 * u[:-7, 1]
    given = OutputResiduals.of(e, u, input_names=("pwm_l", "pwm_r"), output="omega_l")
    found = given.independence()
    assert (found.worst_signal, found.worst_lag, found.passed) == ("pwm_r", 7, False)
    for word in ("omega_l", "pwm_r 7 samples earlier", "delay nk"):
        assert word in found.sentence
    coupled = np.column_stack([e, np.roll(e, -3)])  # the second output tells the first beforehand
    white = whiteness_test(coupled, output=0, output_names=("omega_l", "omega_r"))
    assert (white.worst_signal, white.worst_lag, white.passed) == ("omega_r", 3, False)


# --- the report -----------------------------------------------------------------------------------


def test_report_is_json_and_tells_what_counts() -> None:
    case = RIGHT["OE, AR(1) noise, slow input"]
    data = case.simulate(np.random.default_rng(7), 1000)
    found = residual_report(data.errors, data.inputs, [data.jacobian], noise_model=False)
    document = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert document["independence"]["passed"] is True
    assert document["whiteness"] | {"passed": False, "judged": False} == document["whiteness"]
    assert document["feedback"]["judged"] is False
    assert document["passed"] is True
    assert not residual_report(data.errors, data.inputs, [data.jacobian]).passed


@pytest.mark.parametrize("controlled", [True, False])
def test_what_a_controller_does_at_once_is_no_missing_dynamics(controlled: bool) -> None:
    """u(t) from y(t): a right model's white residuals are in u(t), as a feedthrough's are."""
    rng = np.random.default_rng(4)
    e, r, u, x, integral = rng.standard_normal(3000), 0.0, np.zeros(3000), 0.0, 0.0
    for k in range(3000):
        r = rng.uniform(-20.0, 20.0) if k % 60 == 0 else r
        error = r - x - e[k] * controlled
        integral += 0.05 * error
        u[k] = 1.2 * error + integral
        x = 0.95 * x + 0.05 * 0.7 * u[k]
    residual = e if controlled else e + 0.05 * u
    report = residual_report(residual, u[:, None], noise_model=False)
    assert report.feedback[0].passed != controlled
    assert report.independence[0].passed == controlled


def test_level_is_shared_among_the_outputs() -> None:
    e, u, _ = _draw(8)
    errors = np.random.default_rng(8).standard_normal((400, 4))
    report = residual_report(errors, u, output_names=list("abcd"), input_names=("l", "r"))
    assert [t.output for t in report.independence] == list("abcd")
    assert {t.level for t in report.whiteness} == {1.0 - (1.0 - 0.99) / 4}
    for kind in ("whiteness", "independence", "feedback"):
        tests = getattr(report, kind)
        summary = report.as_dict()[kind]
        assert summary["p_value"] == min(1.0, 4.0 * min(t.p_value for t in tests))
        assert summary["passed"] == (summary["p_value"] >= 0.01) == all(t.passed for t in tests)
    assert e.flags.writeable  # arrays of the caller are not touched
    assert report.passed


# --- limits ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("test", "errors", "inputs", "dof", "says"),
    [
        ("independence", np.zeros(100), np.ones((100, 1)), 0, "excite"),
        ("independence", _draw(1)[0], np.ones((400, 1)), 0, "excite"),
        ("independence", _draw(1)[0], np.zeros((400, 0)), 0, "excite"),
        ("independence", np.zeros(400), _draw(1)[1], 0, "excite"),
        ("feedback", _draw(1)[0], np.sin(0.3 * np.arange(400)), 0, "predictable"),
        ("feedback", _draw(1)[0], np.ones(400), 0, "predictable"),
    ],
    ids=["all-zero", "constant", "no-input", "perfect-model", "sine", "constant-future"],
)
def test_nothing_to_test_passes_and_says_so(
    test: str, errors: np.ndarray, inputs: np.ndarray, dof: int, says: str
) -> None:
    found = getattr(OutputResiduals.of(errors, inputs), test)()
    assert (found.dof, found.p_value, found.passed, found.worst_lag) == (dof, 1.0, True, None)
    assert says in found.sentence


def test_zero_residuals_are_white_and_uncorrelated() -> None:
    assert whiteness_test(np.zeros((50, 2))).passed
    assert not autocorrelation(np.zeros(50)).values.any()
    assert not cross_correlation(np.zeros(50), np.ones((50, 2))).values.any()


@pytest.mark.parametrize("samples", [20, 21, 60])
def test_short_records_get_fewer_lags(samples: int) -> None:
    e, u, j = _draw(9, samples)
    report = residual_report(e, u, [j])
    assert report.whiteness[0].dof <= samples // 10
    assert report.independence[0].dof <= samples // 10 + 2
    assert autocorrelation(e, lags=500).lags[-1] == samples - 1


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda e, u, j: OutputResiduals.of(e[:10], u[:10], j[:10]), "at least 20 are needed"),
        (lambda e, u, j: OutputResiduals.of(e, u[:-1], j), "inputs of"),
        (lambda e, u, j: OutputResiduals.of(e, u, j[:-1]), "Jacobians of"),
        (lambda e, u, j: OutputResiduals.of(e, np.where(u > 1, np.nan, u), j), "not finite"),
        (lambda e, u, j: OutputResiduals.of(np.where(e > 1, np.inf, e), u, j), "unstable"),
        (lambda e, u, j: whiteness_test(np.where(e > 1, np.inf, e)), "unstable"),
        (lambda e, u, j: OutputResiduals.of(u, u), "one output"),
        (lambda e, u, j: OutputResiduals.of(np.full(400, np.nan), u), "no residual"),
        (lambda e, u, j: whiteness_test(np.full(400, np.nan)), "at least 20 are needed"),
        (lambda e, u, j: residual_report(u, u, [j]), "one for each"),
        (lambda e, u, j: cross_correlation(e, u[:5]), "inputs of"),
    ],
)
def test_misfits_are_told_in_one_sentence(call: object, says: str) -> None:
    with pytest.raises(DataError, match=says):
        call(*_draw(10))  # type: ignore[operator]
