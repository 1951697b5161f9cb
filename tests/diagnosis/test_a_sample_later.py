"""A delay of one sample on a base without any is that of the base, and no effect."""

import numpy as np
import pytest

from sysid.data.facts import LogFacts
from sysid.data.record import Channel, Record
from sysid.diagnosis.base_model import fit_baseline, full_drive
from sysid.diagnosis.first_order import or_a_sample_later
from sysid.diagnosis.session import DiagnosisSession, noise_of
from sysid.effects.catalogue import chain_effects


def _log(late: int, friction: float = 4.0, dt: float = 0.05) -> Record:
    rng = np.random.default_rng(3)
    u = np.repeat(rng.choice([-1.0, -0.6, 0.0, 0.6, 1.0], 80), 15)
    y, w, fine = np.zeros(len(u)), 0.0, 50
    for k in range(len(u)):
        y[k] = w
        drive = 25.0 * u[max(k + 1 - late, 0) if k + 1 - late < len(u) else -1]
        for _ in range(fine):
            push = drive - w
            held = abs(w) < 0.05 and abs(drive) < friction
            moved = push - friction * np.sign(w if abs(w) > 0.05 else drive)
            w = 0.0 if held else w + dt / fine / 0.3 * moved
    noisy = (y + rng.normal(0.0, 0.1, len(u)))[:, None]
    return Record(u[:, None], noisy, dt, (Channel("pwm", "V"),), (Channel("w", "rad/s"),))


@pytest.mark.slow
@pytest.mark.parametrize(("late", "named"), [(1, False), (2, True)])
def test_one_sample_of_delay_is_the_base_and_more_is_an_effect(late: int, named: bool) -> None:
    facts = LogFacts((_log(late),))
    base = fit_baseline(facts, None, chain_effects(), least_delay=0)
    session = DiagnosisSession(base, noise_of(base), full_drive(facts.records), 0)
    found = session.searched(base.search.model.effects, lambda text, share: None)
    assert "input-delay" in found.selection.final.effects
    kept = or_a_sample_later(found, facts, None)
    assert ("input-delay" in kept.selection.final.effects) is named
    assert "coulomb-friction" in kept.selection.final.effects
    assert kept.session.base.search.delay == int(not named)
