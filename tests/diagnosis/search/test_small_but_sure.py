"""An effect is judged by what it does to the errors, not by how large its number could be."""

import numpy as np

from sysid.data.record import Channel, Record
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.full_model import FullModel
from sysid.effects.catalogue import effect

DT, KEPT, GAIN, TURNING = 0.05, 0.8, 20.0, 0.04


def turning(seed: int) -> Record:
    """Two tracks on ground that resists turning by a twenty-fifth of what a motor's own loss is."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice(np.linspace(-0.8, 0.8, 9), (40, 2)), 20, axis=0)
    y, w = np.zeros_like(u), np.zeros(2)
    for k, d in enumerate(u):
        y[k] = w
        w = KEPT * w + (1.0 - KEPT) * (GAIN * d - TURNING * 0.5 * (w - w[::-1]))
    y += 0.05 * rng.standard_normal(y.shape)
    sides = ("left", "right")
    return Record(
        u, y, DT, tuple(Channel(s, "") for s in sides), tuple(Channel(s, "rad/s") for s in sides)
    )


def test_a_weak_coupling_that_takes_most_of_the_error_is_found() -> None:
    coupling = effect("cross-coupling")
    model = FullModel((coupling,), 1, 2, np.array([15.0, 15.0]), DT)
    search = ForwardSelection(model, [turning(1)], [turning(2)], np.ones(2), 1)
    start = model.null
    start[list(model.of("core"))] = [GAIN, -KEPT] * 2
    base = search.base(start[None])
    final = search.run(base, [coupling]).final
    assert final.effects == ("cross-coupling",)
    slots = [k for k in model.of("cross-coupling") if model.parameters[k].name == "turning"]
    np.testing.assert_allclose(final.q[slots], TURNING, rtol=0.1)  # a standard error is 3 %
