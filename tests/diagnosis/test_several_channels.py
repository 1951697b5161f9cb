"""Logs with several inputs of one output, and with several outputs of one input.

The machines are integrated by Heun's rule at 20 steps a sample, which is no step of the chain.
"""

from collections.abc import Callable

import numpy as np
import pytest

from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.diagnosis import Diagnosis
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import prepare
from sysid.effects.catalogue import catalogue
from sysid.structures.augmented.batch import Stepped

pytestmark = pytest.mark.slow

DT, FINE = 0.05, 20


def integrated(slope: Callable[[Array, Array], Array], u: Array, states: int) -> Array:
    """States at each sample of a machine ẋ = slope(x, u) whose commands are held, (N, states)."""
    x, seen, h = np.zeros(states), np.zeros((len(u), states)), DT / FINE
    for k, held in enumerate(u):
        seen[k] = x
        for _ in range(FINE):
            first = slope(x, held)
            x = x + 0.5 * h * (first + slope(x + h * first, held))
    return seen


def levels(rng: np.random.Generator, samples: int, low: float, high: float) -> Array:
    """A command that is held for some samples at random levels."""
    held = np.repeat(rng.uniform(low, high, samples), rng.integers(6, 25, samples))
    return np.asarray(held[:samples])


def fan(seed: int, dead: float, drag: float = 0.0, samples: int = 700) -> Record:
    """A fan on the shaft of two motors: the second one starts to pull at a voltage of its own."""
    rng = np.random.default_rng(seed)
    u = np.column_stack([levels(rng, samples, -12.0, 12.0), levels(rng, samples, -6.0, 6.0)])

    def slope(w: Array, v: Array) -> Array:
        pull = 3.0 * v[0] + 4.0 * np.sign(v[1]) * max(abs(v[1]) - dead, 0.0)
        return np.asarray((pull - w - drag * w * np.abs(w)) / 0.4)

    y = integrated(slope, u, 1) + 0.05 * rng.standard_normal((samples, 1))
    channels = (Channel("main", "V"), Channel("booster", "V")), (Channel("omega", "rad/s"),)
    return Record(u, y, DT, *channels, name=f"fan{seed}.csv", sha256=f"fan{seed}")


def two_shafts(seed: int, dead: float, samples: int = 700) -> Record:
    """A motor and a shaft that it drives over a belt: the driver passes nothing below a voltage."""
    rng = np.random.default_rng(seed)
    u = levels(rng, samples, -12.0, 12.0)[:, None]

    def slope(w: Array, v: Array) -> Array:
        pull = np.sign(v[0]) * max(abs(v[0]) - dead, 0.0)
        return np.array([(5.0 * pull - w[0]) / 0.3, (2.0 * pull - w[1]) / 0.5])

    y = integrated(slope, u, 2) + 0.04 * rng.standard_normal((samples, 2))
    outputs = (Channel("motor", "rad/s"), Channel("shaft", "rad/s"))
    name = f"shafts{seed}"
    return Record(u, y, DT, (Channel("v", "V"),), outputs, name=f"{name}.csv", sha256=name)


def values(found: Diagnosis) -> dict[str, float]:
    return {p.name: p.value for e in found.effects for p in e.parameters}


def test_of_two_inputs_the_one_with_a_dead_zone_is_named() -> None:
    logs = fan(1, 1.5), fan(2, 1.5)
    found = diagnose(logs[:1], logs[1:])
    assert [e.id for e in found.effects] == ["dead-zone"]
    size, full = values(found), float(np.abs(logs[0].u[:, 1]).max())
    for side in ("plus", "minus"):  # beyond it the command acts less width and jump: both are found
        lost = size[f"{side}[booster]"] - size["jump[booster]"]
        assert full * lost == pytest.approx(1.5, abs=0.05)
        assert f"{side}[main]" not in size
    assert found.gap.closed_percent > 99.0
    # the stored model is the one that was searched
    model = found.after
    run = model.simulate(logs[1].u, model.fitted_state(logs[1], 1))
    assert np.std(run - logs[1].y) == pytest.approx(0.05, rel=0.1)


def test_what_slows_the_sum_of_two_inputs_is_named() -> None:
    found = diagnose([fan(3, 0.0, 0.02)], [fan(4, 0.0, 0.02)])
    assert [e.id for e in found.effects] == ["quadratic-drag"]
    assert values(found)["drag[omega]"] == pytest.approx(0.02, abs=0.001)


def test_two_inputs_without_an_effect_get_no_name() -> None:
    assert diagnose([fan(3, 0.0)], [fan(4, 0.0)]).effects == ()


def test_two_outputs_share_what_is_done_to_their_one_command() -> None:
    logs = two_shafts(1, 1.5), two_shafts(2, 1.5)
    found = diagnose(logs[:1], logs[1:])
    assert [e.id for e in found.effects] == ["dead-zone"]
    size, full = values(found), float(np.abs(logs[0].u).max())
    assert full * (size["plus"] - size["jump"]) == pytest.approx(1.5, abs=0.05)
    model = found.after
    run = model.simulate(logs[1].u, model.fitted_state(logs[1], 1))
    assert np.std(run - logs[1].y) == pytest.approx(0.04, rel=0.1)


def test_a_run_without_a_compiler_is_the_same() -> None:
    some = tuple(catalogue()[id] for id in ("dead-zone", "coulomb-friction"))
    log = fan(5, 1.0, samples=60)
    data = prepare([log], np.array([12.0, 6.0]), 1)
    fast = FullModel(some, 1, 1, np.array([30.0]), DT, 2)
    slow = Stepped(some, 1, 2, DT, 1)
    q = fast.null[None].copy()
    fast.set_core(q[0], 0, 35.0, np.array([-0.9]))
    q[0, fast.index["core", "gain", 1]] = 20.0
    q[0, fast.index["dead-zone", "plus", 1]] = 0.2
    q[0, fast.index["coulomb-friction", "level", 0]] = 1.0
    again = slow.run(q, fast.null, fast._entries, data.signals)
    np.testing.assert_allclose(fast.run(q, data), again, atol=1e-10)
