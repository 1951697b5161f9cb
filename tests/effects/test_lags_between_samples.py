"""A lag before or behind a first-order motion is exact at the samples, whatever both last."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from sysid.effects.base import Context, Effect
from sysid.effects.catalogue import about

DT = 0.05

LAGS = [(0.1347, 0.059), (0.059, 0.1347), (0.1, 0.1), (0.01, 0.2), (0.2, 0.01), (1.0, 1e-4)]
"""Time constant of the motion and of the lag [s]: longer than a sample, shorter, and equal."""


def numbers(effect: Effect, lag: float, kept: float) -> dict[str, np.ndarray]:
    assert effect.constants is not None
    mine = {"lag": np.array([lag])}
    return mine | effect.constants(np, mine, DT, np.array([kept]))


def both_in_a_row(motion: float, lag: float, held: np.ndarray) -> np.ndarray:
    bottom = np.polymul([motion, 1.0], [lag, 1.0])
    top, bottom, _ = cont2discrete((np.ones(1), bottom), DT)
    return np.asarray(lfilter(np.ravel(top), bottom, held))


@pytest.mark.parametrize(("motion", "lag"), LAGS)
@pytest.mark.parametrize("id", ["actuator-lag", "sensor-lag"])
def test_two_lags_of_a_held_command_are_exact(id: str, motion: float, lag: float) -> None:
    effect, context = about(id), Context(DT, *(np.zeros(1),) * 10)
    held = np.repeat(np.random.default_rng(0).uniform(-1.0, 1.0, 40), 3)
    kept = np.exp(-DT / motion)
    p = numbers(effect, lag, kept)
    state, speed, found = (np.zeros(1),) * effect.memory.states, np.zeros(1), []
    for u in held:
        drive = np.array([u])
        if id == "sensor-lag":
            read, state = effect.step(np, speed, state, p, context)
        else:
            read = speed
            drive, state = effect.step(np, drive, state, p, context)
        found.append(float(read[0]))
        speed = kept * speed + (1.0 - kept) * drive
    np.testing.assert_allclose(found, both_in_a_row(motion, lag, held), atol=1e-8)


def test_beside_a_motion_without_an_end_the_mean_over_the_sample_acts() -> None:
    found = numbers(about("actuator-lag"), 0.05, 1.0)
    np.testing.assert_allclose(found["late"], 1.0 - np.exp(-1.0))
