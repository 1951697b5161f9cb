"""Preprocessing: what is taken away can be put back, and filters do what their names say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from sysid.data import documents
from sysid.data.facts import LogFacts
from sysid.data.outliers import outlier_flags
from sysid.data.preparation import Preparation
from sysid.data.preprocess import Detrend, decimate, low_pass, trim
from sysid.data.record import Record
from sysid.data.schema import checked
from sysid.errors import DataError, ModelError, UsageError


def record(n: int = 200, nu: int = 2, ny: int = 1, seed: int = 0, t0: float = 0.0) -> Record:
    rng = np.random.default_rng(seed)
    return Record(rng.normal(3.0, 1.0, (n, nu)), rng.normal(-5.0, 2.0, (n, ny)), 0.1, t0=t0)


@pytest.mark.parametrize("kind", ["none", "means", "linear"])
@pytest.mark.parametrize("count", [1, 3])
def test_detrending_is_undone_exactly(kind: str, count: int) -> None:
    records = tuple(record(seed=i, t0=7.0 * i) for i in range(count))
    made = {
        "none": lambda: Detrend.none(2, 1),
        "means": lambda: Detrend.means(records),
        "linear": lambda: Detrend.linear(records),
    }[kind]()
    for r in records:
        plain = made.remove(r)
        np.testing.assert_allclose(made.restore_output(plain.y, r.t), r.y, atol=1e-13)
        np.testing.assert_array_equal(made.remove_input(r.u, r.t), plain.u)
        assert plain.sha256 == r.sha256
    assert checked(Detrend, documents.plain(made)) == made
    assert made.is_none == (kind == "none")


def test_means_are_pooled_over_samples() -> None:
    records = (record(100, seed=1), record(300, seed=2))
    made = Detrend.means(records)
    every = np.concatenate([r.y for r in records])
    np.testing.assert_allclose(made.y_offset, every.mean(axis=0))
    rest = np.concatenate([made.remove(r).y for r in records])
    np.testing.assert_allclose(rest.mean(axis=0), 0.0, atol=1e-13)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.floats(-50, 50), st.floats(-3, 3), st.floats(0, 1000))
def test_linear_finds_the_line_wherever_time_starts(offset: float, slope: float, t0: float) -> None:
    plain = Record(np.zeros((50, 1)), np.zeros((50, 1)), 0.2, t0=t0)
    line = offset + slope * plain.t[:, None]
    r = Record(-line, line, 0.2, t0=t0)
    made = Detrend.linear([r])
    # t up to 1010 s over a spread of 10 s loses two digits of the sixteen.
    np.testing.assert_allclose(made.remove(r).y, 0.0, atol=1e-9)
    np.testing.assert_allclose(made.y_slope, slope, atol=1e-9)
    part = r.rows(10, 40)  # the slope belongs to the clock, not to the row number
    np.testing.assert_allclose(made.remove(part).u, 0.0, atol=1e-9)


BAD_JSON = [
    {},
    {"u_offset": [0.0]},
    {"u_offset": [0.0], "y_offset": [0.0], "colour": [1.0]},
    {"u_offset": ["a"], "y_offset": [0.0]},
    {"u_offset": [[0.0]], "y_offset": [0.0]},
    {"u_offset": [float("nan")], "y_offset": [0.0]},
    {"u_offset": [0.0, 1.0], "y_offset": [0.0], "u_slope": [1.0]},
]


@pytest.mark.parametrize("data", BAD_JSON)
def test_damaged_offsets_are_refused(data: dict[str, object]) -> None:
    with pytest.raises((ModelError, ValueError)):
        checked(Detrend, data)


def test_offsets_must_fit_the_record() -> None:
    with pytest.raises(DataError, match=r"2 inputs and 1 outputs.*for 1 and 1"):
        Detrend.none(1, 1).remove(record())
    with pytest.raises(DataError, match=r"expected y of shape \(N, 1\)"):
        Detrend.none(2, 1).restore_output(np.zeros((5, 2)), np.zeros(5))
    with pytest.raises(DataError, match="no record"):
        Detrend.means([])


def test_low_pass_keeps_the_relation_of_u_and_y() -> None:
    rng = np.random.default_rng(5)
    u = rng.normal(size=(2000, 1))
    y = signal.lfilter([0, 0.5], [1, -0.8], u, axis=0)
    filtered = low_pass(Record(u, y, 0.1), 1.0)
    again = signal.lfilter([0, 0.5], [1, -0.8], filtered.u, axis=0)
    # A linear filter commutes with the plant but for the transients at the ends (0.8^60 ≈ 1e-6).
    np.testing.assert_allclose(filtered.y[200:-200], again[200:-200], atol=1e-5)


def test_low_pass_passes_slow_and_stops_fast() -> None:
    t = np.arange(2000) * 0.01
    slow, fast = np.sin(2 * np.pi * 1 * t), np.sin(2 * np.pi * 25 * t)
    filtered = low_pass(Record(slow, slow + fast, 0.01), 5.0)
    # Order 4: gain 1/√(1 + (f/fc)^8) is 0.999999 at fc/5 and 0.0016 at 5 fc.
    np.testing.assert_allclose(filtered.y[300:], filtered.u[300:], atol=2e-3)
    assert np.max(filtered.u[300:]) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 5.0, 9.0, float("nan")])
def test_impossible_cutoffs(cutoff: float) -> None:
    with pytest.raises(UsageError, match="between 0 and 5 Hz"):
        low_pass(record(), cutoff)


def test_decimated_motor_keeps_its_pole_and_gain() -> None:
    rng = np.random.default_rng(6)
    u = np.repeat(rng.choice([-1.0, 1.0], 800), 5)[:, None]
    y = signal.lfilter([0, 0.02], [1, -0.98], u, axis=0)
    r = decimate(Record(u, y, 0.01), 5)
    assert (len(r), r.dt) == (800, pytest.approx(0.05))
    X = np.column_stack([r.y[:-1, 0], r.u[:-1, 0]])[20:-20]
    a, b = np.linalg.lstsq(X, r.y[21:-20, 0], rcond=None)[0]
    # The input is constant over each block, so the exact pole is 0.98^5; the mean of the samples
    # rounds the corners of u and y, which costs about a percent.
    assert a == pytest.approx(0.98**5, abs=0.01)
    assert b / (1 - a) == pytest.approx(1.0, abs=0.02)


def test_decimation_does_not_alias() -> None:
    t = np.arange(4000) * 0.01
    fast = np.sin(2 * np.pi * 9.7 * t)  # every 10th sample of it would be a slow wave of size 1
    r = decimate(Record(np.ones_like(t), fast, 0.01), 10)
    assert np.max(np.abs(r.y[20:-20])) < 0.04  # sin(0.97 π) / (0.97 π) of the mean of ten


@pytest.mark.parametrize("hold", [1, 7, 40])
@pytest.mark.parametrize("steps", [Preparation(decimate=10), Preparation(low_pass=2.0)])
def test_filters_close_no_loop_and_take_no_dead_time(hold: int, steps: Preparation) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.choice([-1.0, 1.0], 4000 // hold + 1), hold)[:4000, None]
        y = signal.lfilter([0, 0, 0.03], [1, -0.97], u, axis=0) + rng.normal(0, 0.05, u.shape)
        log = Record(u, y, 0.01)
        facts = LogFacts((steps.apply(log),))
        assert not facts.closed_loop
        (delay,), (logged,) = facts.delays or (), LogFacts((log,)).delays or ()
        assert delay.delay == (1 if steps.decimate > 1 else logged.delay)


def test_decimate_and_trim_refuse() -> None:
    r = record()
    assert decimate(r, 1) is r
    with pytest.raises(UsageError, match="factor of 2"):
        decimate(r, 0)
    with pytest.raises(DataError, match="leave 4"):
        decimate(r, 50)
    with pytest.raises(DataError, match="leaves nothing"):
        trim(r, 15.0, 6.0)
    with pytest.raises(UsageError, match="times of 0 or more"):
        trim(r, -1.0)


def test_trim_counts_seconds() -> None:
    r = record(100, t0=5.0)
    part = trim(r, 1.0, 2.0)
    assert (len(part), part.t0) == (70, pytest.approx(6.0))
    np.testing.assert_array_equal(part.y, r.y[10:80])


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_outliers_are_found_and_nothing_else(noise: float) -> None:
    rng = np.random.default_rng(7)
    u = np.repeat(rng.choice([-1.0, 1.0], 200), 6)[:, None]
    y = signal.lfilter([0, 0.4], [1, -0.6], u, axis=0) + noise * rng.normal(size=u.shape)
    assert not outlier_flags(Record(u, y, 0.1)).any()
    bad = y.copy()
    hit = [100, 463, 901]
    bad[hit, 0] += [3.0, -4.0, 3.5]
    assert list(np.flatnonzero(outlier_flags(Record(u, bad, 0.1))[:, 0])) == hit


def test_constant_and_short_outputs_have_no_outliers() -> None:
    for n in (3, 100):
        assert not outlier_flags(Record(np.zeros((n, 1)), np.ones((n, 1)), 0.1)).any()
