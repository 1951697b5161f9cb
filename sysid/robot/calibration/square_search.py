"""Closed squares in a trajectory: four quarter turns one way, with sides of equal length."""

from collections.abc import Sequence

import numpy as np

from sysid.data.record import Array
from sysid.robot.calibration.square_runs import SquareRun, scales
from sysid.robot.calibration.trajectory import AT_REST, Trajectory
from sysid.vehicle.kinematics import Geometry, body_velocity, chained_arcs, seen_from

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


def square_runs(
    trajectories: Sequence[Trajectory], geometry: Geometry, lag: float, offset: float
) -> tuple[SquareRun, ...]:
    """The closed squares of all trajectories.

    Args:
        geometry: that its odometry uses.
        lag, offset: how late the pose's source reads [s], and by how much its heading is off [rad].
    """
    return tuple(run for d in trajectories for run in _of_drive(d, geometry, lag, offset))


def _of_drive(d: Trajectory, geometry: Geometry, lag: float, offset: float) -> list[SquareRun]:
    corners = _corners(d)
    end = float(d.nodes[-1])
    runs, i, start = [], 0, 0.0
    while i + 3 <= len(corners):
        four = corners[i : i + 4]
        stop = four[3][1] if len(four) == 4 else end
        run = _run(d, geometry, (lag, offset), (start, *(t for c in four for t in c), stop))
        if run is None:
            start, i = corners[i][1], i + 1
        else:
            runs.append(run)
            start, i = stop, i + len(four)
    return runs


def _corners(d: Trajectory) -> list[tuple[float, float]]:
    """When the sides begin and end to turn against each other [s]."""
    size = np.abs(d.omega).sum(axis=1)
    usual = float(np.quantile(size, 0.9))
    turning = np.abs(np.diff(d.omega, axis=1)[:, 0]) > CORNER * size
    at = np.flatnonzero(turning & (size > AT_REST * usual))
    if not len(at):
        return []
    pieces = np.split(at, np.flatnonzero(np.diff(at) * d.step > PAUSE) + 1)
    longest = max(len(p) for p in pieces)
    return [
        (float(d.nodes[p[0]]), float(d.nodes[p[-1] + 1]))
        for p in pieces
        if 4 * len(p) > longest  # what is far shorter is a wheel that starts late
    ]


def _run(
    d: Trajectory, geometry: Geometry, reads: tuple[float, float], times: tuple[float, ...]
) -> SquareRun | None:
    """The run between these times: start, both ends of three or four corners, stop; or None.

    Args:
        reads: lag and offset of the pose's source.
    """
    lag, offset = reads
    ends = np.array([times[0], times[-1]])
    sides = np.array([*zip(times[:-1:2], times[1::2], strict=False)][:4])
    lengths = np.abs(np.diff(np.interp(sides, d.nodes, _path(d, d.omega, geometry)[1])))
    if len(lengths) < 4 or lengths.min() <= 0.0 or lengths.max() > SIDES_ALIKE * lengths.min():
        return None
    turns = np.diff(np.interp(sides.mean(axis=1) + lag, d.at, d.pose[:, 2]))
    if abs(turns.sum()) < 2.0 * QUARTER or np.any(np.abs(np.abs(turns) - QUARTER) > OFF):
        return None
    joins = d.joins[(d.at >= ends[0] + lag) & (d.at <= ends[1] + lag)]
    if np.any(np.sign(turns) != np.sign(turns[0])) or len(joins) < 2 or joins[0] != joins[-1]:
        return None
    side = float(lengths.mean())
    pair = _between(d.at, d.pose - np.array([0.0, 0.0, offset]), ends + lag)
    if float(np.hypot(*pair)) > CLOSED * side:
        return None

    def predicted(wheel_ratio: float, width_ratio: float) -> Array:
        wide = Geometry(geometry.r, geometry.B * width_ratio)
        path, _ = _path(d, d.omega * scales(wheel_ratio), wide)
        return _between(d.nodes, path, ends)

    return SquareRun(bool(turns[0] < 0.0), side, predicted, pair)


def _path(d: Trajectory, omega: Array, geometry: Geometry) -> tuple[Array, Array]:
    """The path of these wheel speeds at a trajectory's nodes, (N + 1, 3), and its way so far."""
    speed, yaw_rate = body_velocity(omega[:, 0], omega[:, 1], geometry)
    way = np.concatenate([[0.0], np.cumsum(speed * d.step)])
    return chained_arcs(speed * d.step, yaw_rate * d.step), way


def _between(t: Array, path: Array, ends: Array) -> Array:
    start, stop = np.column_stack([np.interp(ends, t, column) for column in path.T])
    return seen_from(start[2], stop[:2] - start[:2])
