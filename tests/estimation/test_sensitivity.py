"""What a log would show before a fit: errors, hidden directions, times, experiments."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.data.facts import LogFacts
from sysid.data.record import Array, Record
from sysid.estimation.information.before_fit import before_fit
from sysid.estimation.information.experiments import mendings
from sysid.estimation.information.profiles import profile
from sysid.estimation.information.sensitivity import Sensitivity, hidden, sensitivity
from sysid.estimation.information.subject import Subject, subject_of_box, subject_of_model
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.report.data_panels import sensitivity_panels
from sysid.structures.grey_box.file.physics import FilePhysics
from sysid.structures.grey_box.file.structure import FromFile
from sysid.structures.grey_box.physics import Sampling
from sysid.structures.registry import structure_class

SIGMA = 0.01

LAG = """
inputs: {u: }
states: {x: {}}
parameters: {gain: {start: 2}, tau: {start: 0.5, bounds: [0.05, 20]}}
equations: {x: (gain*u - x)/tau}
outputs: {y: {equation: x}}
"""

SPLIT = LAG.replace("gain: {start: 2}", "gain: {start: 2}, share: {start: 1}").replace(
    "gain*u", "gain*share*u"
)

RARE = """
inputs: {u: }
states: {x: {}}
parameters: {gain: {start: 2}, extra: {start: 0.5}}
equations: {x: "gain*u - x + if(u > 1.5, extra, 0)"}
outputs: {y: {equation: x}}
"""

CHANCE = """
inputs: {u: }
states: {x: {}}
parameters: {gain: {start: 2}, bent: {start: 0}, wide: {start: 0.3, bounds: [0.05, 3]}}
equations: {x: "gain*u - x + bent*tanh(u/wide)"}
outputs: {y: {equation: x}}
"""


def box(text: str) -> FromFile:
    return FromFile(FilePhysics(1, 1, text), Sampling(0.1, 1))


def steps(n: int, seed: int) -> Array:
    return np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, (n // 10, 1)), 10, axis=0)


def log_of(text: str, u: Array, seed: int = 1) -> Record:
    s = box(text)
    y = s.simulate(s.physics.pack({}), u)
    return Record(u, y + SIGMA * np.random.default_rng(seed).standard_normal(y.shape), 0.1)


def asked(text: str, record: Record) -> tuple[Subject, Sensitivity]:
    subject = subject_of_box(box(text), LogFacts((record,)))
    subject = replace(subject, noise=np.array([SIGMA]))
    return subject, sensitivity(subject, (record,))


def test_of_a_gain_the_error_is_the_closed_form() -> None:
    u = np.random.default_rng(2).standard_normal((400, 1))
    y = np.vstack([[0.0], 2.0 * u[:-1]])
    log = Record(u, y + SIGMA * np.random.default_rng(3).standard_normal(y.shape), 0.1)
    model = fit(structure_class("oe").from_orders({"nb": 1, "nf": 0, "nk": 1}, 1, 1), (log,))
    found = sensitivity(subject_of_model(model), (model.detrend.remove(log),))
    sigma = np.sqrt(model.noise_covariance[0, 0])
    plain = model.detrend.remove(log).u[:-1]
    assert found.parameters[0].std_error == pytest.approx(sigma / np.linalg.norm(plain), rel=1e-6)


def test_errors_are_those_that_a_fit_then_states() -> None:
    log = log_of(LAG, steps(400, 4))
    model = fit(box(LAG), (log,))
    found = sensitivity(subject_of_model(model), (log,))
    stated = np.sqrt(np.diag(model.covariance))
    # the fit divides by N − n instead of N, and evaluates at its own initial state
    assert [p.std_error for p in found.parameters] == pytest.approx(stated, rel=0.02)
    assert (found.rank, found.count) == (3, 3)
    before = asked(LAG, log)[1]
    assert [p.std_error for p in before.parameters] == pytest.approx(stated, rel=0.1)


def test_what_only_shows_together_is_named() -> None:
    subject, found = asked(SPLIT, log_of(SPLIT, steps(400, 5)))
    assert found.rank == found.count - 1
    assert [set(d) for d in found.null] == [{"gain", "share"}]
    assert found.doubtful == ("gain", "share")
    errors = [p.std_error for p in found.parameters]
    sentences = {m.sentence for m in mendings(subject, found.doubtful, errors)}
    assert sentences == {
        "No experiment that was tried separates gain, share: fix one of them, or measure another "
        "output."
    }


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (LAG, ""),
        (SPLIT, "gain, share only show together on this log."),
        (RARE, "extra does not act on this log."),
        # where the search begins `wide` does nothing; elsewhere it does
        (CHANCE, ""),
        (CHANCE.replace("tanh(u/wide)", "wide*u"), "gain, bent, wide only show together"),
    ],
)
def test_before_a_fit_it_is_said_what_no_point_tells_apart(text: str, sentence: str) -> None:
    log = log_of(text, steps(400, 5))
    told = before_fit(box(text), (log,), FitOptions())
    assert told is not None
    assert bool(told.sentences) == bool(sentence) == (told.rank < told.count)
    assert all(s.startswith(sentence) for s in told.sentences)


def test_before_a_fit_what_is_fixed_is_not_asked_about() -> None:
    told = before_fit(box(SPLIT), (log_of(SPLIT, steps(400, 5)),), FitOptions(fixed={"share": 1.0}))
    assert told is not None
    assert told.null == ()


def test_groups_that_only_show_together_are_told_apart() -> None:
    null = np.linalg.qr(
        np.array([[1.0, 0, 1], [1, 0, -1], [0, 1, 0], [0, 1, 0.0]]).dot(
            np.array([[1.0, 1.0], [1.0, -1.0], [0.0, 0.0]])
        )
    )[0]
    assert [set(d) for d in hidden("abcd", null)] == [{"a", "b"}, {"c", "d"}]


def test_a_parameter_is_shown_when_it_acts() -> None:
    resting = RARE.replace("u > 1.5", "abs(u) < 0.001")
    u = steps(400, 6)
    assert asked(resting, log_of(resting, u))[1].doubtful == ("extra",)
    u[200:240] = 0.0
    log = log_of(resting, u)
    found = asked(resting, log)[1]
    extra = found.parameters[1]
    assert extra.verdict == "shown"
    # it acts from 20 to 24 s, where the gain does not, and is forgotten in a time constant of 1 s
    assert extra.when is not None
    assert 20.0 <= extra.when[0] < extra.when[1] <= 26.0
    (rows,) = sensitivity_panels(found, log)[1].curves
    assert rows.low is not None
    assert rows.high is not None
    assert (rows.low[1], rows.high[1]) == found.parameters[1].when


def test_the_experiment_that_is_named_shows_the_parameter() -> None:
    u = steps(400, 7)
    u[::7] = 1.2
    subject, found = asked(RARE, log_of(RARE, u))
    errors = [p.std_error for p in found.parameters]
    (mending,) = mendings(subject, found.doubtful, errors)
    assert "over twice the range" in mending.experiment
    assert mending.error < 0.25 * subject.theta[1]


def test_a_profile_is_the_interval_of_slopes_where_runs_are_linear() -> None:
    log = log_of(LAG, steps(400, 8))
    subject, found = asked(LAG, log)
    error = found.parameters[0].std_error
    low, high = profile(subject, log, "gain", error)
    assert low is not None
    assert high is not None
    # the bracket of a profile is closed within a fifth
    assert (2.0 - low, high - 2.0) == pytest.approx((1.96 * error, 1.96 * error), rel=0.25)


def test_a_profile_is_open_where_a_bound_comes_first() -> None:
    held = LAG.replace("gain: {start: 2}", "gain: {start: 2, bounds: [1.9999, 2.5]}")
    log = log_of(held, steps(100, 9))
    low, high = profile(asked(held, log)[0], log, "gain", 0.01)
    assert low is None
    assert high is not None


@pytest.mark.parametrize(("below", "shown"), [(0.3, False), (30.0, True)])
def test_a_limit_that_the_run_just_touches_may_lie_anywhere_beyond(
    below: float, shown: bool
) -> None:
    """Slopes know the limit at which the top of a run is cut, wherever noise has put it."""
    u = steps(300, 3)
    peak = float(np.max(box(LAG).simulate(np.array([2.0, 0.5]), u)))
    text = LAG.replace("tau: {start", f"top: {{start: {peak - below * SIGMA}}}, tau: {{start")
    limited = box(text.replace("y: {equation: x}", 'y: {equation: "min(x, top)"}'))
    y = limited.simulate(limited.physics.pack({}), u)
    record = Record(u, y + SIGMA * np.random.default_rng(4).standard_normal(y.shape), 0.1)
    found = sensitivity(subject_of_box(limited, LogFacts((record,))), (record,))
    verdicts = {p.name: p.verdict for p in found.parameters}
    assert verdicts == {"gain": "shown", "tau": "shown", "top": "shown" if shown else "not shown"}
