"""A weight that swings: the torque that lifts it is far more than the usual speed asks for."""

import numpy as np

from sysid.data.record import Channel, Record
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.full_model import FullModel
from sysid.effects.catalogue import effect

DT, FINE, TAU, GAIN = 0.02, 20, 0.1, 10.0
HEAVY = 12.0
"""Torque of the weight in units of steady speed; a quarter of the readings are above 3 rad/s."""


def swinging(seed: int, samples: int = 1000) -> Record:
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, samples // 25), 25)
    u[:25] = 0.0
    w = q = 0.0
    y = np.zeros((samples, 1))
    for k, d in enumerate(u.tolist()):
        y[k] = w
        for _ in range(FINE):
            w += DT / FINE / TAU * (GAIN * d - HEAVY * np.sin(q) - w)
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
