"""Jitter of the commands: told with its size, and nothing that depends on the command."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.data.record import Array
from sysid.diagnosis.validation.jitter import _behind, _spread

NOISE, HOLD, COUNT = 0.02, 14, 120
DELAY = 4
"""Of the model [samples]."""


def steps(kind: str, tau: float = 4.0, spread: float = 0.8) -> tuple[Array, Array, Array]:
    """Drive, errors and run of a motor (τ in samples) whose steps act early and late."""
    rng = np.random.default_rng(5)
    levels = rng.uniform(-1.0, 1.0, COUNT)
    change = np.diff(levels, prepend=0.0)
    late = {
        "drawn": rng.normal(0.0, spread, COUNT).clip(-DELAY, DELAY),
        "by-size": 1.2 * np.abs(change),
        "none": np.zeros(COUNT),
    }[kind]
    t = np.arange(HOLD * COUNT)
    at = HOLD * np.arange(COUNT) + DELAY

    def run(start: Array) -> Array:
        since = (t[:, None] - start).clip(0.0)
        return np.asarray((1.0 - np.exp(-since / tau)) @ change)

    errors = run(at + late) - run(at) + NOISE * rng.standard_normal(len(t))
    return np.repeat(levels, HOLD), errors, run(at)


def told(drive: Array, errors: Array, run: Array) -> tuple[float, float] | None:
    """Spread [samples] and share that are said."""
    found = _behind(drive, errors, run)
    return None if found is None else _spread([found], NOISE)


@pytest.mark.parametrize(("tau", "spread"), [(4.0, 0.8), (2.0, 1.5), (0.3, 1.5)])
def test_the_spread_of_delays_is_told(tau: float, spread: float) -> None:
    # the second is over within a sample and late by several: no slope tells of that
    found = told(*steps("drawn", tau, spread))
    assert found is not None
    assert found[0] == pytest.approx(spread, rel=0.2)  # of 120 draws within three errors
    assert found[1] > 0.8  # the line between two samples is no response


@pytest.mark.parametrize("tau", [0.3, 4.0])
@pytest.mark.parametrize("kind", ["by-size", "none"])
def test_delays_that_the_command_foretells_are_no_jitter(kind: str, tau: float) -> None:
    assert told(*steps(kind, tau)) is None


def test_a_command_that_always_moves_shows_no_instant() -> None:
    drive, errors, run = steps("drawn")
    moving = drive + 0.01 * np.sin(np.arange(len(drive)))
    assert _behind(moving, errors, run) is None


@pytest.mark.parametrize("tau", [4.0, 10.0])
def test_a_disturbance_that_was_there_before_a_change_is_no_jitter(tau: float) -> None:
    """One shift a change follows half of any slow errors behind it."""
    drive, _, run = steps("none", tau)
    shocks = 0.05 * np.random.default_rng(3).standard_normal(len(run))
    slow = lfilter([np.sqrt(1.0 - 0.98**2)], [1.0, -0.98], shocks)
    assert told(drive, slow, run) is None
