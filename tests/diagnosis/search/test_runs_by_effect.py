"""Items of a batch of the full model go through a simulation of the effects that act in them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from sysid.data.record import Record
from sysid.diagnosis.search.batched_search import best_tracks
from sysid.diagnosis.search.full_model import (
    BATCH_SIZE,
    GROUP_PARAMETERS,
    FullModel,
    at_once,
    groups,
    stages,
)
from sysid.diagnosis.search.prepared import prepare
from sysid.effects.base import Effect
from sysid.effects.catalogue import chain_effects, effect

ACTING = {
    (): {},
    ("coulomb-friction",): {("coulomb-friction", "level", 0): 1.2},
    ("dead-zone",): {("dead-zone", "plus", 1): 0.2},
    ("rate-limit",): {("rate-limit", "rate", 1): 0.5},
    ("coulomb-friction", "rate-limit"): {
        ("coulomb-friction", "level", 0): 1.2,
        ("rate-limit", "rate", 1): 0.5,
    },
}


@pytest.fixture(scope="module")
def record() -> Record:
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 1.0, (10, 2)), 20, axis=0)
    return Record(u, 0.1 * rng.standard_normal(u.shape), 0.05)


def test_each_lane_runs_as_with_all_effects_at_once(record: Record) -> None:
    some = tuple(effect(id) for id in ("dead-zone", "rate-limit", "load-bias", "coulomb-friction"))
    model = FullModel(some, 1, 2, np.array([10.0, 12.0]), record.dt)
    data = prepare([record], np.ones(2), 1)
    q = np.repeat(model.null[None], len(ACTING), axis=0)
    for row, values in zip(q, ACTING.values(), strict=True):
        row[[model.index["core", "f1", i] for i in range(2)]] = -0.8
        for key, value in values.items():
            row[model.index[key]] = value
    filled = np.concatenate([q, np.repeat(q[-1:], BATCH_SIZE - len(q), axis=0)])
    at_once = model.simulation(model.effects)
    expected = np.asarray(at_once(filled, data.arrays))[: len(q)]
    assert np.ptp(expected, axis=0).max() > 1.0
    # the same operations, fused in another order
    np.testing.assert_allclose(model.run(q, data), expected, atol=1e-12 * np.abs(expected).max())


def test_machines_of_one_kind_share_what_is_compiled() -> None:
    some = tuple(effect(id) for id in ("dead-zone", "load-bias"))
    slow, fast = (FullModel(some, 1, 2, np.full(2, v), 0.05) for v in (2.0, 40.0))
    assert slow.simulation(some[:1]) is fast.simulation(some[:1])
    other = FullModel(some, 1, 2, np.full(2, 2.0), 0.02)
    assert other.simulation(some[:1]) is not slow.simulation(some[:1])


def test_more_lanes_than_a_call_holds_come_back_in_their_order(record: Record) -> None:
    model = FullModel((effect("coulomb-friction"),), 1, 1, np.array([10.0]), record.dt)
    data = prepare([Record(record.u[:, :1], record.y[:, :1], record.dt)], np.ones(1), 1)
    q = np.repeat(model.null[None], 2 * BATCH_SIZE + 3, axis=0)
    q[:, model.index["core", "f1", 0]] = np.linspace(-0.9, -0.5, len(q))
    q[::3, model.index["coulomb-friction", "level", 0]] = 0.7
    together = model.run(q, data)
    for k in (0, 1, BATCH_SIZE, len(q) - 1):
        np.testing.assert_array_equal(together[k], model.run(q[k : k + 1], data)[0])


@pytest.mark.parametrize("stage", [0, 1], ids=["whole commands", "stepped"])
def test_every_effect_up_to_the_motion_is_in_one_group(stage: int) -> None:
    mine = stages(chain_effects())[stage]
    found = groups(mine)
    assert tuple(e for group in found for e in group) == mine
    sizes = [sum(len(e.parameters) for e in group) for group in found if len(group) > 1]
    assert sizes
    assert max(sizes) <= GROUP_PARAMETERS


def test_what_looks_at_one_sample_of_the_command_is_compiled_for_no_other_simulation(
    record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = stages(chain_effects())[0]
    model = FullModel(some, 1, 2, np.ones(2), record.dt)
    held: list[set[str]] = []
    whole = model.simulation

    def noted(acting: Sequence[Effect]) -> Callable[..., Any]:
        held.append({e.id for e in acting})
        return whole(acting)

    monkeypatch.setattr(model, "simulation", noted)
    q = np.repeat(model.null[None], 3, axis=0)
    q[1, model.index["dead-zone", "plus", 0]] = 0.2
    q[2, model.index["input-delay", "delay", 0]] = 0.1
    model.run(q, prepare([record], np.ones(2), 1))
    later = [e for e in some if not at_once(e)]
    (own,) = (group for group in groups(later) if effect("input-delay") in group)
    assert sorted(held, key=len) == [set(), {e.id for e in own}]
    assert len(own) < len(some)


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
