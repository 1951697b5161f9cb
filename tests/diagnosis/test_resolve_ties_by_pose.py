"""The pose tells a lag of the sensor from one of the actuator: speeds alone cannot."""

from dataclasses import replace

import numpy as np
import pytest
from pose_cases import DT, GAIN, TAU, driven

from sysid import diagnose
from sysid.data.record import PWM_FULL_SCALE, Record
from sysid.vehicle.kinematics import Geometry

LAG = 0.6


def late(where: str, seed: int, samples: int = 900) -> Record:
    """The left track late, by its drive or by its reading."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-0.35, 0.7, (samples // 9, 2)), 9, axis=0)
    fine = 20
    speeds, read = np.zeros_like(u), np.zeros_like(u)
    drive, speed, shown, h = np.zeros(2), np.zeros(2), np.zeros(2), DT / fine
    for k in range(1, samples):
        for _ in range(fine):
            drive = drive + (u[k - 1] - drive) * (h / LAG)
            mine = np.where([where == "actuator", False], drive, u[k - 1])
            speed = speed + (GAIN * mine - speed) * (h / TAU)
            shown = shown + (speed - shown) * (h / LAG)
        speeds[k] = speed
        read[k] = np.where([where == "sensor", False], shown, speed)
    made = driven(speeds, None, seed)
    noise = made.y - speeds
    return replace(made, u=u * PWM_FULL_SCALE, y=read + noise, sha256="")


@pytest.mark.slow
@pytest.mark.parametrize("where", ["sensor", "actuator"])
def test_the_pose_says_whose_lag_it_is(where: str) -> None:
    found = diagnose(late(where, 1), late(where, 2), geometry=Geometry())
    named = {e.id: e for e in found.effects}
    assert set(named) == {f"{where}-lag"}
    assert not named[f"{where}-lag"].indistinguishable
