"""The second effect tells what the first could not: ties stay open, and wrong ways are gone back.

Machines are simulated from physics, 20 steps of Euler a sample.
"""

import numpy as np
import pytest

from sysid import diagnose
from sysid.data.record import Array, Channel, Record

DT, PARTS, NOISE = 0.05, 20, 0.1


def steps(seed: int, samples: int = 1200, hold: int = 16) -> Array:
    return np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, samples // hold), hold)


def record(u: Array, y: Array, seed: int) -> Record:
    y = y + np.random.default_rng(seed + 100).normal(0.0, NOISE, len(y))
    return Record(u[:, None], y[:, None], DT, (Channel("duty"),), (Channel("omega", "rad/s"),))


def limited_winch(seed: int, limit: float, load: float) -> Record:
    """A motor whose bridge chops the current, lifting a constant load.

    Counted in speeds: τ ω̇ = i + (share − 1) ω − load with i = K d − share ω within ± limit.
    """
    u, gain, tau, share = steps(seed), 25.0, 0.2, 0.85
    y, w, h = np.zeros(len(u)), 0.0, DT / PARTS
    for k in range(1, len(u)):
        for _ in range(PARTS):
            i = float(np.clip(gain * u[k - 1] - share * w, -limit, limit))
            w += h / tau * (i + (share - 1.0) * w - load)
        y[k] = w
    return record(u, y, seed)


def ramped_drive(seed: int, rate: float, zone: float) -> Record:
    """A controller that ramps its duty and a bridge that gives no torque below a duty."""
    u, gain, tau = steps(seed, hold=24), 20.0, 0.25
    y, w, duty, h = np.zeros(len(u)), 0.0, 0.0, DT / PARTS
    for k in range(1, len(u)):
        for _ in range(PARTS):
            duty += float(np.clip(u[k - 1] - duty, -rate * h, rate * h))
            w += h / tau * (gain * np.sign(duty) * max(abs(duty) - zone, 0.0) - w)
        y[k] = w
    return record(u, y, seed)


def numbers(found: object, id: str) -> dict[str, float]:
    (effect,) = (e for e in found.effects if e.id == id)  # type: ignore[attr-defined]
    return {p.name: p.value for p in effect.parameters}


@pytest.mark.slow
def test_a_load_is_no_offset_of_the_sensor_once_the_limit_of_the_current_is_found() -> None:
    """The offset came first, and an asymmetry of the drive beside it."""
    found = diagnose(limited_winch(1, 5.0, 2.0), limited_winch(2, 5.0, 2.0))
    assert {e.id for e in found.effects} == {"load-bias", "current-limit"}
    assert not any(e.indistinguishable for e in found.effects)
    # Euler's steps and a sample of the limit's response: some percent
    assert numbers(found, "load-bias")["load[omega]"] == pytest.approx(2.0, rel=0.08)


@pytest.mark.slow
def test_a_ramp_through_a_dead_zone_has_both_numbers() -> None:
    """With the dead zone before the ramp a one-quadrant bridge was named beside the ramp."""
    found = diagnose(ramped_drive(1, 1.2, 0.15), ramped_drive(2, 1.2, 0.15))
    assert {e.id for e in found.effects} == {"rate-limit", "dead-zone"}
    assert numbers(found, "rate-limit")["rate[omega]"] == pytest.approx(1.2, rel=0.05)
    zone = numbers(found, "dead-zone")
    assert zone["plus[omega]"] == pytest.approx(0.15, abs=0.01)
    assert zone["minus[omega]"] == pytest.approx(0.15, abs=0.01)
