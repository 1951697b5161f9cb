"""An input of two levels that the output switches, as a thermostat or a float switch does."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sysid.data.checks.feedback import feedback_tests
from sysid.data.checks.relay_law import relay_law
from sysid.data.facts import LogFacts
from sysid.data.inspection import inspect_records
from sysid.data.record import Channel, Record

Rule = Callable[[float, float, int], float]
"""Reading, command before it and sample -> command."""


def room(rule: Rule, seed: int, samples: int = 3000, tau: float = 150.0) -> Record:
    """A heated room, 12 degC outside and 30 K at full heat, with wind and opened windows."""
    rng = np.random.default_rng(seed)
    t, u, outside, rows = 20.0, 0.0, 0.0, []
    for k in range(samples):
        reading = t + rng.normal(0.0, 0.03)
        u = rule(reading, u, k)
        rows.append((u, reading))
        outside = 0.98 * outside + rng.normal(0.0, 0.5)
        t += (12.0 + outside + 30.0 * u - t) / tau
    data = np.array(rows)
    channels = (Channel("boiler"),), (Channel("room", "degC"),)
    return Record(data[:, :1], data[:, 1:], 20.0, *channels)


def thermostat(reading: float, u: float, k: int) -> float:
    return 1.0 if reading < 20.0 else 0.0 if reading > 21.5 else u


def at_random(seed: int, least: int, most: int) -> Rule:
    rng = np.random.default_rng([seed, least])
    ends = np.cumsum(rng.integers(least, most, 2000))
    return lambda reading, u, k: float(np.searchsorted(ends, k, "right") % 2)


def test_a_thermostat_is_a_closed_loop() -> None:
    log = room(thermostat, 1)
    law = relay_law([log], 0, 0)
    assert law is not None
    assert (law.up, law.down) == pytest.approx((20.0, 21.5), abs=0.2)
    facts = LogFacts.of([log])
    assert facts.closed_loop
    assert facts.surely_closed_loop
    (said,) = (f for f in inspect_records(facts) if f.code == "feedback")
    assert "room switches the input boiler, to its higher level at 19.9" in said.text
    assert "closed loop" in said.text


@pytest.mark.parametrize("seed", range(4))
def test_a_float_switch_is_seen_through_coarse_readings(seed: int) -> None:
    """A sump whose pump runs from 80 cm down to 30, read to 1 cm; the inflow comes and goes."""
    rng = np.random.default_rng(seed)
    level, pump, inflow, rows = 50.0, 0.0, 1.0, []
    for _ in range(4000):
        pump = 1.0 if level > 80.0 else 0.0 if level < 30.0 else pump
        rows.append((pump, np.round(level + rng.normal(0.0, 0.2))))
        inflow = np.clip(inflow + rng.normal(0.0, 0.03), 0.2, 2.0)
        level += inflow - 3.0 * pump
    data = np.array(rows)
    law = relay_law([Record(data[:, :1], data[:, 1:], 5.0)], 0, 0)
    assert law is not None
    assert (law.up, law.down) == pytest.approx((80.0, 30.0), abs=3.0)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("tau", [5.0, 60.0, 150.0, 2000.0])
@pytest.mark.parametrize("bounds", [(10, 80), (40, 60), (40, 400), (60, 61)])
def test_a_schedule_is_none(bounds: tuple[int, int], tau: float, seed: int) -> None:
    """At random, by a timer; plants that come to rest between two switchings and that do not."""
    (test,) = feedback_tests([room(at_random(seed, *bounds), seed, 1500, tau)])
    assert test.relay is None


def test_more_than_two_levels_are_no_relay(tmp_path: Path) -> None:
    log = room(thermostat, 1)
    assert relay_law([Record(log.u * log.y, log.y, 20.0)], 0, 0) is None
