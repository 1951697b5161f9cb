"""A speed counted over a sample comes half of one late: no effect, and none that looks like it."""

import numpy as np

from sysid.data.record import Channel, Record
from sysid.discrepancy.search.naming import NamingSearch
from sysid.discrepancy.search.supermodel import SuperModel
from sysid.effects.catalogue import effect

DT, TAU, GAIN, SIGMA = 0.05, 0.25, 20.0, 0.2
KEPT = float(np.exp(-DT / TAU))
EFFECTS = (effect("input-delay"), effect("rate-limit"), effect("dead-zone"))


def counted(seed: int, dead: float = 0.0) -> Record:
    """One motor whose encoder gives the mean speed of each sample; steps between a few levels."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-0.8, -0.4, 0.0, 0.4, 0.8], 80), 10)
    y, w, mean = np.zeros(len(u)), 0.0, 0.0
    for k, d in enumerate(u):
        y[k] = mean
        torque = GAIN * np.sign(d) * max(abs(d) - dead, 0.0)
        mean = torque + (w - torque) * TAU / DT * (1.0 - KEPT)
        w = torque + (w - torque) * KEPT
    y += SIGMA * rng.standard_normal(len(u))
    return Record(u[:, None], y[:, None], DT, (Channel("d", ""),), (Channel("omega", "rad/s"),))


def searched(dead: float) -> tuple[dict[str, bool], tuple[str, ...]]:
    """Which effects pass the rule alone, and the names that are given."""
    model = SuperModel(EFFECTS, 1, 1, np.array([15.0]), DT)
    search = NamingSearch(model, [counted(1, dead)], [counted(2, dead)], np.ones(1), 1)
    start = model.null
    start[list(model.of("core"))] = [GAIN, -KEPT]
    base = search.base(start[None])
    search.origin = base.q
    judged = search.candidates(base, EFFECTS)
    alone = {j.id: j.evidence.accepted and search.admissible(j.node) for j in judged}
    return alone, tuple(n.id for n in search.run(base, EFFECTS).named)


def test_a_steep_rate_limit_is_not_named_for_counted_speeds() -> None:
    alone, names = searched(0.0)
    assert alone["rate-limit"]  # it would be named if nothing else were known
    assert not alone["input-delay"]  # below one sample
    assert names == ()


def test_a_dead_zone_is_found_in_counted_speeds() -> None:
    assert searched(0.15)[1] == ("dead-zone",)
