"""The vehicle of the filters as models of Stone Soup, and its filters run over them."""

import datetime
from collections.abc import Sequence
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.base import GaussianModel
from stonesoup.models.measurement.base import MeasurementModel
from stonesoup.models.transition.base import TransitionModel
from stonesoup.predictor.kalman import (
    ExtendedKalmanPredictor,
    KalmanPredictor,
    UnscentedKalmanPredictor,
)
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater, KalmanUpdater, UnscentedKalmanUpdater

from sysid.data.record import Array
from sysid.robot.mission.navigation.gaussian import Gaussian
from sysid.robot.mission.navigation.measurements import Group, Setting
from sysid.robot.mission.navigation.process import Process
from sysid.vehicle.kinematics import Geometry

DT = 0.1


def _named(process: Process, x: Any) -> dict[str, Any]:
    return {name: np.asarray(x[i], dtype=float) for i, name in enumerate(process.names)}


def _vectors(rows: list[Array]) -> Any:
    made = np.array(rows)
    return StateVectors(made) if made.ndim == 2 and made.shape[1] > 1 else StateVector(made.ravel())


class Motion(GaussianModel, TransitionModel):
    """Our motion, linearised at ``at``, around which noise and slopes are ours too."""

    process: Process = Property()
    at: Any = Property()

    @property
    def ndim_state(self) -> int:
        return len(self.process.names)

    def function(self, state: Any, noise: Any = False, **_: Any) -> Any:
        x = state.state_vector
        columns = x if x.shape[1] > 1 else x[:, 0]
        after = self.process.advanced(_named(self.process, columns), DT, 0.0, Geometry(), np)
        return _vectors([after[name] for name in self.process.names])

    def _slopes(self) -> tuple[Array, Array]:
        found: tuple[Array, Array] = self.process.slopes(
            _named(self.process, self.at), DT, 0.0, Geometry(), np
        )
        return found

    def jacobian(self, state: Any, **_: Any) -> Array:
        return self._slopes()[0]

    def matrix(self, **_: Any) -> Array:
        return self._slopes()[0]

    def covar(self, **_: Any) -> Array:
        return self._slopes()[1]

    def rvs(self, *_: Any, **__: Any) -> Any:
        raise NotImplementedError

    def pdf(self, *_: Any, **__: Any) -> Any:
        raise NotImplementedError


class Reading(GaussianModel, MeasurementModel):
    """One group of our measurements."""

    process: Process = Property()
    group: Group = Property()

    @property
    def ndim_state(self) -> int:
        return len(self.process.names)

    @property
    def ndim_meas(self) -> int:
        return len(self.group.names)

    @property
    def mapping(self) -> tuple[int, ...]:
        return tuple(range(self.ndim_meas))

    def _expected(self, x: Any) -> Any:
        return self.group.expected(_named(self.process, x), Setting(Geometry()), np)

    def function(self, state: Any, noise: Any = False, **_: Any) -> Any:
        x = state.state_vector
        columns = x if x.shape[1] > 1 else x[:, 0]
        return _vectors([one.value for one in self._expected(columns)])

    def jacobian(self, state: Any, **_: Any) -> Array:
        expected = self._expected(state.state_vector[:, 0])
        return np.array([[e.slopes.get(n, 0.0) for n in self.process.names] for e in expected])

    def matrix(self, **_: Any) -> Array:
        return self.jacobian(GaussianState(np.zeros((self.ndim_state, 1)), np.eye(self.ndim_state)))

    def covar(self, **_: Any) -> Array:
        return np.diag(self.group.variance)

    def rvs(self, *_: Any, **__: Any) -> Any:
        raise NotImplementedError

    def pdf(self, *_: Any, **__: Any) -> Any:
        raise NotImplementedError


SPREAD = {"alpha": 0.5, "beta": 2.0, "kappa": 1.0}


def run(
    kind: str,
    process: Process,
    groups: Sequence[Group],
    zs: list[tuple[Array, ...]],
    first: Gaussian,
) -> list[Gaussian]:
    """The beliefs of one of Stone Soup's filters after every step."""
    predictors = {
        "linear": KalmanPredictor,
        "extended": ExtendedKalmanPredictor,
        "unscented": UnscentedKalmanPredictor,
    }
    updaters = {
        "linear": KalmanUpdater,
        "extended": ExtendedKalmanUpdater,
        "unscented": UnscentedKalmanUpdater,
    }
    options = SPREAD if kind == "unscented" else {}
    now = datetime.datetime(2026, 1, 1)
    state: Any = GaussianState(StateVector(first.x), first.P, timestamp=now)
    beliefs = []
    for z in zs:
        now += datetime.timedelta(seconds=DT)
        motion = Motion(process=process, at=np.asarray(state.state_vector, dtype=float)[:, 0])
        state = predictors[kind](motion, **options).predict(state, timestamp=now)
        for group, numbers in zip(groups, z, strict=True):
            model = Reading(process=process, group=group)
            updater = updaters[kind](model, **options)
            seen = Detection(StateVector(numbers), timestamp=now, measurement_model=model)
            state = updater.update(SingleHypothesis(state, seen))
            state = GaussianStatePrediction(state.state_vector, state.covar, timestamp=now)
        x = np.asarray(state.state_vector, dtype=float)[:, 0]
        beliefs.append(Gaussian(x, np.asarray(state.covar, dtype=float)))
    return beliefs
