"""Robots that skid more than their width says: made ones, and measured ones where data is."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pose_cases import driven, ground

from sysid.data.preparation import Preparation
from sysid.data.reading.read_options import ReadOptions
from sysid.data.record import Array, Record
from sysid.diagnosis.pose.diagnosis import diagnose_pose
from sysid.robot.calibration.logs import read_vehicle_logs
from sysid.vehicle.kinematics import Geometry

DRIVES = Path(os.environ.get("SYSID_DATA", Path(__file__).parents[4] / "shared" / "data")) / "drive"

EVERY = 5
"""Every so many rows of a measured drive are read, so that a test takes two seconds; the study of
the vehicle reads all."""


@pytest.mark.slow
def test_a_robot_that_turns_half_as_far_as_its_wheels_say_is_read_right() -> None:
    # 2 rad/s by the wheels, and so 1 rad/s: after two seconds they are 2 rad apart; at 4 rad/s 4
    spins = np.repeat([2.0, -4.0, 3.0, 4.0, -3.0, 0.0, 4.0, -2.0], 30)
    speeds = spins[:, None] * Geometry().B / (2.0 * Geometry().r) * np.array([-1.0, 1.0])
    logs = [driven(speeds + 3.0, ground("track-width", 0.5), seed) for seed in (1, 2)]
    wrapped = [replace(r, pose=_wrapped(r)) for r in logs]
    found = diagnose_pose(wrapped[:1], wrapped[1:], Geometry())
    assert found is not None
    (named,) = found.effects
    assert named.id == "track-width"
    assert named.parameters[0].value == pytest.approx(0.5, abs=0.01)
    # windows from one spin to the next see less of it than 2 s times half the spin
    assert found.gap.channels["psi"].rmse_before > 0.8 * np.sqrt(np.mean(spins**2))


def _wrapped(record: Record) -> Array:
    assert record.pose is not None
    pose = record.pose.copy()
    pose[:, 2] = np.arctan2(np.sin(pose[:, 2]), np.cos(pose[:, 2]))
    return pose


def test_logs_that_turn_where_they_begin_only_judge_each_other() -> None:
    spin = Geometry().B / (2.0 * Geometry().r) * np.array([-1.0, 1.0])
    ahead = np.full((60, 2), 8.0)
    speeds = [np.concatenate([np.tile(w * spin, (15, 1)), ahead]) for w in (1.5, -1.0, -2.0, 1.2)]
    logs = [driven(w, ground("track-width", 0.8), k) for k, w in enumerate(speeds)]
    found = diagnose_pose(logs, (), Geometry())
    assert found is not None
    assert [e.id for e in found.effects] == ["track-width"]
    assert found.effects[0].parameters[0].value == pytest.approx(0.8, abs=0.02)


@pytest.mark.slow
@pytest.mark.skipif(not DRIVES.is_dir(), reason=f"the measured drives are not at {DRIVES}")
@pytest.mark.parametrize(
    ("file", "geometry"),
    [
        ("husky_2023_longest.csv", Geometry(0.165, 0.55)),
        ("warthog_gravel_2024_8_6_longest.csv", Geometry(0.30, 1.08)),
    ],
)
def test_measured_robots_are_named_by_their_effective_width(file: str, geometry: Geometry) -> None:
    whole = read_vehicle_logs([DRIVES / file], ReadOptions(), Preparation())[0][0]
    assert whole.pose is not None
    rows = slice(None, None, EVERY)
    pose = whole.pose[rows]
    log = replace(whole, u=whole.u[rows], y=whole.y[rows], pose=pose, dt=EVERY * whole.dt)
    cut = int(0.7 * len(log))
    parts = [
        replace(log, u=log.u[at], y=log.y[at], pose=pose[at])
        for at in (slice(None, cut), slice(cut, None))
    ]
    found = diagnose_pose(parts[:1], parts[1:], geometry)
    assert found is not None
    ratios = {e.id: e.parameters[0].value for e in found.effects}
    # 1.6 to 2 times as wide as measured with a ruler
    assert 1.6 < 1.0 / ratios["track-width"] < 2.0
    gaps = found.gap.channels
    assert gaps["psi"].rmse_after < 0.4 * gaps["psi"].rmse_before
    before, after = (
        np.hypot(*(getattr(gaps[c], when) for c in "xy")) for when in ("rmse_before", "rmse_after")
    )
    # a least-squares width and scale of the speeds take 35 % away
    assert after < 0.65 * before
