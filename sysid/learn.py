"""A model as an estimator of scikit-learn: grid search and pipelines of others work on it."""

from typing import Any

import numpy as np

from sysid.data.record import Array, Record
from sysid.errors import ModelError
from sysid.interface import fit

try:
    from sklearn.base import BaseEstimator, RegressorMixin
except ImportError:
    raise ModelError("scikit-learn is not installed; install sysid-workbench[sklearn]") from None


class Identifier(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Fits y to u in time order; predicts by the free run from rest.

    ``score`` is R² of that run. Folds must keep the order of time: ``TimeSeriesSplit``.

    Attributes:
        structure: as ``sysid structures`` lists them.
        orders: text such as ``"nb=2 nf=2 nk=1"``; searched when None.
        dt: sample time [s].
        model_: the fitted model.
    """

    def __init__(self, structure: str = "oe", orders: str | None = None, dt: float = 1.0) -> None:
        self.structure, self.orders, self.dt = structure, orders, dt

    def fit(self, X: Any, y: Any) -> "Identifier":
        """Fit to inputs X (N, nu) and outputs y, (N,) or (N, ny).

        Raises:
            DataError, UsageError, ModelError: as ``sysid.fit`` does.
        """
        u, target = _columns(X), _columns(y)
        self.model_ = fit(Record(u, target, self.dt), self.structure, self.orders)
        self.n_features_in_ = u.shape[1]
        self._single = np.ndim(y) == 1
        return self

    def predict(self, X: Any) -> Array:
        """The free run for inputs X (N, nu): (N,) where one output was given so, else (N, ny)."""
        run = self.model_.simulate(_columns(X))
        return run[:, 0] if self._single else run


def _columns(values: Any) -> Array:
    array = np.asarray(values, dtype=np.float64)
    return array[:, None] if array.ndim == 1 else array
