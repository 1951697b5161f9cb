"""Dry friction where the speed passes zero within a sample: as many small steps would have it."""

import numpy as np
import pytest

from sysid.data.record import Array
from sysid.structures.augmented.structure import Augmented

DT, TAU, GAIN, LEVEL = 0.05, 0.25, 20.0, 3.0
FINE = 500
"""Small steps in a sample."""


def speeds(drives: list[float], parts: int, effect: str, numbers: list[float]) -> Array:
    """Speeds of a first order at the samples, each taken in ``parts`` steps."""
    dt = DT / parts
    u = np.repeat(np.array(drives), 5 * parts)[:, None]
    s = Augmented(1, 1, (1.0,), dt, (effect,))
    core = [GAIN, -float(np.exp(-dt / TAU))]
    return s.simulate(np.array([*core, *numbers]), u)[::parts, 0]


@pytest.mark.slow
@pytest.mark.parametrize("back", [-1.0, -0.5, -0.16, -0.14, 0.0])
def test_a_reversal_within_a_sample_is_exact(back: float) -> None:
    drives = [0.0, 1.0, back, 0.6, back]
    coarse = speeds(drives, 1, "coulomb-friction", [LEVEL, 0.0, 0.0, 0.0])
    fine = speeds(drives, FINE, "coulomb-friction", [LEVEL, 0.0, 0.0, 0.0])
    # small steps err by what one of them is worth at a passage, Δt/FINE · T/τ
    np.testing.assert_allclose(coarse, fine, atol=DT / FINE * 2.0 * GAIN / TAU)
    assert np.ptp(coarse) > 5.0


def test_what_holds_at_zero_may_be_more_than_what_slides() -> None:
    drives = [0.0, 1.0, -0.2, -0.2, -0.2]  # 4 of torque: more than slides, less than breaks away
    held = speeds(drives, 1, "stiction", [LEVEL, 2.0, 0.5])
    assert held[-1] == 0.0
    assert speeds(drives, 1, "stiction", [LEVEL, 0.5, 0.5])[-1] < -0.1
