"""The study of public benchmarks under the interfaces of two packages, which need not be there."""

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from studies.public_benchmarks import build_model, official
from studies.records import data_folder


def sequence(seed: int, n: int = 300) -> SimpleNamespace:
    """One of IdentiBench: a first-order plant at 20 Hz, from a state that only outputs show."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.standard_normal(n // 5), 5)
    start = 3.0 * 0.9 ** np.arange(n)
    y = lfilter([0.0, 0.2], [1.0, -0.9], u) + start
    return SimpleNamespace(u=u[:, None], y=y[:, None], attrs={"fs": 20.0})


def test_identibench_gets_a_model_of_its_context() -> None:
    """Its contract (version 0.4): ``model(u, y_init, attrs)`` gives outputs for the whole input."""
    context = SimpleNamespace(
        hyperparameters={"structure": "oe", "orders": "nb=1 nf=1 nk=1"},
        get_train_valid_sequences=lambda: iter([sequence(1), sequence(2)]),
    )
    model = build_model(context)
    test = sequence(3)
    y = model(test.u, test.y[:50], test.attrs)
    np.testing.assert_allclose(y, test.y, atol=1e-6)  # no noise, the state from 50 outputs
    assert np.abs(model(test.u, test.y[:0], test.attrs)[0] - test.y[0]) > 1.0  # from rest


@pytest.mark.skipif(data_folder() is None, reason="no measured records")
def test_the_package_decides_on_records_splits_and_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    parts = [
        SimpleNamespace(u=v.u, y=v.y, sampling_time=0.05, state_initialization_window_length=7)
        for v in map(sequence, range(4))
    ]

    def ced(**_: Any) -> tuple[Any, Any]:
        return tuple(parts[:2]), tuple(parts[2:])

    package = ModuleType("nonlinear_benchmarks")
    package.CED = ced  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", package)
    trial = official("ced-high")
    assert trial.skip == 7
    np.testing.assert_array_equal(trial.train[0].y, parts[1].y)
    np.testing.assert_array_equal(trial.tests["high"][0].y, parts[3].y)
    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", None)
    assert official("ced-high").skip == 10
