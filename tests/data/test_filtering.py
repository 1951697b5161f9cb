"""Filters by LAPACK are those of SciPy."""

import numpy as np
import pytest
from scipy import signal

from sysid.data import filtering

A1, A3 = [1.0, -0.9], [2.0, -2.2, 0.9, -0.1]
CASES = {
    "lag": ([0.1], A1, (50,), -1, False),
    "longer numerator": ([0.0, 0.3, -0.2, 0.1], A1, (50,), -1, True),
    "third order": ([0.5, 1.0], A3, (50,), 0, True),
    "columns": ([0.5, 1.0], A3, (50, 4), 0, True),
    "rows": ([0.0, 1.0], A3, (3, 50), 1, True),
    "three axes": ([0.0, 1.0], A3, (2, 50, 3), 1, True),
    "no poles": ([1.0, -0.5, 0.2], [2.0], (50, 3), 0, True),
    "gain": ([2.0], [4.0], (50,), 0, False),
    "no columns": ([0.5, 1.0], A3, (50, 0), 0, True),
    "shorter than its states": ([0.5, 1.0, 0.2], A3, (2, 3), 0, True),
}
"""b, a, shape of the signal, axis, whether it starts from some states."""


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("kind", ["real", "complex", "whole numbers"])
def test_is_that_of_scipy(name: str, kind: str) -> None:
    b, a, shape, axis, given = CASES[name]
    rng = np.random.default_rng(3)
    x = rng.standard_normal(shape)
    x = x + 1j * rng.standard_normal(shape) if kind == "complex" else x
    x = np.round(9.0 * x).astype(int) if kind == "whole numbers" else x
    n = max(len(a), len(b)) - 1
    states = rng.standard_normal([n if k == axis % len(shape) else m for k, m in enumerate(shape)])
    got = filtering.lfilter(b, a, x, axis, states if given else None)
    wanted = signal.lfilter(b, a, x, axis, states if given else None)
    for ours, theirs in zip(got, wanted, strict=True) if given else [(got, wanted)]:
        # 50 steps of a pole at 0.9: rounding of some units in the last place
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


def test_a_missing_value_stays_missing() -> None:
    x = np.ones(30)
    x[10] = np.nan
    ours = filtering.lfilter([0.0, 0.5], A1, x)
    np.testing.assert_array_equal(np.isnan(ours), np.isnan(signal.lfilter([0.0, 0.5], A1, x)))


def test_long_signals_are_filtered_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    x = np.random.default_rng(5).standard_normal((60, 2))
    short = filtering.lfilter([0.2], A1, x, 0)
    monkeypatch.setattr(filtering, "MANY", 10)
    np.testing.assert_allclose(filtering.lfilter([0.2], A1, x, 0), short, rtol=1e-12)


@pytest.mark.parametrize("starts", [(0, 60), (0, 1, 25, 60)])
def test_each_record_starts_from_rest(starts: tuple[int, ...]) -> None:
    x = np.random.default_rng(7).standard_normal((60, 3))
    parts = np.split(x, starts[1:-1])
    b, a = np.array([0.0, 0.5, 0.1]), np.array([1.0, -1.2, 0.4])
    wanted = np.concatenate([signal.lfilter(b, a, part, axis=0) for part in parts])
    got = filtering.filtered_by_record(b, a, x, starts)
    np.testing.assert_allclose(got, wanted, rtol=1e-12, atol=1e-12)


def test_one_signal_goes_through_several_filters() -> None:
    x, starts = np.random.default_rng(8).standard_normal((60, 1)), (0, 25, 60)
    a = np.array([[1.0, -1.2, 0.4], [1.0, -0.5, 0.0], [1.0, 0.3, 0.1]])
    b = np.column_stack([np.zeros(3), a.sum(axis=1)])
    each = [filtering.filtered_by_record(*pair, x, starts) for pair in zip(b, a, strict=True)]
    got = filtering.filtered_by_record(b, a, x, starts)
    np.testing.assert_allclose(got, np.hstack(each), rtol=1e-12, atol=1e-12)
