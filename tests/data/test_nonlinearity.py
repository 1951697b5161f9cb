"""The test for nonlinearity of a log: its level on linear plants, its power on bent ones.

Rates on many logs stand in ``reports/nonlinearity.md``.
"""

from time import process_time

import numpy as np
import pytest
from scipy.signal import lfilter
from sysid_datasets import path

from sysid.data.checks.dynamics_checks import check_nonlinearity
from sysid.data.checks.nonlinearity import nonlinearity_tests
from sysid.data.facts import LogFacts
from sysid.data.finding import Severity
from sysid.data.io import read_log
from sysid.data.record import Array, Record
from sysid.errors import DataError

INPUTS = ("white", "steps", "two levels")


def _input(rng: np.random.Generator, n: int, kind: str) -> Array:
    if kind == "white":
        return rng.standard_normal(n)
    if kind == "steps":
        return np.repeat(rng.uniform(-1.7, 1.7, n // 15 + 1), 15)[:n]
    return np.repeat(rng.choice([-1.0, 1.0], n // 5 + 1), 5)[:n]


def _linear(seed: int, n: int, kind: str, coloured: bool) -> Record:
    rng = np.random.default_rng([seed, n])
    u = _input(rng, n, kind)
    x = lfilter([0.0, 0.1, 0.08], [1.0, -1.5, 0.7], u)
    v = rng.standard_normal(n)
    v = lfilter([1.0], [1.0, -0.9], v) if coloured else v
    return Record(u[:, None], (x + 0.2 * x.std() * v / v.std())[:, None], 0.1)


def _closed_loop(seed: int, n: int) -> Record:
    rng = np.random.default_rng([seed, n])
    r, y, u = _input(rng, n, "steps"), np.zeros(n), np.zeros(n)
    for t in range(1, n):
        y[t] = 0.9 * y[t - 1] + 0.2 * u[t - 1] + 0.05 * rng.standard_normal()
        u[t] = 0.8 * (r[t] - y[t])
    return Record(u[:, None], y[:, None], 0.1)


def _bent(seed: int, n: int, kind: str) -> Record:
    """A dead zone before a lag, or friction, or a square."""
    rng = np.random.default_rng([seed, n])
    u, y = _input(rng, n, "steps"), np.zeros(n)
    for t in range(1, n):
        drive = (
            np.sign(u[t - 1]) * max(abs(u[t - 1]) - 0.5, 0.0) if kind == "dead zone" else u[t - 1]
        )
        pull = 0.15 * y[t - 1] * abs(y[t - 1]) if kind == "drag" else 0.0
        y[t] = 0.8 * y[t - 1] + 0.3 * drive - pull + 0.01 * rng.standard_normal()
    if kind == "square":
        y = y + 0.2 * y**2
    return Record(u[:, None], y[:, None], 0.1)


@pytest.mark.slow
def test_linear_plants_are_seldom_called_nonlinear() -> None:
    logs = [_linear(s, 300, kind, c) for s in range(4) for kind in INPUTS for c in (False, True)]
    logs += [_closed_loop(s, 300) for s in range(4)]
    alarms = sum(nonlinearity_tests([r])[0].p_value < 0.01 for r in logs)
    # 28 logs at 1 %: more than two has a chance of 0.3 %
    assert alarms <= 2


@pytest.mark.parametrize("kind", ["dead zone", "drag", "square"])
def test_bent_plants_are_found(kind: str) -> None:
    (test,) = nonlinearity_tests([_bent(1, 600, kind)])
    assert test.p_value < 1e-3
    assert test.share > 0.0
    assert test.samples == 600


def test_the_bundled_robot_is_nonlinear() -> None:
    record = read_log(path("multilevel"))
    started = process_time()
    tests = nonlinearity_tests([record])
    # 0.4 s on an idle machine; inspect must not become slow
    assert process_time() - started < 4.0
    assert [t.output for t in tests] == ["omega_l", "omega_r"]
    assert all(t.p_value < 1e-3 for t in tests)


def test_the_same_answer_on_every_run_and_in_any_unit() -> None:
    r = _bent(2, 500, "dead zone")
    first, again = nonlinearity_tests([r]), nonlinearity_tests([r])
    assert first == again
    scaled = Record(1024.0 * r.u, r.y / 256.0, r.dt)
    (other,) = nonlinearity_tests([scaled])
    # powers of two: only the surrogates' rounding differs
    assert other.statistic == pytest.approx(first[0].statistic, rel=1e-6)


def test_several_records_are_pooled() -> None:
    parts = [_bent(s, 300, "dead zone") for s in (1, 2)]
    (test,) = nonlinearity_tests(parts)
    assert test.samples == 600
    assert test.p_value < 0.01


def test_too_short_logs_are_told_so() -> None:
    with pytest.raises(DataError, match="too few"):
        nonlinearity_tests([_linear(0, 80, "white", False)])
    (finding,) = check_nonlinearity(LogFacts((_linear(0, 80, "white", False),)))
    assert "Too few" in finding.text


def test_the_finding_says_what_and_where() -> None:
    (found,) = check_nonlinearity(LogFacts((_bent(1, 600, "drag"),)))
    assert found.severity is Severity.NOTE
    assert "p" in found.text
    assert "Nonlinear response" in found.text
    assert "Compare" in found.advice
    (fine,) = check_nonlinearity(LogFacts((_linear(1, 600, "white", False),)))
    assert fine.severity is Severity.OK
    assert "p = " in fine.text
