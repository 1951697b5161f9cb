"""Ripple and gravity: the law, the waves a rad and the size come out of data that hold them."""

import numpy as np
import pytest

from sysid.data.record import Channel, Record
from sysid.diagnosis.over_angle import over_angle, strongest_lines
from sysid.diagnosis.search.candidates import CandidateSearch
from sysid.diagnosis.search.full_model import FullModel
from sysid.effects.catalogue import effect
from sysid.structures.augmented.structure import Augmented

DT, KEPT, GAIN, SIGMA = 0.05, 0.8, 20.0, 0.1
EFFECTS = (effect("gravity-load"), effect("speed-ripple"))
MODEL = FullModel(EFFECTS, 1, 1, np.array([10.0]), DT)

RIPPLE = {"cosine": 0.0, "sine": 0.0, "per_turn": 1.0, "of_wheel": 1.0}
SHARES = {"share_cosine": 0.0, "share_sine": 0.0, "of_speed": 0.0}
SHARES |= {"load_cosine": 0.0, "load_sine": 0.0, "load_per_turn": 2.0, "of_load": 0.0}
GEARED = {"geared_cosine": 0.0, "geared_sine": 0.0, "geared": 0.0}
HIDDEN = {
    "a wave of one size": (
        "speed-ripple",
        {**RIPPLE, **SHARES, "cosine": 0.5, "sine": -0.3, "per_turn": 2.0},
    ),
    "off its centre": (
        "speed-ripple",
        {**RIPPLE, **SHARES, "share_cosine": 0.05, "share_sine": 0.03, "of_speed": 1.0},
    ),
    "cogging": (
        "speed-ripple",
        {**RIPPLE, **SHARES, "load_cosine": 2.0, "load_sine": 1.0, "of_load": 1.0},
    ),
    "a weight": ("gravity-load", {**RIPPLE, **GEARED, "cosine": 0.8, "sine": 1.0}),
    "a weight behind a gear": (
        "gravity-load",
        {**RIPPLE, "geared_cosine": 0.8, "geared_sine": 1.0, "per_turn": 0.4, "geared": 1.0},
    ),
}


def logged(id: str, numbers: dict[str, float], seed: int) -> Record:
    """A track under random holds, white noise."""
    rng = np.random.default_rng(seed)
    levels = rng.uniform(-1.0, 1.0, (80, 1))
    levels[0] = 0.0
    u = np.repeat(levels, 15, axis=0)
    theta = np.array([GAIN, -KEPT] + [numbers[p.name] for p in effect(id).parameters])
    y = Augmented(1, 1, (1.0,), DT, (id,)).simulate(theta, u)
    y = y + SIGMA * rng.standard_normal(y.shape)
    return Record(u, y, DT, (Channel("d", ""),), (Channel("omega", "rad/s"),))


@pytest.mark.parametrize("name", HIDDEN)
def test_the_right_law_is_found_with_its_size(name: str) -> None:
    id, numbers = HIDDEN[name]
    records = [logged(id, numbers, seed) for seed in (1, 2)]
    search = CandidateSearch(MODEL, records[:1], records[1:], np.ones(1), 1)
    start = MODEL.null
    start[list(MODEL.of("core"))] = [GAIN, -KEPT]
    base = search.base(start[None])
    search.origin = base.q
    best = search.candidates(base, EFFECTS)[0]
    assert best.id == id
    assert search.admissible(best.model)
    q = {p.name: float(best.model.q[MODEL.index[id, p.name, 0]]) for p in effect(id).parameters}
    # a weight may be fitted with waves a rad of its own: a drifting angle is straightened by them
    choices = ("of_speed", "of_load")
    assert [q.get(n) for n in choices] == [numbers.get(n) for n in choices]
    (hidden,) = (w for w in effect(id).waves if numbers[w.cosine])
    (wave,) = (w for w in effect(id).waves if q[w.cosine])
    # an angle counted from noisy readings wanders by a tenth of a rad in a minute
    assert q[wave.line] == pytest.approx(numbers[hidden.line], rel=0.01)
    size = np.hypot(numbers[hidden.cosine], numbers[hidden.sine])
    assert np.hypot(q[wave.cosine], q[wave.sine]) == pytest.approx(size, rel=0.1)


def test_a_torque_over_the_angle_slows_a_pendulum_on_its_way_up() -> None:
    """At rest under no command a weight swings to where it hangs: a sin φ = 0."""
    numbers = {**RIPPLE, **GEARED, "sine": 2.0}
    theta = np.array([GAIN, -KEPT] + [numbers[p.name] for p in effect("gravity-load").parameters])
    # 0.05 of full drive holds a torque of 1, half of what the weight has when it is level
    y = Augmented(1, 1, (1.0,), DT, ("gravity-load",)).simulate(theta, np.full((4000, 1), 0.05))
    assert abs(y[-1, 0]) < 1e-6
    assert DT * np.sum(y) == pytest.approx(np.pi / 6.0, abs=0.5 * DT)


def test_the_spectrum_over_an_angle_is_that_of_its_samples() -> None:
    rng = np.random.default_rng(3)
    angle = np.cumsum(rng.uniform(-0.5, 1.0, 3000))
    signal = np.cos(2.3 * angle + 0.4) + 0.5 * np.sin(7.7 * angle) + rng.standard_normal(3000)
    lines, whole = over_angle(angle, signal, 20.0)
    k = int(np.argmin(np.abs(lines - 2.3)))
    exact = np.sum(signal * np.exp(-1j * lines[k] * angle))
    # what bins of an eighth of the shortest wave blur, of a sum of 1500
    assert abs(whole[k] - exact) < 0.05 * abs(exact)
    found = strongest_lines(lines, np.abs(whole), (0.3, 20.0), float(np.ptp(angle)), 2)
    assert found == pytest.approx([2.3, 7.7], abs=2.0 * np.pi / np.ptp(angle))


@pytest.mark.parametrize(("speed", "dt", "finest"), [(15.0, 0.05, 20.0), (0.03, 0.1, 333.3)])
def test_waves_are_as_fine_as_samples_of_a_slow_axis_show(
    speed: float, dt: float, finest: float
) -> None:
    """The worm of a telescope makes 120 waves a rad; a wheel at speed shows only 20."""
    model = FullModel((effect("speed-ripple"),), 1, 1, np.array([speed]), dt)
    slot = model.index["speed-ripple", "per_turn", 0]
    assert model.parameters[slot].upper == pytest.approx(finest, rel=1e-3)
