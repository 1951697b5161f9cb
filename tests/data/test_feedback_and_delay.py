"""Feedback and long delays, seen in a log before any model: alarm rates, power, what is read."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import Capture, run, write_log
from scipy.signal import lfilter

from sysid.data.checks.control_law import control_law
from sysid.data.checks.delay import estimate_delays
from sysid.data.checks.feedback import feedback_tests
from sysid.data.facts import LogFacts
from sysid.data.inspection import inspect_records
from sysid.data.record import Channel, Record
from sysid.estimation.assessment.step_response import step_responses
from sysid.estimation.identify import Request, identify
from sysid.estimation.selection.delays import chosen_delay

DT = 0.1
RUN_IN = 200
A, B = (1.0, -1.5, 0.6), (0.1, 0.05)
"""The plant: poles at 0.75 ± 0.19j."""


def held(rng: np.random.Generator, samples: int, each: int) -> np.ndarray:
    return np.repeat(rng.uniform(-1.0, 1.0, samples // each + 1), each)[:samples]


def prbs(rng: np.random.Generator, samples: int) -> np.ndarray:
    return np.repeat(rng.choice([-1.0, 1.0], samples // 4 + 1), 4)[:samples]


def slow(rng: np.random.Generator, samples: int) -> np.ndarray:
    return lfilter([1.0], [1.0, -0.95], rng.standard_normal(samples + RUN_IN))[RUN_IN:]


def multisine(rng: np.random.Generator, samples: int) -> np.ndarray:
    phase = 2.0 * np.pi * np.outer(np.arange(samples), np.arange(1, 20)) / 200.0
    return np.cos(phase + rng.uniform(0.0, 2.0 * np.pi, 19)).sum(axis=1) / 5.0


def chirp(rng: np.random.Generator, samples: int) -> np.ndarray:
    k = np.arange(samples)
    return np.sin(2.0 * np.pi * (0.005 * k + 0.05 * k**2 / samples) + rng.uniform(0.0, 6.3))


INPUTS: dict[str, Callable[[np.random.Generator, int], np.ndarray]] = {
    "prbs": prbs,
    "steps": lambda rng, n: held(rng, n, 15),
    "white": lambda rng, n: rng.standard_normal(n),
    "slow": slow,
    "multisine": multisine,
    "chirp": chirp,
}


def open_loop(
    kind: str,
    seed: int,
    samples: int = 800,
    *,
    delay: int = 1,
    noise: tuple[float, ...] = (1.0,),
    bend: float = 0.0,
    ratio: float = 0.1,
) -> Record:
    """The plant behind a delay, driven by an input of some kind; ``bend`` adds u|u|."""
    rng = np.random.default_rng([seed, samples])
    u = INPUTS[kind](rng, samples)
    late = np.concatenate([np.zeros(delay), u[: samples - delay]])
    clean = lfilter(B, A, late + bend * late * np.abs(late))
    e = lfilter([1.0], noise, rng.standard_normal(samples + RUN_IN))[RUN_IN:]
    return Record(u[:, None], (clean + ratio * clean.std() / e.std() * e)[:, None], DT)


def controlled(
    seed: int,
    samples: int = 800,
    *,
    gain: float = 0.8,
    integral: float = 0.0,
    reference: str = "steps",
    sensor: float = 0.0,
    colour: float = 0.0,
) -> Record:
    """The plant with process noise under a controller that answers in the same row."""
    rng = np.random.default_rng([seed, samples])
    r = held(rng, samples, 40) if reference == "steps" else INPUTS[reference](rng, samples)
    x, u, y, total = np.zeros(samples), np.zeros(samples), np.zeros(samples), 0.0
    push = lfilter([0.05], [1.0, -colour], rng.standard_normal(samples))
    for t in range(samples):
        for k in (1, 2):
            if t >= k:
                x[t] += -A[k] * x[t - k] + B[k - 1] * u[t - k]
        x[t] += push[t]
        y[t] = x[t] + sensor * rng.standard_normal()
        total += integral * (r[t] - y[t])
        u[t] = gain * (r[t] - y[t]) + total
    return Record(u[:, None], y[:, None], DT)


# ------------------------------------------------------------------ feedback


@pytest.mark.slow
def test_open_loop_is_seldom_accused() -> None:
    """Nominal 1 % over 180 logs: six or more have a chance below 1 %.

    Smooth inputs are the hard ones: what they were long ago can be told from any five samples.
    """
    alarms = []
    for kind in INPUTS:
        for case, options in enumerate(
            (
                {},
                {"noise": (1.0, -0.9)},
                {"delay": 21},
                {"delay": 61, "noise": (1.0, -0.9)},
                {"bend": 0.3, "ratio": 0.02},
                {"delay": 0},
            )
        ):
            for seed in range(5):
                log = open_loop(kind, 10 * seed + case, **options)  # type: ignore[arg-type]
                if feedback_tests([log])[0].seen:
                    alarms.append((kind, options))
    assert len(alarms) < 6, alarms


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"gain": 0.2},
        {"integral": 0.05},
        {"integral": 0.05, "reference": "white"},
        {"sensor": 0.05},
    ],
    ids=["P", "low gain", "PI", "PI, white reference", "P, noisy sensor"],
)
def test_a_controller_that_answers_in_the_same_row_is_seen(options: dict[str, float]) -> None:
    logs = [controlled(seed, 1200, **options) for seed in range(6)]  # type: ignore[arg-type]
    assert sum(feedback_tests([log])[0].seen for log in logs) >= 5
    findings = {f.code: f for f in inspect_records([logs[0]])}
    assert "closed loop" in findings["feedback"].text
    assert findings["nonlinearity"].text.startswith("No nonlinearity")
    assert re.match(r"Delay to y in samples: 1( \(1 to [2-4]\))? from u", findings["delay"].text)


@pytest.mark.slow
def test_feedback_is_not_called_nonlinear() -> None:
    """Eight linear loops: two alarms at 1 % have a chance below 0.3 %."""
    logs = [controlled(seed, 1000) for seed in range(8)]
    found = [f for log in logs for f in inspect_records([log]) if f.code == "nonlinearity"]
    assert sum("Nonlinear response" in f.text for f in found) < 2


@pytest.mark.slow
def test_the_contest_acts_on_feedback() -> None:
    """OE's free run is the best one on the log, and far from the plant."""
    u = np.random.default_rng(99).standard_normal((1000, 1))
    true = lfilter((0.0, *B), A, u[:, 0])
    for seed in range(2):
        log = controlled(seed, 700, integral=0.05, colour=0.9)
        found = identify([log], [], Request(structures=("oe", "arx", "armax")))
        error = {}
        for a in found.assessments:
            run_free = a.model.structure.simulate(a.model.theta, u)[:, 0]
            error[a.model.structure.name] = float(np.linalg.norm(run_free - true))
        winner = found.assessments[0].model.structure.name
        assert winner != "oe"
        assert error[winner] < 0.5 * error["oe"]
        assert "closed loop" in found.reason
        free = {a.model.structure.name: a.estimation.free_run.mean_fit for a in found.assessments}
        assert free["oe"] > free[winner], "else the log does not show what misleads"


# ------------------------------------------------------------------ delays


@pytest.mark.parametrize("kind", ["prbs", "steps", "white", "slow"])
@pytest.mark.parametrize("delay", [1, 21, 31, 61, 180])
def test_delays_up_to_a_quarter_of_the_record(kind: str, delay: int) -> None:
    """At 20 dB, to within one sample."""
    for seed, noise in enumerate(((1.0,), (1.0, -0.9))):
        (found,) = estimate_delays([open_loop(kind, seed, delay=delay, noise=noise)])
        assert found.delay is not None
        assert abs(found.delay - delay) <= 1


def test_two_outputs_with_delays_of_their_own() -> None:
    first, second = open_loop("prbs", 5, delay=3), open_loop("prbs", 5, delay=47)
    both = Record(first.u, np.hstack([first.y, second.y]), DT)
    assert [d.delay for d in estimate_delays([both])] == [3, 47]


def test_noise_alone_has_no_far_delay() -> None:
    """No effect is there; at about one chance in a thousand a log, none of 20 is expected."""
    rng = np.random.default_rng(8)
    for _ in range(20):
        log = Record(prbs(rng, 600)[:, None], rng.standard_normal((600, 1)), DT)
        assert estimate_delays([log])[0].delay is None


@pytest.mark.slow
def test_the_order_search_uses_a_long_delay() -> None:
    log = open_loop("prbs", 4, 700, delay=61)
    assert chosen_delay(LogFacts((log,))).nk == 61
    found = identify([log], [], Request(structures=("arx", "oe")))
    best = found.assessments[0].model.structure
    assert not found.failed
    assert best.order_values()["nk"] in (61, [[61]])
    assert found.assessments[0].estimation.free_run.mean_fit > 89.0  # 90 % at 20 dB


def test_what_inspect_says_of_a_long_delay(tmp_path: Path, capsys: Capture) -> None:
    log = open_loop("steps", 6, delay=41)
    path = write_log(tmp_path / "late.csv", ["u", "y"], [log.u[:, 0], log.y[:, 0]])
    found = run(capsys, "inspect", path)
    text = " ".join(found.out.split())
    assert "Delay to y in samples: 41 from u. Dead time 3.99" in text
    assert "No feedback from output to input was detected" in text


@pytest.mark.parametrize("names", [("duty", "rpm"), ("u", "y")])
def test_a_command_that_acts_in_its_own_row_is_no_feedback(names: tuple[str, str]) -> None:
    """Only of robots logged as PWM in µs is a row known to be read before it is commanded."""
    alarms = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        u = lfilter([0.4], [1.0, -0.8], rng.standard_normal(600))
        y = lfilter([0.2, 0.1], [1.0, -0.8], u)
        y += 0.05 * lfilter([1.0], [1.0, -0.7], rng.standard_normal(600))
        channels = ((Channel(names[0]),), (Channel(names[1], "rad/s"),))
        tests = feedback_tests([Record(u[:, None], y[:, None], 0.02, *channels)])
        alarms += any(t.p_value < 0.01 for t in tests)
    # at 1 % two of eight happen once in 400 times; all eight were called closed loops
    assert alarms < 2


def regulated(seed: int, step: float = 0.0, samples: int = 900) -> Record:
    """A plant held at a set point that never moves by a PI controller that answers in the row."""
    rng = np.random.default_rng(seed)
    drift = lfilter([0.1], [1.0, -0.99], rng.standard_normal(samples))
    y, u, x, integral = np.zeros(samples), np.zeros(samples), 0.0, 0.0
    for k in range(samples):
        x = 0.95 * x + 0.07 * (u[k - 3] if k > 2 else 0.0)
        y[k] = x + drift[k] + 0.02 * rng.standard_normal()
        y[k] = np.round(y[k] / step) * step if step else y[k]
        integral += y[k] * DT
        u[k] = -2.5 * (y[k] + integral / 4.0)
    return Record(np.round(u[:, None], 2), y[:, None], DT)


@pytest.mark.parametrize("step", [0.0, 0.03])
def test_a_controller_that_explains_the_input_is_named_with_its_law(step: float) -> None:
    facts = LogFacts((regulated(3, step),))
    (test,) = facts.feedback or ()
    assert test.law is not None
    assert test.seen
    # u is rounded to 0.01, four thousandths of its spread
    assert test.law.gain == pytest.approx(-2.5, rel=0.01)
    assert test.law.integral_time == pytest.approx(4.0, rel=0.01)
    assert [d.delay for d in facts.delays or ()] != [0]
    said = " ".join(f.text for f in inspect_records(facts))
    assert "proportional-integral law (gain -2.5" in said
    assert "too slow to see" not in said


def test_an_input_that_goes_its_own_way_follows_no_law() -> None:
    """Inputs of all kinds, plants that lag, integrate or pass on at once, little or no noise."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        u = INPUTS[sorted(INPUTS)[seed % 6]](rng, 400)
        pole, late, noise = (0.9, 1.0, 0.995)[seed % 3], seed // 6 % 2, (0.0, 0.05)[seed % 2]
        y = lfilter([0.0] * late + [1.0], [1.0, -pole], u) + noise * rng.standard_normal(len(u))
        law = control_law([Record(u[:, None], y[:, None], DT)], 0, 0)
        assert law is None or not law.integrates, seed
        if noise:
            assert law is None or not law.computed, seed


LAWS = {
    "P": (2.0, 0.0, 0.0, 4),
    "P of a coarse command": (2.0, 0.0, 0.0, 1),
    "PD": (2.0, 0.0, 0.1, 4),
    "PID": (2.0, 0.5, 0.1, 4),
}
"""Gain, integral [1/s] and derivative [s] parts, and digits of the command."""


@pytest.mark.parametrize("words", LAWS)
def test_a_resting_set_point_leaves_no_model_whatever_the_law(words: str) -> None:
    """u holds nothing that y does not: the model would be the controller's inverse, or worse."""
    gain, integral, derivative, digits = LAWS[words]
    rng, n = np.random.default_rng(0), 1500
    disturbance = lfilter([0.2], [1.0, -0.9], rng.standard_normal(n))
    u, y, x, total, last = np.zeros(n), np.zeros(n), 0.0, 0.0, 0.0
    for k in range(n):
        y[k] = round(x + disturbance[k], 4)
        total += integral * 0.1 * -y[k]
        u[k] = round(-gain * y[k] + total - derivative * (y[k] - last) / 0.1, digits)
        last = y[k]
        x = 0.95 * x + 0.08 * u[k]
    facts = LogFacts((Record(u[:, None], y[:, None], 0.1),))
    assert facts.laws_alone
    found = identify(facts, (), Request(("arx",)), inspect=True)
    (response,) = step_responses(found.assessments[0].model)
    assert np.isinf(response.gain.std_error)


def test_who_says_that_a_plant_passes_on_at_once_is_believed() -> None:
    """y = 1.6 u, exactly: the plant, or what a gain of 0.6 computes from it. With noise: plant."""
    u = np.round(np.random.default_rng(0).standard_normal(1000), 4)
    noise = 0.01 * np.random.default_rng(1).standard_normal(1000)
    errors = []
    for y, orders in ((1.6 * u, None), (1.6 * u, "na=1 nb=1 nk=0"), (1.6 * u + noise, None)):
        facts = LogFacts((Record(u[:, None], np.round(y, 4)[:, None], 0.1),))
        found = identify(facts, (), Request(("arx",), orders=orders), inspect=True)
        errors.append(step_responses(found.assessments[0].model)[0].gain.std_error)
    assert np.isfinite(errors).tolist() == [False, True, True]


@pytest.mark.parametrize("moving", [False, True])
def test_a_loop_whose_set_point_rests_is_said_to_show_no_plant(moving: bool) -> None:
    """Ljung (1999) §13.4: without a signal from outside a simple law leaves the plant open.

    Under a random walk and a set point at rest the best model has a gain of 0.0–0.3, the truth 2.
    """
    rng, n, pole = np.random.default_rng(1), 1000, np.exp(-0.1)
    wished = np.repeat(rng.uniform(0.0, 2.0, n // 50), 50) if moving else np.ones(n)
    u, y, x, disturbance, total = np.zeros(n), np.zeros(n), 0.0, 0.0, 0.0
    for k in range(n):
        disturbance += rng.normal(0.0, 0.02)
        y[k] = x + disturbance + rng.normal(0.0, 0.01)
        total += 0.04 * (wished[k] - y[k])
        u[k] = 0.6 * (wished[k] - y[k]) + total
        x = pole * x + (1.0 - pole) * 2.0 * u[k]
    facts = LogFacts((Record(u[:, None], y[:, None], 0.1),))
    (test,) = facts.feedback or ()
    assert test.seen
    assert (test.law is None) == moving
    said = " ".join(f.text for f in inspect_records(facts))
    assert ("No set point moves it" in said) != moving
    found = identify(facts, (), Request(("armax",), orders="na=1 nb=1 nc=1 nk=1"), inspect=True)
    model = found.assessments[0].model
    assert np.isfinite(model.parameter_table()[0].std_error) == moving
    (response,) = step_responses(model)
    assert np.isfinite(response.gain.std_error) == moving
