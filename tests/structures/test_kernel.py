"""The compiled free run of the chain is its ``step``, whatever acts."""

from itertools import pairwise

import numpy as np
import pytest

from sysid.data.record import Record
from sysid.diagnosis.search.batched_search import best_tracks
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import Data, prepare
from sysid.effects.catalogue import NOT_NAMED, catalogue, chain_effects, effect
from sysid.runners import native
from sysid.structures.augmented.batch import Stepped
from sysid.structures.augmented.kernel import kernel

CHAOTIC = "backlash"
"""A gap that is crossed a little sooner is another run: rounding decides after some reversals."""

pytestmark = pytest.mark.skipif(native.compiler() is None, reason="there is no C compiler")


def data_of(tracks: int) -> Data:
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 1.0, (12, tracks)), 12, axis=0)
    at_rest, moving = 0.1 * rng.standard_normal((2, *u.shape))
    moving[0] = 3.0
    records = [Record(u, y, 0.05) for y in (at_rest, moving)]
    return prepare(records, np.ones(tracks), 2)


@pytest.mark.parametrize(
    ("tracks", "order"),
    [(1, 1), (2, 2), *(pytest.param(*p, marks=pytest.mark.slow) for p in ((2, 1), (1, 3)))],
)
def test_every_effect_alone_and_beside_others_runs_as_it_steps(tracks: int, order: int) -> None:
    effects = (*chain_effects(), NOT_NAMED["sampling-lag"])
    model = FullModel(effects, order, tracks, np.full(tracks, 10.0), 0.05)
    data = data_of(tracks)
    q = model.null
    for i in range(tracks):
        model.set_core(q, i, 10.0 + i, np.poly([0.8, 0.3, 0.1][:order])[1:], [0.02] * (order - 1))
    singles = []
    for e in effects:
        start = model.starts(e)[-1]
        row = q.copy()
        row[list(start)] = list(start.values())
        singles.append(row)
    both = [np.where(a != model.null, a, b) for a, b in pairwise(singles)]
    stepped = Stepped(model.effects, order, tracks, 0.05)
    for row in (q, *singles, *both):
        acting = {p.owner for p, v in zip(model.parameters, row, strict=True) if v != p.null}
        rows = 60 if CHAOTIC in acting else None
        expected = stepped.run(row[None], model.null, model._entries, data.signals)[0, :rows]
        found = model.run(row, data)[0, :rows]
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_machines_of_one_kind_share_what_is_compiled() -> None:
    some = tuple(effect(id) for id in ("dead-zone", "load-bias"))
    assert kernel(some, 1, 2, 0.05) is kernel(some, 1, 2, 0.05)
    slow, fast = (FullModel(some, 1, 2, np.full(2, v), 0.05) for v in (2.0, 40.0))
    assert slow._kernel is fast._kernel


def test_many_runs_come_back_in_their_order() -> None:
    model = FullModel((effect("coulomb-friction"),), 1, 1, np.array([10.0]), 0.05)
    data = data_of(1)
    q = np.repeat(model.null[None], 403, axis=0)
    q[:, model.index["core", "f1", 0]] = np.linspace(-0.9, -0.5, len(q))
    q[::3, model.index["coulomb-friction", "level", 0]] = 0.7
    together = model.run(q, data)
    for k in (0, 1, 200, len(q) - 1):
        np.testing.assert_array_equal(together[k], model.run(q[k : k + 1], data)[0])


def test_without_a_compiler_the_same_runs_take_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    some, data = tuple(catalogue()[id] for id in ("dead-zone", "coulomb-friction")), data_of(2)
    compiled = FullModel(some, 1, 2, np.full(2, 10.0), 0.05)
    monkeypatch.setattr("sysid.diagnosis.search.full_model.compiler", lambda: None)
    plain = FullModel(some, 1, 2, np.full(2, 10.0), 0.05)
    q = np.repeat(plain.null[None], 2, axis=0)
    q[:, [plain.index["core", "f1", i] for i in range(2)]] = -0.8
    q[1, plain.index["coulomb-friction", "level", 0]] = 0.7
    np.testing.assert_allclose(plain.run(q, data), compiled.run(q, data), atol=1e-11)


def test_runs_that_grow_without_end_cost_no_warning() -> None:
    """Starts may be unstable: each cost is a number, and their sum is none."""
    model = FullModel((effect("coulomb-friction"),), 1, 2, np.ones(2), 0.05)
    q = np.repeat(model.null[None], 3, axis=0)
    q[:, model.index["core", "gain", 0]] = (1.0, 2.0, 3.0)
    cost = np.array([[1.5e308, 1.5e308], [1.0, np.nan], [2.0, 1.5e308]])
    found = best_tracks(model, q, cost)
    assert found[model.index["core", "gain", 0]] == 2.0
    huge = np.full((1, 2), 1e160)
    data = prepare([Record(np.zeros((8, 2)), np.zeros((8, 2)), 0.05)], np.ones(2), 1)
    assert np.all(data.squared_error(np.repeat(huge, len(data.y), axis=0)) >= 0.0)
