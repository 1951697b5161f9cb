"""What one effect hides on a track is tried there again together with the next effect."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.data.record import Record
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.moves import on_more_tracks
from sysid.effects.catalogue import effect

WIDTH = 0.15
"""Dead zone of both tracks, in parts of full drive."""


@pytest.fixture(scope="module")
def search() -> ForwardSelection:
    """Two tracks, each with the dead zone, read with little noise."""
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-1.0, 1.0, (40, 2)), 10, axis=0)
    acting = np.sign(u) * np.maximum(np.abs(u) - WIDTH, 0.0)
    y = np.zeros_like(u)
    for k in range(len(u) - 1):
        y[k + 1] = 0.8 * y[k] + 0.2 * 10.0 * acting[k]
    log = Record(u, y + 0.02 * rng.standard_normal(y.shape), 0.05)
    model = FullModel((effect("dead-zone"),), 1, 2, np.full(2, 8.0), 0.05)
    return ForwardSelection(model, [log], [log], np.ones(2), 1)


def numbers(search: ForwardSelection, left: float) -> np.ndarray:
    q = search.model.null.copy()
    for i in range(2):
        q[search.model.index["core", "gain", i]] = 10.0
        q[search.model.index["core", "f1", i]] = -0.8
    for name in ("plus", "minus"):
        q[search.model.index["dead-zone", name, 0]] = left
    return q


def test_a_track_far_above_the_noise_gets_what_another_track_has(search: ForwardSelection) -> None:
    mine = [k for k in search.model.of("dead-zone") if search.model.parameters[k].track == 0]
    node = search.evaluate(("dead-zone",), numbers(search, WIDTH), (*search.core, *mine))
    node = replace(node, touched=np.array([True, False]))
    wide = on_more_tracks(search, node)
    assert wide is not None
    assert wide.touched.all()
    theirs = [search.model.index["dead-zone", name, 1] for name in ("plus", "minus")]
    assert set(theirs) <= set(wide.free)
    # 400 readings with an error of 0.02 of 10: standard errors are near 0.0005
    np.testing.assert_allclose(wide.q[theirs], WIDTH, atol=0.005)


def test_nothing_is_widened_where_every_track_has_it(search: ForwardSelection) -> None:
    free = (*search.core, *search.model.of("dead-zone"))
    assert (
        on_more_tracks(search, search.evaluate(("dead-zone",), numbers(search, WIDTH), free))
        is None
    )
