"""Measured slip against turning, speed and acceleration.

    slip = 1 − way driven / way rolled,     loss of a turn = 1 − turn driven / turn rolled

of each window, in groups of equally many windows; no model stands behind these figures but the
radius and the width that say what was rolled.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.robot.calibration.slip_estimate import SlipFit
from sysid.robot.calibration.slip_model import AT, increments
from sysid.robot.calibration.trajectory import Part
from sysid.robot.calibration.windows import OVERLAP
from sysid.vehicle.kinematics import Geometry, body_velocity

GROUPS = 6
"""Points of a curve: each still holds many windows of a short log."""

ENOUGH = 0.3
"""Way or turn of a window, as a share of the log's usual one (90 % quantile), from which a ratio
means anything."""


@dataclass(frozen=True)
class SlipPoint:
    """One point of a curve.

    Attributes:
        at: mean of what it is drawn against.
        slip, std_error: mean share that is lost, and its standard error.
        windows: how many windows it is the mean of.
    """

    at: float
    slip: float
    std_error: float
    windows: int


SlipCurves = dict[str, tuple[SlipPoint, ...]]


def slip_curves(parts: Sequence[Part], fit: SlipFit, geometry: Geometry) -> SlipCurves:
    """Way lost against turning, speed [m/s] and acceleration [m/s²]; turn lost against turning.

    Args:
        fit: whose lags bring wheels and pose together.
        geometry: radius and width that say what the wheels rolled.
    """
    rows = np.concatenate([_windows(p, fit, geometry) for p in parts])
    way, rolled, turn, spun, turning, speed, acceleration = rows.T
    straight = _large(rolled)
    bent = _large(spun)
    lost = 1.0 - way[straight] / rolled[straight]
    return {
        "turning": _curve(turning[straight], lost),
        "speed": _curve(speed[straight], lost),
        "acceleration": _curve(acceleration[straight], lost),
        "turn": _curve(turning[bent], 1.0 - turn[bent] / spun[bent]),
    }


def _large(values: Array) -> Array:
    size = np.abs(values)
    return np.asarray(size > ENOUGH * float(np.quantile(size, 0.9)) + 1e-12)


def _windows(part: Part, fit: SlipFit, geometry: Geometry) -> Array:
    """Way and turn driven and rolled, turning, speed and acceleration of each window, (W, 7)."""
    d, q = part.trajectory, fit.q
    moved = increments(d.pose, part.windows, float(q[AT["heading_offset"]]))
    forward, yaw_rate = body_velocity(d.omega[:, 0], d.omega[:, 1], geometry)
    place, heading = d.at - q[AT["pose_lag"]], d.at - q[AT["heading_lag"]]

    def between(steps: Array, at: Array) -> Array:
        total = np.concatenate([[0.0], np.cumsum(steps)]) * d.step
        ends = np.interp(at[part.windows], d.nodes, total)
        return np.asarray(ends[:, 1] - ends[:, 0])

    rolled, spun = between(forward, place), between(yaw_rate, heading)
    left, right = (between(np.abs(d.omega[:, k]), place) for k in (0, 1))
    difference = between(np.abs(d.omega[:, 1] - d.omega[:, 0]), place)
    turning = difference / np.maximum(left + right, 1e-12)
    # the way along the arc, of which the chord is measured
    bend = np.sinc(np.clip(np.abs(moved[:, 2]) / (2.0 * np.pi), 0.0, 0.9))
    chord = np.hypot(moved[:, 0], moved[:, 1]) * np.sign(moved[:, 0])
    length = np.diff(d.at[part.windows], axis=1)[:, 0]
    ends = np.interp(place[part.windows], d.nodes[:-1], forward)
    acceleration = np.abs(ends[:, 1] - ends[:, 0]) / length
    return np.column_stack(
        [chord / bend, rolled, moved[:, 2], spun, turning, np.abs(rolled) / length, acceleration]
    )


def _curve(at: Array, values: Array) -> tuple[SlipPoint, ...]:
    """Means in groups of equally many windows; medians would hide wheels that spin now and then."""
    if len(at) < 2 * OVERLAP:
        return ()
    order = np.argsort(at, kind="stable")
    groups = np.array_split(order, min(GROUPS, len(at) // OVERLAP))
    points = []
    for g in groups:
        kept = np.clip(values[g], *np.quantile(values[g], (0.05, 0.95)))
        error = float(np.std(kept) / np.sqrt(max(len(g) / OVERLAP, 1.0)))
        points.append(SlipPoint(float(at[g].mean()), float(kept.mean()), error, len(g)))
    return tuple(points)
