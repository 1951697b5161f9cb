"""The vehicle stage drives by speeds that are put right for what the sensors make of them."""

from dataclasses import replace

import numpy as np
import pytest
from pose_cases import DT, GAIN, TAU, driven, ground, wandering

from sysid import diagnose
from sysid.data.record import PWM_FULL_SCALE, Record
from sysid.diagnosis.pose.diagnosis import diagnose_pose
from sysid.vehicle.kinematics import Geometry

CLIP, RATIO = 9.0, 0.85


def clipped(seed: int, samples: int = 900) -> Record:
    """Two motors whose speed sensors end at CLIP, on a ground that narrows the track width."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-0.35, 0.7, (samples // 9, 2)), 9, axis=0)
    speeds, kept = np.zeros_like(u), float(np.exp(-DT / TAU))
    for k in range(1, len(u)):
        speeds[k] = kept * speeds[k - 1] + (1.0 - kept) * GAIN * u[k - 1]
    made = driven(speeds, ground("track-width", RATIO), seed)
    return replace(made, u=u * PWM_FULL_SCALE, y=np.clip(made.y, -CLIP, CLIP), sha256="")


@pytest.mark.slow
def test_a_sensor_that_clips_is_no_effect_of_the_ground() -> None:
    estimation, held = clipped(1), clipped(2)
    alone = diagnose_pose([estimation], [held], Geometry())
    assert alone is not None
    assert [e.id for e in alone.effects] != ["track-width"]  # by the readings as they are
    found = diagnose(estimation, held, geometry=Geometry())
    assert [e.id for e in found.effects] == ["sensor-saturation", "track-width"]
    (number,) = found.effects[1].parameters
    assert number.std_error is not None
    assert abs(number.value - RATIO) < 3.0 * number.std_error


@pytest.mark.slow
def test_lost_readings_are_no_turns() -> None:
    """Zeros in place of 3 % of the readings of one track: each was half a turn of two seconds."""
    parts = []
    for seed in (1, 2):
        rng = np.random.default_rng([seed, 9])
        made = driven(wandering(900, seed), ground("radius-mismatch", 1.0, 0.94), seed)
        y = made.y.copy()
        y[rng.random(len(y)) < 0.03, 0] = 0.0
        parts.append(replace(made, y=y, sha256=""))
    found = diagnose(*parts, geometry=Geometry())
    assert {e.id for e in found.effects if e.stage == "vehicle"} == {"radius-mismatch"}
    (mismatch,) = (e for e in found.effects if e.id == "radius-mismatch")
    (number,) = mismatch.parameters
    assert abs(number.value - 0.94) < 0.005  # it was 0.916 ± 0.006
