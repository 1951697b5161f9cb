"""A body couples tracks that stick: against the twin, which integrates both in small steps."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from sysid_datasets.twin import DEVASTATOR, Twin, simulate_truth

from sysid.data.record import Array, Record
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import Data, prepare
from sysid.effects.catalogue import effect, in_chain

DT, FULL = 0.1, 20000.0
TWIN = replace(DEVASTATOR, breakaway_ratio=1.0, duty_limit=1.0)
"""Coulomb friction only: what remains is how friction and the body's push meet in a sample."""


def truth(twin: Twin) -> dict[tuple[str, str], tuple[float, float]]:
    """The twin's constants as those of the chain, left and right."""
    own, shared = twin.inertia
    gain = [twin.torque_per_volt * g * twin.supply / twin.damping for g in twin.voltage_gain]
    dry = [c / twin.damping for c in twin.sliding]
    pole = -float(np.exp(-DT * twin.damping / own))
    return {
        ("core", "gain"): (gain[0], gain[1]),
        ("core", "f1"): (pole, pole),
        ("coulomb-friction", "level"): (dry[0], dry[1]),
        ("inertial-coupling", "share"): (shared / own, shared / own),
    }


def logged(seed: int) -> tuple[FullModel, Data, Array]:
    """The chain, the data of a run of the twin, and the chain's parameters of that twin."""
    rng = np.random.default_rng(seed)
    pwm = np.repeat(rng.choice([0.0, 0.0, 0.1, 0.25, 0.6, 1.0], (60, 2)), 8, axis=0)
    pwm = pwm * np.repeat(rng.choice([-1.0, 1.0], (60, 2)), 8, axis=0) * FULL
    y = simulate_truth(pwm, TWIN, sample_time=DT).omega
    effects = in_chain(effect(id) for id in ("inertial-coupling", "coulomb-friction"))
    model = FullModel(effects, 1, 2, np.full(2, 10.0), DT)
    q = model.null
    for (owner, name), values in truth(TWIN).items():
        for track in (-1, 0, 1):
            if (owner, name, track) in model.index:
                q[model.index[owner, name, track]] = values[max(track, 0)]
    return model, prepare([Record(pwm, y, DT)], np.full(2, FULL), 1), q


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_share_is_that_of_the_body(seed: int) -> None:
    model, data, q = logged(seed)
    known = truth(TWIN)
    free = [at for key, at in model.index.items() if key[:2] in known]

    def errors(z: Array) -> Array:
        rows = np.tile(q, (len(np.atleast_2d(z)), 1))
        rows[:, free] = z
        return ((model.run(rows, data) - data.y) * data.weight).reshape(len(rows), -1)

    def slopes(z: Array) -> Array:
        h = np.diag(1e-5 * np.maximum(np.abs(z), 1e-2))
        runs = errors(np.concatenate([z + h, z - h]))
        return ((runs[: len(z)] - runs[len(z) :]) / (2.0 * np.diag(h))[:, None]).T

    # a track that starts or stops within a sample is stepped to first order: a hundredth of the
    # speeds, two while friction took nothing of the push
    at_truth = errors(q[free])[0]
    assert np.sqrt(np.mean(at_truth**2)) < 0.08

    def misses(z: Array) -> Array:
        first: Array = errors(z)[0]
        return first

    found = least_squares(misses, q[free] * 1.1, slopes, x_scale=np.abs(q[free]))
    share = found.x[free.index(model.index["inertial-coupling", "share", -1])]
    # at 0.1 s to a sample and 0.23 s of time constant, for the same reason
    assert share == pytest.approx(known["inertial-coupling", "share"][0], abs=0.006)
