"""Verdicts on nonlinear models: Billings & Voon's tests, their level, their power, their words.

The full table of rates is ``reports/nonlinear_tests.md``; the same simulations run here in small.
"""

import json

import numpy as np
import pytest

from studies import nonlinear_tests as study
from sysid.criteria.nonlinear import FURTHER, further_tests
from sysid.criteria.output_residuals import OutputResiduals
from sysid.criteria.residuals import residual_report
from sysid.data.record import Record
from sysid.errors import DataError
from sysid.estimation.assessment.figures import residual_tests
from sysid.estimation.assessment.findings import Policy, assess
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.structures.narmax.structure import NARMAX
from sysid.structures.registry import structure_class

RIGHT = {c.name: c for c in study.RIGHT}
WRONG = {c.name: c for c in study.WRONG}

# ------------------------------------------------------------------ level and power


def test_right_models_are_seldom_accused() -> None:
    alarms = judged = 0
    for case in RIGHT.values():
        for seed in range(12):
            found = case.draw(np.random.default_rng([seed, 300]), 300)
            tests = further_tests(
                OutputResiduals.of(found.errors, found.inputs, found.jacobian),
                noise_model=case.noise_model,
            )
            alarms += sum(t.judged and not t.passed for t in tests)
            judged += sum(t.judged for t in tests)
    # 1 % of about 250 is 2.5 with a spread of 1.6: eight would be 3.4 spreads off
    assert judged > 200
    assert alarms < 8


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("NARX without u², white input", "input squares"),
        ("ARX, bilinear noise u e, white input", "error products"),
        ("NARX, noise grows with |u|, white input", "error size"),
        ("Hammerstein without u², AR(1) noise, slow input", "input squares"),
    ],
)
def test_wrong_models_are_accused_of_what_they_lack(name: str, kind: str) -> None:
    case = WRONG[name]
    found = case.draw(np.random.default_rng([3, 1000]), 1000)
    tests = {
        t.name: t
        for t in further_tests(
            OutputResiduals.of(found.errors, found.inputs, found.jacobian),
            noise_model=case.noise_model,
        )
    }
    # the report says 99 % and more at 1000 samples
    assert not tests[kind].passed
    assert tests[kind].p_value < 1e-3
    assert tests[kind].sentence


def test_linear_tests_alone_do_not_see_a_missing_square() -> None:
    case = WRONG["NARX without u², white input"]
    found = case.draw(np.random.default_rng([5, 300]), 300)
    report = residual_report(found.errors, found.inputs, [found.jacobian], nonlinear=True)
    assert report.whiteness[0].passed
    assert report.independence[0].passed
    tests = {t.name: t for t in report.nonlinear}
    assert not tests["input squares"].passed
    assert tests["input squares"].worst_lag == 1


# ------------------------------------------------------------------ what they are


def test_nonlinear_models_stand_them_beside_the_linear_ones() -> None:
    found = RIGHT["NARX, white input"].draw(np.random.default_rng(1), 300)
    errors = np.column_stack([found.errors, found.errors])
    linear, both = (
        residual_report(errors, found.inputs, [found.jacobian] * 2, nonlinear=nonlinear)
        for nonlinear in (False, True)
    )
    assert not linear.nonlinear
    assert [t.name for t in both.nonlinear] == [name for name in FURTHER for _ in range(2)]
    assert [t.output for t in both.nonlinear] == ["output 1", "output 2"] * 3
    assert both.independence[0].p_value == linear.independence[0].p_value


def test_units_do_not_matter() -> None:
    found = WRONG["NARX without y u, white input"].draw(np.random.default_rng(2), 400)
    one = further_tests(OutputResiduals.of(found.errors, found.inputs, found.jacobian))
    two = further_tests(
        OutputResiduals.of(1e-3 * found.errors, 1e4 * found.inputs, 1e2 * found.jacobian)
    )
    for a, b in zip(one, two, strict=True):
        assert b.p_value == pytest.approx(a.p_value, rel=1e-6)


def test_two_levels_hide_their_square() -> None:
    rng = np.random.default_rng(4)
    u = np.repeat(rng.choice([-1.0, 1.0], 80), 5)
    given = OutputResiduals.of(rng.standard_normal(400), u[:, None])
    tests = {t.name: t for t in further_tests(given)}
    assert tests["input squares"].dof == 0
    assert tests["input squares"].passed
    assert "two levels" in tests["input squares"].sentence


def test_several_records_and_missing_residuals() -> None:
    rng = np.random.default_rng(6)
    errors = [rng.standard_normal(300), rng.standard_normal(200)]
    inputs = [rng.standard_normal((n, 2)) for n in (300, 200)]
    errors[0][:5] = np.nan
    tests = further_tests(OutputResiduals.of(errors, inputs, input_names=("a", "b")))
    assert tuple(t.name for t in tests) == FURTHER
    assert all(np.isfinite(t.p_value) and t.dof > 0 for t in tests)
    with pytest.raises(DataError):
        OutputResiduals.of(rng.standard_normal(10), rng.standard_normal((10, 1)))


# ------------------------------------------------------------------ with fitted models


def _log(samples: int = 1200, seed: int = 0) -> Record:
    """y = 0.7 y₁ + 0.5 u₁ + 0.2 u₁² + e."""
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-1.7, 1.7, samples), np.zeros(samples)
    for t in range(1, samples):
        y[t] = 0.7 * y[t - 1] + 0.5 * u[t - 1] + 0.2 * u[t - 1] ** 2 + 0.1 * rng.standard_normal()
    return Record(u[:, None], y[:, None], 0.1)


def _narmax(terms: str) -> NARMAX:
    options = {"terms": terms, "selection": "err"}
    return NARMAX.from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1, options)


RIGHT_TERMS = "constant, y(t-1), u(t-1), u(t-1)^2"
WRONG_TERMS = "constant, y(t-1), u(t-1), u(t-1)^3"


def test_a_right_narmax_passes_and_a_wrong_one_is_told_why() -> None:
    log = _log()
    right, wrong = (fit(_narmax(t), [log]) for t in (RIGHT_TERMS, WRONG_TERMS))
    report = residual_tests(right, [log])
    assert [t.name for t in report.nonlinear] == list(FURTHER)
    assert report.passed
    assert not residual_tests(wrong, [log]).passed
    judged = assess(wrong, ([log], "log"), None, Policy(), 0.0)
    assert any("square of u" in sentence for sentence in judged.warnings)
    document = json.loads(json.dumps(judged.to_json()["residuals"], allow_nan=False))
    assert set(document["nonlinear"]) == set(FURTHER)
    assert not document["nonlinear"]["input squares"]["passed"]


def test_linear_structures_are_judged_as_before() -> None:
    log = _log(400)
    s = structure_class("arx").from_orders({"na": 1, "nb": 1, "nk": 1}, 1, 1)
    report = residual_tests(fit(s, [log], FitOptions()), [log])
    assert report.nonlinear == ()
    assert report.as_dict()["nonlinear"] == {}


def test_words_of_a_fit_name_what_is_left() -> None:
    from sysid_cli.fit_report import residual_words

    log = _log()
    right, wrong = (
        residual_words(residual_tests(fit(_narmax(t), [log]), [log]).as_dict())
        for t in (RIGHT_TERMS, WRONG_TERMS)
    )
    assert right == "no linear effect left, white, nothing nonlinear left"
    assert "squares of inputs left" in wrong
