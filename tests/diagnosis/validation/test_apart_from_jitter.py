"""Uneven delays of commands spoil errors behind changes; what shows between is still named."""

import numpy as np

from sysid.data.record import Channel, Record
from sysid.diagnosis.base_model import fit_baseline, full_drive
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.session import DiagnosisSession, noise_of
from sysid.effects.catalogue import effect

DT, FINE, STEPS, HOLD = 0.03, 30, 60, 30
EFFECTS = tuple(effect(id) for id in ("input-delay", "dead-zone", "concave-gain"))


def logged(short: float, jitter: float, seed: int) -> Record:
    """A drive that stays short by so much behind a line whose delay is drawn for each command."""
    rng = np.random.default_rng(seed)
    levels = np.zeros(STEPS)
    levels[1::2] = rng.permutation(np.repeat(np.arange(25.0, 176.0, 25.0), 5)[: STEPS // 2])
    levels[1::2] *= rng.choice([-1.0, 1.0], STEPS // 2)
    u = np.repeat(levels, HOLD)
    late = np.repeat(0.06 + jitter * rng.uniform(-1.0, 1.0, STEPS), HOLD * FINE)
    clock = np.arange(len(u) * FINE) * DT / FINE
    began = np.repeat(np.arange(STEPS), HOLD * FINE)
    acts = np.where(clock - HOLD * DT * began >= late, began, np.maximum(began - 1, 0))
    drive = np.sign(levels) * np.maximum(np.abs(levels) - short, 0.0)
    w, y = 0.0, np.zeros(len(u))
    for k, d in enumerate(drive[acts].tolist()):
        if k % FINE == 0:
            y[k // FINE] = w
        w += DT / FINE / 0.06 * (d - w)
    y += 1.5 * rng.standard_normal(len(u))
    return Record(
        u[:, None], y[:, None], DT, (Channel("u", "V"),), (Channel("speed", "rad/s"),)
    )  # fmt: skip


def study_of(short: float) -> DiagnosisSession:
    log = logged(short, 0.045, 1)
    base = fit_baseline([log], None, EFFECTS)
    return DiagnosisSession(base, noise_of(base), full_drive([log]), 0)


def test_a_dead_zone_is_seen_between_the_changes() -> None:
    study = study_of(12.0)
    found = study.searched(EFFECTS, lambda text, share: None)
    assert [n.id for n in found.selection.selected] == ["dead-zone"]
    (late,) = found.session.jitter
    assert late.output == "speed"
    # the search of all samples did not name it: errors behind changes hide what it explains
    (_, before), (_, after) = (
        n.errors.mean_squares() for n in (study.base.model, found.session.base.model)
    )
    assert after < RULE.held_out**2 * before


def test_where_nothing_is_hidden_nothing_is_named() -> None:
    assert study_of(0.0).searched(EFFECTS, lambda text, share: None).selection.selected == ()
