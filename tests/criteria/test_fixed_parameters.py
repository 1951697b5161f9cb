"""Fixed and bounded parameters: a wrong one makes the residual tests alarm, a right one does not.

Every structure meets logs of its own kind with known truth. What a fit did not estimate it cannot
have taken from the residuals, so the tests must see it.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log
from scipy.signal import lfilter

from sysid.criteria.output_residuals import OutputResiduals
from sysid.criteria.residuals import whiteness_test
from sysid.data.record import Record
from sysid.estimation.assessment.figures import residual_tests
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.structures.base import Structure
from sysid.structures.orders import parse_orders
from sysid.structures.registry import structure_class

A, B, C = (1.0, -1.5, 0.7), (0.0, 1.0, 0.5), (1.0, 0.5)
"""Denominator, numerator (delay 1) and noise numerator of the linear plants."""

SIZE = 0.1
"""Noise over the output's spread."""


def _noisy(u: np.ndarray, clean: np.ndarray, noise: np.ndarray) -> Record:
    y = clean + SIZE * clean.std() / noise.std() * noise
    return Record(u[:, None], y[:, None], 0.1)


def _linear(noise: tuple[tuple[float, ...], tuple[float, ...]]) -> Callable[[int, int], Record]:
    """B/A u plus noise coloured by (numerator, denominator)."""

    def draw(seed: int, samples: int) -> Record:
        rng = np.random.default_rng([seed, samples])
        u = np.repeat(rng.uniform(-1.0, 1.0, samples // 4 + 1), 4)[:samples]
        return _noisy(u, lfilter(B, A, u), lfilter(*noise, rng.standard_normal(samples)))

    return draw


def _dead_zone(seed: int, samples: int) -> Record:
    """A dead zone from −0.3 to 0.3 before a first-order lag."""
    rng = np.random.default_rng([seed, samples])
    u = np.repeat(rng.uniform(-1.0, 1.0, samples // 4 + 1), 4)[:samples]
    v = np.where(np.abs(u) > 0.3, u - 0.3 * np.sign(u), 0.0)
    return _noisy(u, lfilter([0.0, 0.4], [1.0, -0.6], v), rng.standard_normal(samples))


def _motor(seed: int, samples: int) -> Record:
    """0.3 s·dω/dt = 2 (u − 0.6 sign ω) − ω with friction that sticks, every 0.05 s."""
    rng = np.random.default_rng([seed, samples])
    u = 6.0 * np.repeat(rng.uniform(-1.0, 1.0, samples // 15 + 1), 15)[:samples]
    w, speed, fine = 0.0, np.zeros(samples), 0.0005
    for k in range(samples):
        speed[k] = w
        for _ in range(100):
            drive = 2.0 * u[k] - w
            slip = np.sign(w) if w else np.sign(drive)
            push = drive - 1.2 * slip
            new = w + fine / 0.3 * push
            w = 0.0 if (w == 0.0 and abs(drive) <= 1.2) or new * w < 0.0 else new
    return _noisy(u, speed, rng.standard_normal(samples))


@dataclass(frozen=True)
class Kind:
    """A structure, logs of its own kind, and one wrong and one right value for a parameter."""

    structure: str
    orders: str
    draw: Callable[[int, int], Record]
    name: str
    wrong: float
    right: float
    options: dict[str, str] = field(default_factory=dict)

    def made(self) -> Structure:
        orders = parse_orders(self.orders) if self.orders else {}
        return structure_class(self.structure).from_orders(orders, 1, 1, self.options)


POLES = ((1.0,), A)
KINDS = {
    "arx": Kind("arx", "na=2 nb=2 nk=1", _linear(POLES), "a1", -1.2, -1.5),
    "arx gain": Kind("arx", "na=2 nb=2 nk=1", _linear(POLES), "b1", 0.7, 1.0),
    "armax": Kind("armax", "na=2 nb=2 nc=1 nk=1", _linear((C, A)), "a2", 0.5, 0.7, {}),
    "armax noise": Kind("armax", "na=2 nb=2 nc=1 nk=1", _linear((C, A)), "c1", -0.2, 0.5, {}),
    "oe": Kind("oe", "nb=2 nf=2 nk=1", _linear(((1.0,), (1.0,))), "f1", -1.3, -1.5),
    "bj": Kind("bj", "nb=2 nc=1 nd=1 nf=2 nk=1", _linear((C, (1.0, -0.8))), "f2", 0.5, 0.7),
    "hammerstein-wiener": Kind(
        "hammerstein-wiener",
        "nb=1 nf=1 nk=1",
        _dead_zone,
        "input.d_high",
        0.1,
        0.3,
        {"input": "dead-zone", "output": "identity"},
    ),
    "narmax": Kind(
        "narmax",
        "na=2 nb=2 nk=1",
        _linear(POLES),
        "y(t-1)",
        1.2,
        1.5,
        {"terms": "y(t-1), y(t-2), u(t-1), u(t-2)", "selection": "err"},
    ),
    "dc-motor": Kind(
        "dc-motor", "", _motor, "coulomb", 0.3, 0.6, {"input": "voltage", "friction": "coulomb"}
    ),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("how", ["fixed", "bounded"])
def test_a_wrong_value_is_seen_and_said(kind: str, how: str) -> None:
    case = KINDS[kind]
    log = case.draw(1, 700)
    if how == "fixed":
        options = FitOptions(fixed={case.name: case.wrong})
    else:  # the bound keeps the estimate from reaching the truth
        low = 0.0 if case.wrong > 0.0 else -10.0  # friction below zero would be its mirror image
        far = (low, case.wrong) if case.right > case.wrong else (case.wrong, 10.0)
        options = FitOptions(bounds={case.name: far})
    report = residual_tests(fit(case.made(), [log], options), [log])
    assert not report.passed
    (held,) = report.fixed
    assert (held.output, held.passed) == (case.name, False)
    assert ("larger" if case.right > case.wrong else "smaller") in held.sentence
    assert ("fixed at" if how == "fixed" else "bound") in held.sentence


@pytest.mark.parametrize("kind", KINDS)
def test_a_right_value_passes(kind: str) -> None:
    """Each log at 0.1 %, so that nine right cases all pass with a chance above 97 %."""
    case = KINDS[kind]
    log = case.draw(2, 700)
    model = fit(case.made(), [log], FitOptions(fixed={case.name: case.right}))
    report = residual_tests(model, [log])
    tests = (*report.independence, *report.fixed, *(t for t in report.whiteness if t.judged))
    assert min(t.p_value for t in tests) > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["arx", "oe"])
def test_alarm_rate_with_a_right_fixed_value(kind: str) -> None:
    """At a nominal 1 %, five or more alarms of 100 have a chance below 0.4 %."""
    case = KINDS[kind]
    alarms = {"independence": 0, "whiteness": 0, "fixed": 0}
    for seed in range(100):
        log = case.draw(seed, 400)
        model = fit(case.made(), [log], FitOptions(fixed={case.name: case.right}))
        report = residual_tests(model, [log])
        for name in alarms:
            alarms[name] += sum(not t.passed for t in getattr(report, name))
    assert max(alarms.values()) < 5, alarms


# ------------------------------------------------------------------ data not fitted to


@pytest.mark.slow
def test_alarm_rate_on_data_the_model_was_not_fitted_to() -> None:
    """Fitted to 150 samples, tested on 1000 others: parameter errors are no fault of the model."""
    case = KINDS["oe"]
    alarms = plain = 0
    for seed in range(100):
        model = fit(case.made(), [case.draw(seed, 150)])
        other = case.draw(seed + 1000, 1000)
        (test,) = residual_tests(model, [other], fitted=False).independence
        alarms += not test.passed
        errors = model.errors(other, 50)
        plain += not OutputResiduals.of(errors, other.u).independence().passed
    assert alarms < 5
    assert plain > 10, "else there is nothing to allow for"


def test_a_model_that_data_elsewhere_contradict_is_seen_there() -> None:
    """Fitted to one plant, tested on a log of another whose numerator is 20 % larger."""
    case = KINDS["oe"]
    model = fit(case.made(), [case.draw(3, 700)])
    other = case.draw(4, 700)
    grown = Record(1.2 * other.u, other.y, other.dt)
    assert residual_tests(model, [other], fitted=False).passed
    assert not residual_tests(model, [grown], fitted=False).passed


# ------------------------------------------------------------------ the statistic by lag


def test_the_parts_of_a_statistic_add_up_to_it() -> None:
    rng = np.random.default_rng(5)
    u = lfilter([1.0], [1.0, -0.9], rng.standard_normal((500, 2)), axis=0)
    e = rng.standard_normal((500, 2))
    e[3:, 0] += 0.3 * u[:-3, 1]
    for test in (OutputResiduals.of(e[:, 0], u).independence(), whiteness_test(e)):
        assert test.parts is not None
        assert float(np.sum(test.parts.values**2)) == pytest.approx(test.statistic, rel=1e-9)
        assert test.parts.values.shape == (2, len(test.parts.lags))
        assert (test.statistic <= test.limit) == test.passed
    found = OutputResiduals.of(e[:, 0], u).independence().parts
    assert found is not None
    signal, lag = np.unravel_index(int(np.argmax(np.abs(found.values))), found.values.shape)
    assert (signal, found.lags[lag]) == (1, 3)


# ------------------------------------------------------------------ what a user reads


@pytest.mark.parametrize("option", [("--fix", "a1=-1.2"), ("--bound", "a1=-1.2:0")])
def test_fit_says_that_the_data_contradict_a_value(
    tmp_path: Path, capsys: Capture, option: tuple[str, str]
) -> None:
    log = KINDS["arx"].draw(1, 700)
    path = write_log(tmp_path / "bench.csv", ["u", "y"], [log.u[:, 0], log.y[:, 0]])
    common = ("fit", path, "--structure", "arx", "--orders", "na=2 nb=2 nk=1", *option)
    found = run(capsys, *common, "--full")
    assert found.code == 0, found.err
    assert "a smaller value fits" in " ".join(found.err.split())
    assert "correlated with u, not white, fixed a1 contradicted" in found.out
    document = run(capsys, *common, "--json").document
    (model,) = document["models"]
    held = json.loads(json.dumps(model["residuals"]))["held_parameters"]
    assert [(h["output"], h["passed"]) for h in held] == [("a1", False)]
