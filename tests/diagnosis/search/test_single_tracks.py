"""What acts on one track is tried on the other, and dropped where the others make it needless."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.base_model import Base, fit_baseline
from sysid.diagnosis.search.selection import CandidateModel
from sysid.effects.catalogue import chain_effects
from sysid.structures.augmented.structure import Augmented

DT, NOISE = 0.05, 0.1


def log(seed: int, effects: tuple[str, ...], numbers: list[float]) -> Record:
    """Two tracks, K = 20 and τ = 0.25 s, with effects; of each its numbers left, then right."""
    levels = np.random.default_rng(seed).uniform(-1.0, 1.0, (40, 2))
    u: Array = np.repeat(levels, 15, axis=0)
    core = [20.0, -float(np.exp(-DT / 0.25))] * 2
    s = Augmented(1, 1, (1.0, 1.0), DT, effects)
    y = s.simulate(np.array([*core, *numbers]), u)
    y += NOISE * np.random.default_rng(seed + 9).standard_normal(y.shape)
    inputs = (Channel("duty_l"), Channel("duty_r"))
    return Record(u, y, DT, inputs, (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s")))


def baseline(effects: tuple[str, ...], numbers: list[float]) -> Base:
    some = [e for e in chain_effects() if e.id in ("coulomb-friction", "rate-limit")]
    return fit_baseline([log(1, effects, numbers)], [log(2, effects, numbers)], some)


def with_numbers(base: Base, values: dict[tuple[str, str, int], float]) -> CandidateModel:
    """The base with effects at these numbers (effect, name, track), fitted."""
    search, q = base.search, base.model.q.copy()
    search.origin = base.model.q
    at = [search.model.index[key] for key in values]
    q[at] = list(values.values())
    plain = replace(base.model, effects=tuple(dict.fromkeys(id for id, *_ in values)))
    return search.fitted(plain, q, (*base.model.free, *at))


@pytest.fixture(scope="module")
def friction() -> Base:
    return baseline(("coulomb-friction",), [0.8, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0])


def test_friction_of_one_track_is_found_on_the_other(friction: Base) -> None:
    search, at = friction.search, friction.search.model.index
    one = with_numbers(friction, {("coulomb-friction", "level", 0): 0.8})
    both = search._on_more_tracks(friction.model, one)
    # three standard errors of a level in 600 samples of noise 0.1
    assert both.q[at["coulomb-friction", "level", 1]] == pytest.approx(0.5, abs=0.06)
    assert both.touched.all()
    assert search._on_more_tracks(friction.model, both) is both


def test_a_ramp_that_a_track_does_not_need_is_dropped_there() -> None:
    ramp, friction = [1e12, 1e12, 0.0, 1.5, 1.5, 0.0], [0.8, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0]
    base = baseline(("rate-limit", "coulomb-friction"), [*ramp, *friction])
    search = base.search
    levels = {("coulomb-friction", "level", 0): 0.8, ("coulomb-friction", "level", 1): 0.5}
    ramps = {("rate-limit", "rate", 0): 90.0, ("rate-limit", "rate", 1): 1.6}
    kept = search.pruned(base.model, with_numbers(base, levels | ramps))
    assert search._on(kept, "coulomb-friction") == (0, 1)
    assert search._on(kept, "rate-limit") == (1,)
    # a response of .25 s hides what a ramp of 15 samples takes: a few percent
    assert kept.q[search.model.index["rate-limit", "rate", 1]] == pytest.approx(1.5, rel=0.05)
