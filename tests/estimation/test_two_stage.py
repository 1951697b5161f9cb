"""Feedback and a coloured disturbance: two stages take the bias away, the reference known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

import sysid
from sysid.data.record import Record
from sysid.errors import UsageError
from sysid.estimation.identify import Request, identify
from sysid.estimation.selection.orders import search_orders
from sysid.estimation.two_stage import with_innovations
from sysid.fitting.holdout import hold_out
from sysid.fitting.options import FitOptions

POLE, GAIN = 0.9, 0.1


def loop(colour: float, seed: int, n: int = 2500) -> Record:
    """y = GAIN q⁻¹/(1 − POLE q⁻¹) u + v under a PI controller; v white or a first-order process."""
    rng = np.random.default_rng(seed)
    r = np.repeat(rng.uniform(-1, 1, n // 25), 25)
    r[:25] = 0.0
    white, v = rng.standard_normal(n), np.zeros(n)
    u, y = np.zeros(n), np.zeros(n)
    x = total = 0.0
    for k in range(n):
        v[k] = colour * v[k - 1] * (k > 0) + np.sqrt(1.0 - colour**2) * 0.15 * white[k]
        y[k] = x + v[k]
        total += 0.15 * (r[k] - y[k])
        u[k] = 1.5 * (r[k] - y[k]) + total
        x = POLE * x + GAIN * u[k]
    return Record(u[:, None], y[:, None], 0.1, references=r[:, None], reference_names=("wish",))


def test_a_coloured_disturbance_does_not_bias_the_fit() -> None:
    errors: dict[str, list[float]] = {"with": [], "without": []}
    for seed in range(6):
        record = loop(0.97, seed)
        for name, log in (
            ("with", record),
            ("without", replace(record, references=None, reference_names=())),
        ):
            model = sysid.fit(log, "oe", "nb=1 nf=1 nk=1")
            said = any("two stages" in w for w in model.warnings)
            assert said == (name == "with")
            errors[name].append(float(model.theta[1]) + POLE)
    biases = {name: abs(float(np.mean(e))) for name, e in errors.items()}
    assert biases["with"] < 0.5 * biases["without"]


def test_a_white_disturbance_leaves_the_direct_fit() -> None:
    model = sysid.fit(loop(0.0, 1), "oe", "nb=1 nf=1 nk=1")
    assert not any("two stages" in w for w in model.warnings)
    assert abs(float(model.theta[1]) + POLE) < 0.01


def test_a_noise_model_needs_no_second_stage() -> None:
    model = sysid.fit(loop(0.97, 2), "arx", "na=4 nb=4 nk=1")
    assert not any("two stages" in w for w in model.warnings)


@pytest.mark.parametrize("seed", [1, 7])
def test_orders_are_searched_on_what_follows_from_the_reference(seed: int) -> None:
    log = loop(0.97, seed)
    grid = [{"nb": nb, "nf": nf, "nk": 1} for nf in (1, 2, 3) for nb in (1, 2)]
    logged = search_orders("oe", grid, hold_out([log]), FitOptions()).best.orders
    assert logged["nf"] == 2  # one too many, which follows the disturbance
    found = identify([log], (), Request(structures=("oe",), orders="nb=1:2 nf=1:3 nk=1"))
    assert found.assessments[0].model.structure.order_values() == grid[0]


def leaders(colour: float, seed: int, reference: bool) -> tuple[str, str]:
    """The structure that leads, and why."""
    log = loop(colour, seed, 3000)
    if not reference:
        log = replace(log, references=None, reference_names=())
    asked = Request(structures=("armax", "oe"), orders="na=1:2 nb=1 nc=1 nf=1:2 nk=1")
    found = identify([log], (), asked)
    return found.assessments[0].model.structure.name, found.reason


def test_of_models_that_tie_one_that_feedback_biases_does_not_lead() -> None:
    name, why = leaders(0.15, 0, reference=False)
    assert name == "armax"
    assert "oe nb=1 nf=1 nk=1 would lead, but feedback biases it" in why
    # unbiased where the disturbance is white, and where the input comes from the reference
    assert leaders(0.0, 0, reference=False)[0] == "oe"
    assert leaders(0.15, 0, reference=True)[0] == "oe"


def test_two_stages_are_those_of_the_paper() -> None:
    """Van den Hof & Schrama (1993): S as a finite impulse response, then an output-error fit."""
    log = loop(0.97, 3)
    assert log.references is not None
    r, u, y = log.references[:, 0], log.u[:, 0], log.y[:, 0]
    lags = np.column_stack([np.concatenate([np.zeros(k), r[: len(r) - k]]) for k in range(80)])
    clean = lags @ np.linalg.lstsq(lags, u, rcond=None)[0]

    def errors(p: np.ndarray) -> np.ndarray:
        return np.asarray(y - p[2] - lfilter([0.0, p[0]], [1.0, p[1]], clean))

    paper = least_squares(errors, [GAIN, -POLE, 0.0], x_scale=[0.01, 0.01, 0.01]).x
    model = sysid.fit(log, "oe", "nb=1 nf=1 nk=1")
    # two estimates of S, 80 and some 50 numbers: half of what either knows
    assert np.all(np.abs(model.theta - paper[:2]) < np.sqrt(np.diag(model.covariance)) / 2.0)


def test_errors_of_two_stages_are_those_that_are_told() -> None:
    """Twelve loops: their spread is that of y − G u; of y − G û errors came out half as large."""
    z = []
    for seed in range(200, 212):
        model = sysid.fit(loop(0.97, seed, 1500), "oe", "nb=1 nf=1 nk=1")
        z.append((model.theta - [GAIN, -POLE]) / np.sqrt(np.diag(model.covariance)))
    # 24 squares in pairs that go together: a mean of one ± 0.35
    assert 0.3 < np.mean(np.square(z)) < 2.2


JOINT = FitOptions(method="joint")  # type: ignore[arg-type]
TWO_STAGE = FitOptions(method="two-stage")  # type: ignore[arg-type]


def test_the_joint_method_is_that_of_the_book() -> None:
    """Regressions in plain loops: innovations of u, what of u follows from them, an output error.

    A quickly moving reference, whose innovations are large.
    """
    rng, n = np.random.default_rng(4), 2500
    r, w, u, y = np.zeros((4, n))
    x = total = v = 0.0
    for k in range(n):
        r[k] = 0.5 * r[k - 1] + rng.standard_normal() if k > 20 else 0.0
        v = 0.97 * v + 0.08 * rng.standard_normal()
        y[k] = x + v
        total += 0.15 * (r[k] - y[k])
        u[k] = 1.5 * (r[k] - y[k]) + total
        x = POLE * x + GAIN * u[k]
    lags = 20
    past = [u[lags - k : n - k] for k in range(1, lags + 1)]
    past += [y[lags - k : n - k] for k in range(lags + 1)]
    X = np.column_stack([*past, np.ones(n - lags)])
    w[lags:] = u[lags:] - X @ np.linalg.lstsq(X, u[lags:], rcond=None)[0]
    record = Record(u[:, None], y[:, None], 0.1)
    references = with_innovations([record])[0].references
    assert references is not None
    np.testing.assert_allclose(references[:, 0], w, atol=1e-9 * np.std(w))
    late = np.column_stack([np.concatenate([np.zeros(k), w[: n - k]]) for k in range(80)])
    clean = late @ np.linalg.lstsq(late, u, rcond=None)[0]

    def errors(p: np.ndarray) -> np.ndarray:
        return np.asarray(y - p[2] - lfilter([0.0, p[0]], [1.0, p[1]], clean))

    book = least_squares(errors, [GAIN, -POLE, 0.0], x_scale=[0.01, 0.01, 0.01]).x
    model = sysid.fit(record, "oe", "nb=1 nf=1 nk=1", JOINT)
    assert any("follows from its own innovations" in s for s in model.warnings)
    assert model.provenance.options["method"] == "joint"
    # of what follows from them there are two estimates, of 80 and some 50 numbers
    errors_told = np.sqrt(np.diag(model.covariance))
    assert np.all(np.abs(model.theta - book[:2]) < 1.5 * errors_told)
    assert np.all(np.abs(model.theta - [GAIN, -POLE]) < 3.0 * errors_told)


def test_two_stages_on_request_are_those_of_the_log() -> None:
    log = loop(0.97, 5)
    chosen, asked = (sysid.fit(log, "oe", "nb=1 nf=1 nk=1", o) for o in (None, TWO_STAGE))
    np.testing.assert_array_equal(asked.theta, chosen.theta)
    white = sysid.fit(loop(0.0, 1), "oe", "nb=1 nf=1 nk=1", TWO_STAGE)
    assert any("`method='two-stage'` asks" in s for s in white.warnings)


@pytest.mark.parametrize(
    ("options", "name", "orders", "words"),
    [
        (TWO_STAGE, "oe", "nb=1 nf=1 nk=1", "needs the controller's reference in every log"),
        (JOINT, "narmax", "na=1 nb=1 nk=1", "fits linear structures with inputs"),
    ],
)
def test_what_a_method_without_feedback_cannot(
    options: FitOptions, name: str, orders: str, words: str
) -> None:
    log = replace(loop(0.97, 5, 500), references=None, reference_names=())
    with pytest.raises(UsageError, match=words):
        sysid.fit(log, name, orders, options)


def test_orders_are_searched_on_what_follows_from_innovations() -> None:
    found = identify(
        [loop(0.97, 1)], (), Request(("oe",), orders="nb=1 nf=1:2 nk=1", options=JOINT)
    )
    model = found.assessments[0].model
    assert model.structure.order_values()["nf"] == 1
    assert model.provenance.options["inputs_by_reference"] == ["its own innovations"]
