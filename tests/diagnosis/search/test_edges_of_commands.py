"""A driver that leaves out short pulses: an edge beyond which the whole command acts.

No slope moves such an edge, and between two levels of the command nothing tells where it lies.
"""

import numpy as np
import pytest

from sysid import diagnose
from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import prepare
from sysid.diagnosis.search.refinement import refined
from sysid.effects.catalogue import effect

DT, POLE, GAIN = 0.05, 0.85, 30.0
EDGE = 0.155


def log(seed: int, levels: Array, samples: int = 1600) -> Record:
    """A wheel that is driven at levels, held for a while each; pulses below EDGE are left out."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice(levels, samples), rng.integers(6, 30, samples))[:samples]
    y = np.zeros(samples)
    for k in range(1, samples):
        acts = u[k - 1] if abs(u[k - 1]) > EDGE else 0.0
        y[k] = POLE * y[k - 1] + (1.0 - POLE) * GAIN * acts
    y += rng.normal(0.0, 0.2, samples)
    channels = (Channel("duty"),), (Channel("omega", "rad/s"),)
    return Record(u[:, None], y[:, None], DT, *channels)


def symmetric(*levels: float) -> Array:
    return np.array([*levels, *(-v for v in levels)])


@pytest.mark.slow
@pytest.mark.parametrize(
    "held",
    [
        symmetric(0.0, 0.11, 0.17, 0.3, 0.6, 1.0),
        # levels that lie between those of the estimation log: only the held-out log tells
        symmetric(0.0, 0.145, 0.15, 0.3, 0.6, 1.0),
        symmetric(0.0, 0.1, 0.16, 0.165, 0.3, 0.6, 1.0),
    ],
    ids=["levels seen", "lower levels", "higher levels"],
)
def test_an_edge_with_the_whole_command_behind_is_found(held: Array) -> None:
    estimation = log(1, symmetric(0.0, 0.08, 0.14, 0.17, 0.25, 0.4, 0.7, 1.0))
    found = diagnose(estimation, log(2, held))
    assert [e.id for e in found.effects] == ["dead-zone"]
    assert found.gap is not None
    assert found.gap.closed_percent > 95.0
    for p in found.effects[0].parameters:
        assert p.std_error is not None
        assert abs(p.value - EDGE) < 3.0 * p.std_error, p


def test_edges_of_several_lanes_move_as_each_alone() -> None:
    record = log(1, symmetric(0.0, 0.08, 0.14, 0.17, 0.25, 0.4, 0.7, 1.0), samples=300)
    model = FullModel((effect("dead-zone"), effect("load-bias")), 1, 1, np.array([GAIN]), DT)
    data = prepare([record], np.ones(1), 1)
    q = np.repeat(model.null[None], 3, axis=0)
    q[:, model.index["core", "f1", 0]] = -POLE
    for row, edge in zip(q, (0.1, 0.15, 0.2), strict=True):
        for side in ("plus", "minus"):
            row[model.index["dead-zone", side, 0]] = edge
    core = model.of("core")
    dead = (*core, *model.of("dead-zone"))
    free = [dead, core, tuple(range(len(model.parameters)))]
    together, cost = refined(model, q, free, data, 4, 1e-4)
    for k, mine in enumerate(free):
        alone, least = refined(model, q[k : k + 1], [mine], data, 4, 1e-4)
        # the same runs; only the equations are solved in a wider frame, whose rounding the
        # conditioning of four steps multiplies (1.5e-8 seen on another processor)
        np.testing.assert_allclose(together[k], alone[0], rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(cost[k], least[0], rtol=1e-9)
