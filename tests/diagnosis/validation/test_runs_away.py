"""A balancing robot: the pitch runs away without the controller, the wheel does not."""

import numpy as np
import pytest

from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.validation.runs_away import runs_away

DT, PARTS, DEAD = 0.01, 10, 12.0


def balancing(seed: int, rows: int = 3000) -> Record:
    """θ̈ = 42 sin θ − .11 α, .08 α̇… of a wheel (dead zone of 12 counts) under state feedback."""
    rng = np.random.default_rng(seed)
    wanted = np.repeat(rng.choice([-3.0, 0.0, 3.0, 4.0], rows // 200 + 1), 200)[:rows]
    pitch, turning, wheel = 0.02, 0.0, 0.0
    u, y = np.zeros(rows), np.zeros((rows, 2))
    for k in range(rows):
        y[k] = wheel + rng.normal(0.0, 0.05), pitch + rng.normal(0.0, 0.002)
        rate = turning + rng.normal(0.0, 0.01)
        u[k] = np.clip(1150.0 * y[k, 1] + 180.0 * rate + 14.0 * (y[k, 0] - wanted[k]), -255, 255)
        for _ in range(PARTS):
            beyond = np.sign(u[k]) * max(abs(u[k]) - DEAD, 0.0)
            push = (0.11 * beyond - wheel) / 0.08
            turning += DT / PARTS * (42.0 * np.sin(pitch) - 0.11 * push - 0.5 * turning)
            pitch, wheel = pitch + DT / PARTS * turning, wheel + DT / PARTS * push
    names = Channel("wheel", "rad/s"), Channel("pitch", "rad")
    return Record(u[:, None], y, DT, (Channel("pwm", ""),), names)


def servoed(seed: int, rows: int = 3000) -> Record:
    """A position that integrates its command, held at set points: its pole is 1, not beyond."""
    rng = np.random.default_rng(seed)
    wanted = np.repeat(rng.uniform(-1.0, 1.0, rows // 100), 100)
    u, y, speed, x = np.zeros(rows), np.zeros(rows), 0.0, 0.0
    for k in range(rows):
        y[k] = x + rng.normal(0.0, 0.002)
        u[k] = 3.0 * (wanted[k] - y[k])
        speed += 0.1 * (u[k] - speed)
        x += DT * speed
    return Record(u[:, None], y[:, None], DT, (Channel("u", "V"),), (Channel("x", "m"),))


@pytest.mark.parametrize("seed", range(3))
def test_only_a_pole_beyond_one_runs_away(seed: int) -> None:
    records = [balancing(seed)]
    assert [runs_away(records, i) for i in (0, 1)] == [False, True]
    assert not runs_away([servoed(seed)], 0)


def test_a_short_log_says_nothing_of_it() -> None:
    log: Array = balancing(0).y[:200]
    short = Record(np.zeros((200, 1)), log, DT, (Channel("pwm", ""),), balancing(0).outputs)
    assert not runs_away([short], 1)


@pytest.mark.slow
def test_nothing_is_named_on_what_runs_away() -> None:
    log = balancing(1)
    found = diagnose([log])
    (effect,) = found.effects
    assert (effect.id, effect.channels) == ("dead-zone", ("wheel",))
    assert any("pitch cannot stay bounded without" in w for w in found.warnings)
    alone = diagnose([log.select(("pwm",), ("pitch",))])
    assert not alone.effects
    assert not alone.shapes
