"""A weight that swings: the torque that lifts it is far more than the usual speed asks for."""

import numpy as np
import pytest

from sysid.data.record import Channel, Record
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.full_model import FullModel
from sysid.effects.catalogue import effect

DT, FINE, TAU, GAIN = 0.02, 20, 0.1, 10.0
HEAVY = 12.0
"""Torque of the weight in units of steady speed; a quarter of the readings are above 3 rad/s."""


def swinging(
    seed: int, gain: float = GAIN, heavy: float = HEAVY, held: int = 25, samples: int = 1000
) -> Record:
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, samples // held), held)
    u[:held] = 0.0
    w = q = 0.0
    y = np.zeros((samples, 1))
    for k, d in enumerate(u.tolist()):
        y[k] = w
        for _ in range(FINE):
            w += DT / FINE / TAU * (gain * d - heavy * np.sin(q) - w)
            q += DT / FINE * w
    y += 0.05 * rng.standard_normal(y.shape)
    return Record(u[:, None], y, DT, (Channel("u", "V"),), (Channel("w", "rad/s"),))


def test_a_weight_heavier_than_the_usual_speed_is_admissible() -> None:
    gravity = effect("gravity-load")
    logs = [swinging(1), swinging(2)]
    speed = np.quantile(np.abs(logs[0].y), 0.95, axis=0)
    assert speed < HEAVY / 1.5
    model = FullModel((gravity,), 1, 1, speed, DT)
    search = ForwardSelection(model, logs[:1], logs[1:], np.ones(1), 1)
    start = model.null
    start[list(model.of("core"))] = [3.0, -0.8]
    base = search.base(start[None])
    search.origin = base.q
    (found,) = search.candidates(base, [gravity])
    assert found.evidence.accepted
    assert search.admissible(found.model)
    size = np.hypot(*(found.model.q[model.index[gravity.id, n, 0]] for n in ("cosine", "sine")))
    assert abs(size - HEAVY) < 0.02 * HEAVY  # what a step of a fifth of τ leaves


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5])
@pytest.mark.parametrize(("gain", "heavy"), [(10.0, 12.0), (20.0, 60.0)])
def test_a_weight_that_leaves_the_baseline_no_gain_is_found(
    gain: float, heavy: float, seed: int
) -> None:
    """It hangs under each command for 2 s: the speed is zero on average, whatever the command."""
    gravity = effect("gravity-load")
    logs = [swinging(seed, gain, heavy, 100), swinging(seed + 100, gain, heavy, 100)]
    speed = np.quantile(np.abs(logs[0].y), 0.95, axis=0)
    model = FullModel((gravity,), 1, 1, speed, DT)
    search = ForwardSelection(model, logs[:1], logs[1:], np.ones(1), 1)
    start = model.null
    start[list(model.of("core"))] = [3.0, -0.8]
    base = search.base(start[None])
    search.origin = base.q
    assert abs(base.q[model.index["core", "gain", 0]]) < 0.3 * gain
    (found,) = search.candidates(base, [gravity])
    assert found.evidence.accepted
    assert search.admissible(found.model)
    size = np.hypot(*(found.model.q[model.index[gravity.id, n, 0]] for n in ("cosine", "sine")))
    # half a radian of its swing in a sample: the wave is taken in the middle of each
    assert size == pytest.approx(heavy, rel=0.2)
