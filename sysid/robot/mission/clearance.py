"""Distances between a vehicle's centre and obstacles, over ``xp``."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.robot.mission.contracts import Disc, Point, Pose, Scene, Wall
from sysid.vehicle.kinematics import Real


def step_clearance(scene: Scene, a: Pose, b: Pose, t: Real, dt: Real, xp: Any) -> Real:
    """The smallest distance to a surface on the straight way from ``a`` to ``b`` [m].

    An obstacle that moves does so meanwhile, so that nothing is jumped over between two samples.

    Args:
        scene: its obstacles and walls; infinity without any.
        a, b: poses at ``t`` − ``dt`` and at ``t`` [s].
        t, dt: instant of ``b`` and time since ``a`` [s].
    """
    clearance = xp.inf + 0.0 * a.x  # of the shape of the poses
    for o in scene.obstacles:
        before = t - dt
        sx, sy = o.vx * dt, o.vy * dt
        # Seen from the obstacle the vehicle moves by its own way less that of the obstacle.
        rho = distance_to_segment(
            (o.x + o.vx * before, o.y + o.vy * before), (a.x, a.y), (b.x - sx, b.y - sy), xp
        )
        clearance = xp.minimum(clearance, rho - o.radius)
    for wall in scene.walls:
        for c, d in pairwise(wall.points):
            gap = distance_between_segments((a.x, a.y), (b.x, b.y), c, d, xp)
            clearance = xp.minimum(clearance, gap)
    return clearance


def point_clearance(scene: Scene, x: Real, y: Real, t: Real, xp: Any) -> Real:
    """The distance from a place to the nearest surface at ``t`` [m]; infinite without any."""
    at = Pose(x, y, 0.0)
    return step_clearance(scene, at, at, t, 0.0, xp)


def has_surfaces(scene: Scene) -> bool:
    """Whether there is anything to keep clear of."""
    return bool(scene.obstacles or scene.walls)


def box_around(
    points: Sequence[Point], obstacles: Sequence[Disc], walls: Sequence[Wall], room: float
) -> tuple[Array, Array]:
    """Lowest and highest X, Y of what is there, with room around it, (2,) each [m]."""
    places = [(*p, 0.0) for p in (*points, *(p for w in walls for p in w.points))]
    at = np.array([*places, *((o.x, o.y, o.radius) for o in obstacles)], dtype=np.float64)
    low, high = at[:, :2] - at[:, 2:], at[:, :2] + at[:, 2:]
    return low.min(axis=0) - room, high.max(axis=0) + room


def off_line(x: Real, y: Real, start: Sequence[Real], goal: Point, xp: Any) -> Real:
    """Distance from a place to the line through start and goal [m]; to the goal where both are."""
    dx, dy, ahead, aside = x - start[0], y - start[1], goal[0] - start[0], goal[1] - start[1]
    length = xp.hypot(ahead, aside)
    line = length > 0.0
    off = xp.abs(dy * ahead - dx * aside) / xp.where(line, length, 1.0)
    return xp.where(line, off, xp.hypot(dx, dy))


def distance_to_segment(p: Point, a: Point, b: Point, xp: Any) -> Real:
    """Distance from a point to the straight way from ``a`` to ``b`` [m]."""
    ax, ay, dx, dy = p[0] - a[0], p[1] - a[1], b[0] - a[0], b[1] - a[1]
    length2 = dx * dx + dy * dy
    still = length2 == 0
    # A way without length has 0/1 instead of 0/0.
    along = xp.clip((ax * dx + ay * dy) / (length2 + still), 0.0, 1.0)
    return xp.hypot(ax - along * dx, ay - along * dy)


def distance_between_segments(a: Point, b: Point, c: Point, d: Point, xp: Any) -> Real:
    """Distance between the straight ways a–b and c–d [m]; 0 where they cross."""
    ends = xp.minimum(
        xp.minimum(distance_to_segment(a, c, d, xp), distance_to_segment(b, c, d, xp)),
        xp.minimum(distance_to_segment(c, a, b, xp), distance_to_segment(d, a, b, xp)),
    )
    crossing = (_side(a, b, c) * _side(a, b, d) < 0) & (_side(c, d, a) * _side(c, d, b) < 0)
    return xp.where(crossing, 0.0, ends)


def nearest_point(wall: Wall, x: Real, y: Real, xp: Any) -> Point:
    """The point of a wall that is nearest to (x, y) [m], q_obs of the thesis's (4.22)."""
    nearest: tuple[Real, Real, Real] | None = None
    for (cx, cy), (dx, dy) in pairwise(wall.points):
        ex, ey = dx - cx, dy - cy
        length2 = ex * ex + ey * ey
        along = ((x - cx) * ex + (y - cy) * ey) / (length2 + (length2 == 0))
        along = xp.clip(along, 0.0, 1.0)
        px, py = cx + along * ex, cy + along * ey
        gap = xp.hypot(x - px, y - py)
        if nearest is None:
            nearest = gap, px, py
        else:
            nearer = gap < nearest[0]
            nearest = tuple(
                xp.where(nearer, new, old) for new, old in zip((gap, px, py), nearest, strict=True)
            )
    assert nearest is not None  # a wall has two points at least
    return nearest[1], nearest[2]


def _side(a: Point, b: Point, p: Point) -> Real:
    """Above 0 where p lies left of the straight line from a to b, below 0 where right of it."""
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
