"""Feedback and a coloured disturbance: two stages take the bias away, the reference known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

import sysid
from sysid.data.record import Record
from sysid.estimation.identify import Request, identify
from sysid.estimation.selection.orders import search_orders
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
