"""Others' grid search and pipelines run on our estimator."""

import numpy as np
import pytest
from scipy.signal import lfilter

pytest.importorskip("sklearn")

from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sysid.learn import Identifier


def logged() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    u = rng.standard_normal(600)
    y = lfilter([0.0, 0.5], [1.0, -1.2, 0.5], u) + 0.05 * rng.standard_normal(600)
    return u[:, None], y


def test_grid_search_finds_the_orders() -> None:
    u, y = logged()
    grid = {"orders": ["nb=1 nf=1 nk=1", "nb=1 nf=2 nk=1"]}
    search = GridSearchCV(Identifier("oe", dt=0.1), grid, cv=TimeSeriesSplit(3))
    search.fit(u, y)
    assert search.best_params_ == {"orders": "nb=1 nf=2 nk=1"}
    assert search.best_score_ > 0.95


def test_in_a_pipeline() -> None:
    u, y = logged()
    line = make_pipeline(StandardScaler(), Identifier("arx", "na=2 nb=1 nk=1"))
    line.fit(5.0 + 3.0 * u, y)
    assert line.predict(5.0 + 3.0 * u).shape == y.shape
    assert line.score(5.0 + 3.0 * u, y) > 0.95
    assert line[-1].get_params()["structure"] == "arx"
