"""A drive that limits way and turn: neither side's own limit, nor one that the body makes."""

import numpy as np
import pytest

from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.selection import ScoredCandidate
from sysid.effects.base import Context
from sysid.effects.catalogue import effect

DT, KEPT, GAIN, SIGMA = 0.05, 0.8, 20.0, 0.1
TWIST = effect("twist-limit")
RIVALS = (effect("input-saturation"), TWIST, effect("cross-coupling"))
MODEL = FullModel(RIVALS, 1, 2, np.array([10.0, 10.0]), DT)
NONE = {"forward": 1e3, "turning": 1e3, "side": 1e3}


def taken(command: Array, forward: float = 9.0, turning: float = 9.0, side: float = 9.0) -> Array:
    """What a controller makes of commands (N, 2): the twist is clipped, then the faster wheel."""
    way = np.clip(command.mean(axis=1), -forward, forward)
    turn = np.clip(0.5 * (command[:, 1] - command[:, 0]), -turning, turning)
    sides = np.column_stack([way - turn, way + turn])
    fastest = np.abs(sides).max(axis=1)
    return sides / np.maximum(fastest / side, 1.0)[:, None]


@pytest.mark.parametrize(
    "limits", [{"forward": 0.5, "turning": 0.3}, {"turning": 0.3, "side": 0.6}]
)
def test_its_step_is_what_a_controller_does(limits: dict[str, float]) -> None:
    command = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 2))
    numbers = {k: np.full(2, v) for k, v in (NONE | limits).items()}
    context = Context(DT, *[np.zeros(2)] * 10)
    found = np.array([TWIST.step(np, d, (), numbers, context)[0] for d in command])
    np.testing.assert_allclose(found, taken(command, **limits), atol=1e-12)


def logged(limits: dict[str, float], seed: int, straight: bool = False) -> Record:
    """Two equal tracks under random holds, white noise."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, (60, 2)), 10, axis=0)
    u[:, 1] = u[:, 0] if straight else u[:, 1]
    drive, y = taken(u, **limits), np.zeros_like(u)
    for k in range(1, len(u)):
        y[k] = KEPT * y[k - 1] + (1.0 - KEPT) * GAIN * drive[k - 1]
    y += SIGMA * rng.standard_normal(y.shape)
    inputs = (Channel("d_l", ""), Channel("d_r", ""))
    return Record(u, y, DT, inputs, (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")))


def tried(
    limits: dict[str, float], straight: bool = False
) -> tuple[ForwardSelection, list[ScoredCandidate]]:
    logs = [logged(limits, seed, straight) for seed in (1, 2)]
    search = ForwardSelection(MODEL, logs[:1], logs[1:], np.ones(2), 1)
    start = MODEL.null
    start[list(MODEL.of("core"))] = [GAIN, -KEPT] * 2
    base = search.base(start[None])
    search.origin = base.q
    return search, search.candidates(base, RIVALS)


@pytest.mark.parametrize(
    "limits", [{"forward": 0.5, "turning": 0.3}, {"turning": 0.3, "side": 0.6}]
)
def test_it_is_told_from_limits_of_sides_and_from_a_tie_of_both(limits: dict[str, float]) -> None:
    search, (first, *_) = tried(limits)
    assert first.id == TWIST.id
    assert first.evidence.accepted
    for name, value in limits.items():
        # five standard errors and more of what this noise leaves
        assert first.model.q[MODEL.index[TWIST.id, name, -1]] == pytest.approx(value, abs=0.01)
    assert search.admissible(first.model)


def test_driven_straight_ahead_it_is_no_more_than_each_sides_limit() -> None:
    search, judged = tried({"forward": 0.5}, straight=True)
    assert TWIST.id in {j.id for j in judged}
    assert search.passing(judged)[0].id == "input-saturation"
