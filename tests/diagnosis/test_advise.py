"""Schedules: runnable, within the log's range, and the one that separates a tie."""

from dataclasses import replace
from fnmatch import fnmatch

import numpy as np
import pytest
from plain_tracks import SCALES, SIGMA, logged

from sysid.diagnosis.advise import experiment_between, next_experiments, sampled, stretch_of
from sysid.diagnosis.base_model import fit_baseline
from sysid.effects.catalogue import CHANGED, catalogue, effect
from sysid.effects.programmes import LEVELS

RECORD, _ = logged("steps", 3, "white", 1200)
SLOW = replace(RECORD, u=np.rint(0.3 * RECORD.u), sha256="")


def test_every_effect_has_a_programme() -> None:
    for e in (*catalogue().values(), CHANGED):
        assert e.hints.programmes, e.id


@pytest.mark.parametrize("id", [*catalogue(), "quantisation", "held-telemetry", "dropouts"])
def test_every_effect_has_a_schedule_a_robot_can_run(id: str) -> None:
    (found,) = next_experiments(SLOW, SCALES, [id])
    rows = np.array(found.schedule)
    assert found.columns == ("t", "pwm_l", "pwm_r")
    assert found.effects == (id,)
    assert id in found.purpose
    assert fnmatch(found.file, "next_*.csv")  # as the documentation calls it
    assert rows[0].tolist() == [0.0, 0.0, 0.0]
    assert rows[-1, 1:].tolist() == [0.0, 0.0]
    assert np.all(np.diff(rows[:, 0]) > 0.0)
    assert rows[-1, 0] <= 120.0
    assert np.max(np.abs(rows[:, 1:])) <= np.max(np.abs(SLOW.u))
    assert np.all(np.ptp(rows[:, 1:], axis=0) > 0.0)
    # on the log's clock
    assert rows[:, 0] / SLOW.dt == pytest.approx(np.round(rows[:, 0] / SLOW.dt))


def test_a_schedule_is_sampled_as_the_robot_would_run_it() -> None:
    rows = LEVELS.rows
    u = sampled(rows, RECORD, SCALES)
    assert len(u) == round(rows[-1][0] / RECORD.dt) + 1
    assert u[0].tolist() == [0.0, 0.0]
    k = round(rows[1][0] / RECORD.dt)
    assert np.all(u[k - 1] == 0.0)
    assert np.all(u[k] != 0.0)


def test_effects_that_cannot_be_shown_share_schedules() -> None:
    found = next_experiments(RECORD, SCALES, ["dead-zone", "coulomb-friction", "cross-coupling"])
    assert [e.effects for e in found] == [("dead-zone", "coulomb-friction"), ("cross-coupling",)]
    assert next_experiments(RECORD, SCALES, []) == ()
    assert next_experiments(RECORD, SCALES, ["no-such-effect"]) == ()


def test_where_no_command_helps_it_is_said_what_does() -> None:
    effects = tuple(effect(i) for i in ("actuator-lag", "sensor-lag"))
    base = fit_baseline([RECORD], [RECORD], effects)
    model, node = base.search.model, base.model
    rows = [node.q.copy(), node.q.copy()]
    for q, e in zip(rows, effects, strict=True):
        q[list(model.of(e.id))] = 0.2
    tied = {e.id: replace(node, q=q) for e, q in zip(effects, rows, strict=True)}
    found = experiment_between(base.search, tied, np.array([SIGMA, SIGMA]))
    assert found.schedule == ()
    assert "No command distinguishes" in found.purpose
    assert "turn the wheel by hand" in found.purpose


def test_a_tie_gets_the_schedule_on_which_the_models_differ_most() -> None:
    effects = tuple(effect(i) for i in ("supply-sag", "concave-gain", "cross-coupling"))
    ordered = [e for e in catalogue().values() if e in effects]
    base = fit_baseline([RECORD], [RECORD], ordered)
    model, node = base.search.model, base.model
    q1, q2 = node.q.copy(), node.q.copy()
    q1[list(model.of("supply-sag"))] = 0.2
    q2[list(model.of("concave-gain"))] = 0.2
    tied = {"supply-sag": replace(node, q=q1), "concave-gain": replace(node, q=q2)}
    found = experiment_between(base.search, tied, np.array([SIGMA, SIGMA]))
    assert found.effects == ("supply-sag", "concave-gain")
    assert "one side at a constant command while the other steps" in found.purpose
    assert "which is clear" in found.purpose


def test_a_slow_machine_gets_time_and_a_single_drive_is_not_reversed() -> None:
    """A fan sampled every 100 s settles in 1000 s: steps of two seconds would show nothing."""
    one = RECORD.select(["pwm_l"], ["omega_l"])
    fan = replace(one, u=np.abs(one.u), sha256="")
    rows = np.array(next_experiments(fan, SCALES[:1], ["coulomb-friction"], 4000.0)[0].schedule)
    assert np.diff(rows[:, 0]).min() >= 0.3 * 4000.0
    assert np.all(rows[:, 1] >= 0.0)
    assert not next_experiments(fan, SCALES[:1], ["unsigned-speed"])  # only a reversal shows it


def test_no_schedule_is_too_short_to_simulate() -> None:
    slow = replace(RECORD, dt=100.0, sha256="")
    ids = ("supply-sag", "concave-gain")
    base = fit_baseline([slow], [slow], [effect(i) for i in ids])
    tied = {}
    for id in ids:
        q = base.model.q.copy()
        q[list(base.search.model.of(id))] = 0.2
        tied[id] = replace(base.model, q=q)
    assert stretch_of(base.search, base.model) > 100.0
    assert len(experiment_between(base.search, tied, np.array([SIGMA, SIGMA])).schedule) > 10
