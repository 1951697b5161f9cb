"""Encoders: no tick is lost, and speeds are those of the ticks."""

import math

import numpy as np
import pytest
from mission_cases import Robot, goal

from sysid.data.record import Array
from sysid.robot.mission.simulator import simulate


def turned(omega: Array, dt: float) -> Array:
    """The angle since t = 0 where speeds vary linearly between samples."""
    return np.concatenate(([0.0], np.cumsum(0.5 * dt * (omega[1:] + omega[:-1]))))


@pytest.mark.parametrize("keys", [{}, {"rate": 7.0}, {"dropout": 0.3}, {"ticks_per_turn": 48.0}])
def test_ticks_are_the_turned_angle_and_speeds_are_those_of_the_ticks(
    keys: dict[str, float],
) -> None:
    log = simulate(goal(1, 0.5, sensors={"encoders": keys}), Robot(), seed=4).log
    tick = 2 * math.pi / keys.get("ticks_per_turn", 1200.0)
    read = ~np.isnan(log["ticks_l"])
    assert read.all() == (not {"rate", "dropout"} & keys.keys())
    for side in "lr":
        ticks, omega = log[f"ticks_{side}"][read], log[f"omega_{side}"][read]
        angle = turned(log[f"true_omega_{side}"], 0.1)[read]
        # rounded to the nearest tick from start to end: no error adds up
        assert np.abs(ticks * tick - angle).max() <= 0.5 * tick * (1 + 1e-9)
        back = np.cumsum(omega * np.diff(log["t"][read], prepend=0.0))
        np.testing.assert_allclose(back, ticks * tick, rtol=0, atol=1e-9 * ticks.max() * tick)
