"""Jitter of the commands: told with its size, and nothing that depends on the command."""

import numpy as np
import pytest

from sysid.data.record import Array
from sysid.discrepancy.proof.uneven_delay import _behind, _spread

NOISE, HOLD, COUNT, SPREAD = 0.02, 10, 120, 0.03


def steps(kind: str) -> tuple[Array, Array, Array]:
    """Drive, errors and slopes of a first-order motor whose steps act early and late."""
    rng = np.random.default_rng(5)
    levels = rng.uniform(-1.0, 1.0, COUNT)
    change = np.diff(levels, prepend=0.0)
    late = {
        "drawn": rng.normal(0.0, SPREAD, COUNT),
        "by-size": 0.04 * np.abs(change),
        "none": np.zeros(COUNT),
    }[kind]
    decay = np.exp(-np.arange(HOLD) / 4.0)
    slopes = np.concatenate([-100.0 * c * decay for c in change])
    errors = slopes * np.repeat(late, HOLD) + NOISE * rng.standard_normal(COUNT * HOLD)
    return np.repeat(levels, HOLD), errors, slopes


def test_the_spread_of_delays_is_told() -> None:
    found = _spread(_behind(*steps("drawn")), NOISE)
    assert found is not None
    assert found[0] == pytest.approx(SPREAD, rel=0.2)  # of 120 draws within three errors
    assert found[1] > 0.9


@pytest.mark.parametrize("kind", ["by-size", "none"])
def test_delays_that_the_command_foretells_are_no_jitter(kind: str) -> None:
    assert _spread(_behind(*steps(kind)), NOISE) is None


def test_a_command_that_always_moves_shows_no_instant() -> None:
    drive, errors, slopes = steps("drawn")
    moving = drive + 0.01 * np.sin(np.arange(len(drive)))
    assert len(_behind(moving, errors, slopes)) == 0
