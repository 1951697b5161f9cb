"""A speed counted over a sample comes half of one late: no effect, and none that looks like it."""

from collections.abc import Sequence

import numpy as np
import pytest

from sysid.data.record import Channel, Record
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.search.forward_selection import ForwardSelection
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.selection import CandidateModel
from sysid.effects.catalogue import effect
from sysid.effects.sensor import SAMPLING

DT, TAU, GAIN, SIGMA = 0.05, 0.25, 20.0, 0.2
KEPT = float(np.exp(-DT / TAU))
EFFECTS = (effect("input-delay"), effect("rate-limit"), effect("dead-zone"))
MODEL = FullModel((*EFFECTS, SAMPLING), 1, 1, np.array([15.0]), DT)


def counted(seed: int, dead: float = 0.0, levels: int = 5) -> Record:
    """One motor whose encoder gives the mean speed of each sample; steps between some levels."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice(np.linspace(-0.8, 0.8, levels), 80), 10)
    y, w, mean = np.zeros(len(u)), 0.0, 0.0
    for k, d in enumerate(u):
        y[k] = mean
        torque = GAIN * np.sign(d) * max(abs(d) - dead, 0.0)
        mean = torque + (w - torque) * TAU / DT * (1.0 - KEPT)
        w = torque + (w - torque) * KEPT
    y += SIGMA * rng.standard_normal(len(u))
    return Record(u[:, None], y[:, None], DT, (Channel("d", ""),), (Channel("omega", "rad/s"),))


def late(seed: int, share: float) -> Record:
    """One motor whose commands act a part of a sample late."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice(np.linspace(-0.8, 0.8, 33), 80), 10)
    y, w, before = np.zeros(len(u)), 0.0, 0.0
    for k, d in enumerate(u):
        y[k] = w
        for command, part in ((before, share), (d, 1.0 - share)):
            kept = float(np.exp(-part * DT / TAU))
            w = GAIN * command + (w - GAIN * command) * kept
        before = d
    y += SIGMA * rng.standard_normal(len(u))
    return Record(u[:, None], y[:, None], DT, (Channel("d", ""),), (Channel("omega", "rad/s"),))


def searched(logs: Sequence[Record]) -> tuple[dict[str, bool], CandidateModel, float]:
    """Which effects pass the rule alone, what the search ends with, and its part of a sample."""
    effects, model = (*EFFECTS, SAMPLING), MODEL
    search = ForwardSelection(model, logs[:1], logs[1:], np.ones(1), 1)
    start = model.null
    start[list(model.of("core"))] = [GAIN, -KEPT]
    base = search.base(start[None])
    search.origin = base.q
    judged = search.candidates(base, EFFECTS)
    alone = {j.id: j.evidence.accepted and search.admissible(j.model) for j in judged}
    final = search.run(base, effects).final
    return alone, final, float(final.q[model.index[SAMPLING.id, "share", 0]])


def test_a_steep_rate_limit_is_not_named_for_counted_speeds() -> None:
    alone, final, share = searched([counted(1), counted(2)])
    assert alone["rate-limit"]  # it would be named if nothing else were known
    assert not alone["input-delay"]  # up to half a sample
    assert final.effects == (SAMPLING.id,)
    assert share == pytest.approx(0.5, abs=0.03)  # a mean is half a sample late


def test_a_dead_zone_is_found_in_counted_speeds() -> None:
    _, final, share = searched([counted(1, 0.15), counted(2, 0.15)])
    assert set(final.effects) == {"dead-zone", SAMPLING.id}
    assert share == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize("share", [0.65, 0.8])
def test_a_delay_longer_than_counting_makes_is_named_with_all_of_it(share: float) -> None:
    _, final, _ = searched([late(1, share), late(2, share)])
    assert final.effects == ("input-delay",)
    delay = float(final.q[MODEL.index["input-delay", "delay", 0]])
    assert delay == pytest.approx(share * DT, abs=0.02 * DT)


@pytest.mark.slow
def test_how_the_log_was_made_belongs_to_both_models_and_is_not_named() -> None:
    found = diagnose([counted(1, 0.15, levels=33)], [counted(2, 0.15, levels=33)])
    assert [e.id for e in found.effects] == ["dead-zone"]
    assert "of a sample late" in found.base_words
    for model in (found.before, found.after):
        assert SAMPLING.id in model.structure.effects  # type: ignore[attr-defined]
    pole = dict(zip([p.name for p in found.after.parameters], found.after.theta, strict=True))
    assert pole["f1[omega]"] == pytest.approx(-KEPT, abs=0.006)  # 4 % of the time constant
