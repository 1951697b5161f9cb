"""What linear motion of a higher order explains of the errors of a base."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.base_model import Base, divided, fit_baseline
from sysid.diagnosis.search.evidence import Evidence
from sysid.diagnosis.search.selection import SelectedEffect, Selection
from sysid.diagnosis.validation.linear_rival import linear_rival

DT, TAU, GAIN, NOISE = 0.02, 0.15, 24.0, 0.1


def motor(spring: float = 0.0, friction: float = 0.0, samples: int = 1500) -> Record:
    """A wheel with a spring to where it began, or with dry friction; by steps of 1 ms."""
    rng = np.random.default_rng(4)
    d = np.repeat(rng.uniform(-1.0, 1.0, samples // 30), 30)
    y, w, angle, h = np.zeros(len(d)), 0.0, 0.0, 0.001
    for k, drive in enumerate(d):
        y[k] = w
        for _ in range(round(DT / h)):
            free = w + h / TAU * (GAIN * drive - w - spring * angle)
            w = np.sign(free) * max(abs(free) - h / TAU * GAIN * friction, 0.0)
            angle += h * w
    y += NOISE * rng.standard_normal(len(d))
    pwm, speed = (Channel("pwm_l", "us"),), (Channel("omega_l", "rad/s"),)
    return Record(20000.0 * d, y, DT, pwm, speed)


def of(record: Record) -> Base:
    half = len(record) // 2
    return fit_baseline([record.rows(0, half)], [record.rows(half, len(record))], ())


@pytest.fixture(scope="module")
def sprung() -> Base:
    return of(motor(spring=2.0))


def naming(base: Base, id: str) -> Selection:
    """One effect that was accepted and left the errors as they are."""
    clear = Evidence(-60.0, 6.0, 0.9, 0.5, 1e-6)
    node = replace(base.model, effects=(id,))
    mine = SelectedEffect(id, clear, (), np.array([True]), {id: node}, base.model)
    return Selection(base.model, node, (mine,), (), ())


def errors_of(base: Base) -> Array:
    return np.sqrt(base.model.errors.mean_squares()[1])


def test_a_spring_is_linear_motion_and_no_curved_law(sprung: Base) -> None:
    rival, found = linear_rival(sprung), naming(sprung, "gravity-load")
    assert errors_of(sprung)[0] > 10.0 * NOISE
    assert rival.rmse[0] == pytest.approx(NOISE, rel=0.1)
    assert rival.orders == (2,)
    assert "100 % of the error of omega_l (order 2)" in rival.words(
        found, np.array([NOISE]), ("omega_l",)
    )


def test_blocks_of_one_log_judge_the_rival_as_well(sprung: Base) -> None:
    parts = divided([motor(spring=2.0)], None)
    rival = linear_rival(replace(sprung, parts=parts))
    assert rival.rmse[0] == pytest.approx(NOISE, rel=0.1)


def test_dry_friction_is_no_linear_motion(sprung: Base) -> None:
    rival = linear_rival(replace(sprung, parts=divided([motor(friction=0.2)], None)))
    assert rival.rmse[0] > 5.0 * NOISE
    # a model after that explains the friction
    quiet = tuple(e * NOISE / errors_of(sprung)[0] for e in sprung.model.errors.holdout)
    final = replace(sprung.model, errors=replace(sprung.model.errors, holdout=quiet))
    after = replace(naming(sprung, "coulomb-friction"), final=final)
    assert rival.words(after, np.array([NOISE]), ("omega_l",)) == ""
