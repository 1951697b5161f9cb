"""Closed squares in a trajectory: four quarter turns one way, with sides of equal length."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array
from sysid.robot.calibration.square_runs import SquareRun, scales
from sysid.robot.calibration.trajectory import AT_REST, Trajectory
from sysid.vehicle.kinematics import Geometry, body_velocity

CORNER = 0.5
"""Turning |ω_R − ω_L| / (|ω_R| + |ω_L|) from which a vehicle turns a corner: sides have 0, turns on
the spot 1, an arc about one wheel stands between."""

QUARTER, OFF = np.pi / 2.0, np.pi / 5.0
"""A corner, and by how much the pose may see it off: odometry that is wrong turns it so."""

SIDES_ALIKE = 1.5
"""Longest side over the shortest one of a square."""

CLOSED = 1.0
"""Distance of a run's end from its start, in sides, below which it is closed: wheels that differ by
2 % and a width by 5 % already miss by half a side of ten widths."""

PAUSE = 0.25
"""Corners closer than this [s] are one."""


@dataclass(frozen=True)
class _Corner:
    """When a corner begins and ends [s]."""

    start: float
    stop: float


@dataclass(frozen=True)
class PoseMeasurement:
    """How a pose's source reads: how late [s], and by how much its heading is off [rad]."""

    lag: float = 0.0
    offset: float = 0.0


def square_runs(
    trajectories: Sequence[Trajectory], geometry: Geometry, measurement: PoseMeasurement
) -> tuple[SquareRun, ...]:
    """The closed squares of all trajectories.

    Args:
        geometry: that its odometry uses.
        reading: how the pose's source reads.
    """
    return tuple(run for d in trajectories for run in _of_drive(d, geometry, measurement))


def _of_drive(d: Trajectory, geometry: Geometry, measurement: PoseMeasurement) -> list[SquareRun]:
    corners = _corners(d)
    end = float(d.nodes[-1])
    runs, i, start = [], 0, 0.0
    while i + 3 <= len(corners):
        four = corners[i : i + 4]
        stop = four[3].stop if len(four) == 4 else end
        between = (t for c in four for t in (c.start, c.stop))
        run = _run(d, geometry, measurement, (start, *between, stop))
        if run is None:
            start, i = corners[i].stop, i + 1
        else:
            runs.append(run)
            start, i = stop, i + len(four)
    return runs


def _corners(d: Trajectory) -> list[_Corner]:
    """Where the sides turn against each other."""
    size = np.abs(d.omega).sum(axis=1)
    usual = float(np.quantile(size, 0.9))
    turning = np.abs(np.diff(d.omega, axis=1)[:, 0]) > CORNER * size
    at = np.flatnonzero(turning & (size > AT_REST * usual))
    if not len(at):
        return []
    pieces = np.split(at, np.flatnonzero(np.diff(at) * d.step > PAUSE) + 1)
    longest = max(len(p) for p in pieces)
    return [
        _Corner(float(d.nodes[p[0]]), float(d.nodes[p[-1] + 1]))
        for p in pieces
        if 4 * len(p) > longest  # what is far shorter is a wheel that starts late
    ]


def _run(
    d: Trajectory, geometry: Geometry, measurement: PoseMeasurement, times: tuple[float, ...]
) -> SquareRun | None:
    """The run between these times: start, both ends of three or four corners, stop; or None."""
    lag = measurement.lag
    start, stop = times[0], times[-1]
    sides = [*zip(times[:-1:2], times[1::2], strict=False)][:4]
    way = np.concatenate([[0.0], np.cumsum(_speed(d, geometry)) * d.step])
    lengths = np.abs([_at(d.nodes, way, b) - _at(d.nodes, way, a) for a, b in sides])
    if len(lengths) < 4 or lengths.min() <= 0.0 or lengths.max() > SIDES_ALIKE * lengths.min():
        return None
    middles = [0.5 * (a + b) + lag for a, b in sides]
    turns = np.diff([_at(d.at, d.pose[:, 2], m) for m in middles])
    if abs(turns.sum()) < 2.0 * QUARTER or np.any(np.abs(np.abs(turns) - QUARTER) > OFF):
        return None
    if np.any(np.sign(turns) != np.sign(turns[0])) or _jumped(d, start + lag, stop + lag):
        return None
    began, ended = (
        _pose(d.at, d.pose, t + lag) - np.array([0.0, 0.0, measurement.offset])
        for t in (start, stop)
    )
    side = float(lengths.mean())
    pair = _from(began, ended)
    if float(np.hypot(*pair)) > CLOSED * side:
        return None

    def predicted(wheel_ratio: float, width_ratio: float) -> Array:
        left, right = scales(wheel_ratio)
        wide = Geometry(geometry.r, geometry.B * width_ratio)
        speed, yaw_rate = body_velocity(left * d.omega[:, 0], right * d.omega[:, 1], wide)
        psi = np.concatenate([[0.0], np.cumsum(yaw_rate) * d.step])
        middle, turn = psi[:-1] + 0.5 * np.diff(psi), yaw_rate * d.step
        chord = speed * d.step * np.sinc(turn / (2.0 * np.pi))
        x = np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))])
        y = np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))])
        path = np.column_stack([x, y, psi])
        return _from(_pose(d.nodes, path, start), _pose(d.nodes, path, stop))

    return SquareRun(bool(turns[0] < 0.0), side, predicted, pair, pair - predicted(1.0, 1.0))


def _speed(d: Trajectory, geometry: Geometry) -> Array:
    return np.asarray(body_velocity(d.omega[:, 0], d.omega[:, 1], geometry)[0])


def _jumped(d: Trajectory, start: float, stop: float) -> bool:
    inside = d.joins[(d.at >= start) & (d.at <= stop)]
    return len(inside) < 2 or bool(inside[0] != inside[-1])


def _at(t: Array, values: Array, at: float) -> float:
    return float(np.interp(at, t, values))


def _pose(t: Array, path: Array, at: float) -> Array:
    return np.array([_at(t, path[:, k], at) for k in range(3)])


def _from(start: Array, end: Array) -> Array:
    """The end as seen from the start, (2,) [m]."""
    c, s = np.cos(start[2]), np.sin(start[2])
    x, y = end[:2] - start[:2]
    return np.array([c * x + s * y, c * y - s * x])
