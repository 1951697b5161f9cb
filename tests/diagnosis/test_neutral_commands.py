"""Commands that are counted from a neutral value: pulses of 1 to 2 ms."""

import numpy as np
import pytest

from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.neutral import neutral_commands

GAIN, TAU, DT, DEAD = 0.4, 0.15, 0.02, 40.0


def pulses(
    seed: int, neutral: float, low: float, samples: int = 1500, share: float = 0.2
) -> Record:
    """A motor behind pulses [µs] with a dead zone of 40 µs around the neutral one."""
    rng = np.random.default_rng(seed)
    levels = np.where(
        rng.random(samples // 25) < share, neutral, rng.uniform(low, 2000.0, samples // 25)
    )
    u, w, seen = np.repeat(levels, 25), 0.0, np.zeros(samples)
    for k, pulse in enumerate(u):
        seen[k] = w
        beyond = pulse - neutral
        drive = np.sign(beyond) * max(abs(beyond) - DEAD, 0.0)
        w += DT / TAU * (GAIN * drive - w)
    y = seen + 0.2 * rng.standard_normal(samples)
    channels = (Channel("esc", "µs"),), (Channel("speed", "rad/s"),)
    return Record(u[:, None], y[:, None], DT, *channels, name=f"{seed}.csv", sha256=f"esc{seed}")


@pytest.mark.parametrize(("neutral", "low"), [(1000.0, 1000.0), (1500.0, 1000.0)])
def test_the_neutral_pulse_is_where_the_output_rests(neutral: float, low: float) -> None:
    found, known = neutral_commands([pulses(1, neutral, low)])
    assert found == pytest.approx([neutral])
    assert known


@pytest.mark.parametrize(("neutral", "within"), [(1500.0, 0.0), (1300.0, 0.5 * DEAD)])
def test_a_neutral_pulse_that_is_never_given_is_the_middle_of_those_that_move_nothing(
    neutral: float, within: float
) -> None:
    # some 16 of 200 levels lie within the dead zone; 1500 is neutral by convention where it does
    (found,), known = neutral_commands([pulses(2, neutral, neutral - 500.0, 5000, 0.0)])
    assert found == pytest.approx(neutral, abs=within)
    assert not known


def test_a_command_that_comes_near_zero_is_counted_from_zero() -> None:
    log = pulses(1, 1500.0, 1000.0)
    near = Record(log.u - 1000.0, log.y, DT, log.inputs, log.outputs)
    moving = Record(log.u, log.y + 500.0, DT, log.inputs, log.outputs)
    for log in (near, moving):
        found, known = neutral_commands([log])
        assert found.tolist() == [0.0]
        assert known


def test_a_neutral_pulse_that_is_only_guessed_makes_no_load() -> None:
    """Two linear sides that never rest: the pulses at which they cross zero are some way off."""
    rng = np.random.default_rng(10)
    u = np.repeat(rng.integers(1100, 1900, (50, 2)), 50, axis=0).astype(float)
    y, w = np.zeros_like(u), np.zeros(2)
    for k, pulse in enumerate(u):
        y[k] = w
        w = 0.82 * w + 0.18 * 0.024 * (pulse - 1500.0)
    y += 0.08 * rng.standard_normal(y.shape)
    sides = ("left", "right")
    inputs, outputs = (tuple(Channel(s, unit) for s in sides) for unit in ("µs", "rad/s"))
    found = diagnose([Record(u, y, 0.04, inputs, outputs, name="rover.csv")])
    assert [e.id for e in found.effects] == []
    assert "an offset" in found.base_words


@pytest.mark.slow
def test_a_dead_zone_around_a_neutral_pulse_is_named_and_the_model_runs_on_the_log() -> None:
    log, other = pulses(2, 1500.0, 1000.0), pulses(3, 1500.0, 1000.0)
    found = diagnose([log], [other])
    (named,) = found.effects
    assert "dead-zone" in {named.id, *named.indistinguishable}
    assert "from 1500 µs" in found.base_words
    (trace,) = (t for t in found.traces if t.role == "held-out")
    assert np.array_equal(trace.record.u, other.u)
    run: Array = found.after.simulate(other.u)
    # the run of the diagnosis starts where the log starts; both have forgotten it after 10 τ
    later = round(10 * TAU / DT)
    assert np.max(np.abs(run[later:] - trace.after[later:])) < 0.2
