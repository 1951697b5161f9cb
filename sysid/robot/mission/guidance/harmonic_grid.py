"""Laplace's equation on a grid around obstacles and walls, one potential for every target."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.robot.mission.clearance import box_around, distance_to_segment
from sysid.robot.mission.contracts import Disc, Point, Wall
from sysid.vehicle.kinematics import Real

ROOM = 1.0
"""Room around everything on the grid [m]: enough to pass outside of the outermost obstacle."""

MOST_CELLS = 400_000
"""A grid of more cells would not be solved while somebody waits: it takes ten seconds."""

HALF = 0.71
"""Half a cell's diagonal, in cells: a wall nearer than that to no corner could be stepped over."""

KEPT = 16
"""Grids kept: a run asks for the same one at every step, and few runs alternate."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class HarmonicGrid:
    """Directions and ways up the potentials of several targets, at the corners of cells.

    Attributes:
        x0, y0: the first corner [m].
        cell: side of a cell [m].
        targets: X, Y of each [m].
        gx, gy: unit vector up the potential, (targets, ny, nx).
        ways: way up the potential to the target [m], (targets, ny, nx).
        open: whether a way leads from there, (targets, ny, nx).
        heights: −log w, (targets, ny, nx); infinite where no way leads from.
    """

    x0: float
    y0: float
    cell: float
    targets: tuple[Point, ...]
    gx: Array
    gy: Array
    ways: Array
    open: Mask
    heights: Array

    def direction(self, leg: Real, x: Real, y: Real, xp: Any) -> tuple[Real, Real, Real, Real]:
        """Up the potential of a leg, in X and Y, and the target; off the grid straight to it."""
        goal_x = xp.asarray([t[0] for t in self.targets])[leg]
        goal_y = xp.asarray([t[1] for t in self.targets])[leg]
        gx = self._between(self.gx, leg, x, y, xp)
        gy = self._between(self.gy, leg, x, y, xp)
        straight = (gx == 0) & (gy == 0) | self._outside(x, y)
        return (
            xp.where(straight, goal_x - x, gx),
            xp.where(straight, goal_y - y, gy),
            goal_x,
            goal_y,
        )

    def is_open(self, leg: Real, x: Real, y: Real, xp: Any) -> Any:
        """Whether a way leads to the target of a leg; off the grid as beside its rim."""
        here = self._at(self.open, leg, x, y, xp)
        return xp.where(self._outside(x, y), xp.asarray(self.open)[leg, 1, 1], here)

    def way(self, leg: Real, x: Real, y: Real, xp: Any) -> Real:
        """Way to the target of a leg and along the legs after it [m]."""
        later = [0.0]
        for a, k in zip(self.targets[-2::-1], range(len(self.targets) - 1, 0, -1), strict=True):
            later.insert(0, later[0] + float(self._at(self.ways, k, a[0], a[1], np)))
        right, top = self._end
        beside = xp.hypot(x - xp.clip(x, self.x0, right), y - xp.clip(y, self.y0, top))
        return self._between(self.ways, leg, x, y, xp) + beside + xp.asarray(later)[leg]

    def height(self, leg: Real, x: Real, y: Real, xp: Any) -> Real:
        """−log w at the nearest corner."""
        return self._at(self.heights, leg, x, y, xp)

    @property
    def _end(self) -> tuple[float, float]:
        """The last corner [m]."""
        _, ny, nx = self.ways.shape
        return self.x0 + (nx - 1) * self.cell, self.y0 + (ny - 1) * self.cell

    def _outside(self, x: Real, y: Real) -> Any:
        right, top = self._end
        return (x < self.x0) | (x > right) | (y < self.y0) | (y > top)

    def _at(self, values: Any, leg: Real, x: Real, y: Real, xp: Any) -> Any:
        i, j = self._corner(x + 0.5 * self.cell, y + 0.5 * self.cell, 1, xp)
        return xp.asarray(values)[leg, j, i]

    def _between(self, values: Array, leg: Real, x: Real, y: Real, xp: Any) -> Real:
        i, j = self._corner(x, y, 2, xp)
        u = xp.clip((x - self.x0) / self.cell - i, 0.0, 1.0)
        v = xp.clip((y - self.y0) / self.cell - j, 0.0, 1.0)
        of = xp.asarray(values)
        below = (1.0 - u) * of[leg, j, i] + u * of[leg, j, i + 1]
        above = (1.0 - u) * of[leg, j + 1, i] + u * of[leg, j + 1, i + 1]
        return (1.0 - v) * below + v * above

    def _corner(self, x: Real, y: Real, short: int, xp: Any) -> tuple[Any, Any]:
        """Index of the corner to the lower left, ``short`` before the end at most."""
        _, ny, nx = self.ways.shape
        i = xp.asarray(xp.floor((x - self.x0) / self.cell)).astype(int)
        j = xp.asarray(xp.floor((y - self.y0) / self.cell)).astype(int)
        return i.clip(0, nx - short), j.clip(0, ny - short)


@lru_cache(maxsize=KEPT)
def solved(
    targets: tuple[Point, ...],
    obstacles: tuple[Disc, ...],
    walls: tuple[Wall, ...],
    margin: float,
    cell: float,
    tolerance: float,
) -> HarmonicGrid:
    """Solve ∇²w = 0 around all surfaces for each target.

    Args:
        targets: where w = 1, within ``tolerance`` [m] as far as no surface is there.
        obstacles, walls: where w = 0, and within ``margin`` [m] of them, and on the rim.
        margin, cell, tolerance: [m].
    """
    x, y = _axes(targets, obstacles, walls, cell)
    at_x, at_y = np.meshgrid(x, y)
    gap = np.full(at_x.shape, math.inf)
    for o in obstacles:
        gap = np.minimum(gap, np.hypot(at_x - o.x, at_y - o.y) - o.radius)
    for wall in walls:
        for a, b in pairwise(wall.points):
            gap = np.minimum(gap, distance_to_segment((at_x, at_y), a, b, np))
    grids = []
    for tx, ty in targets:
        reached = np.hypot(at_x - tx, at_y - ty)
        goal = (reached <= max(tolerance, HALF * cell)) & (gap > HALF * cell)
        # Beside a target that lies inside the margin the robot may come as near as the target is.
        goal_margin = min(margin, float(gap[goal].max(initial=0.0)) / 2.0)
        beside = np.where(reached <= margin + 2.0 * cell, goal_margin, margin)
        blocked = gap <= np.maximum(beside, HALF * cell)
        blocked[[0, -1]] = blocked[:, [0, -1]] = True
        grids.append(_potential(blocked & ~goal, goal, cell))
    gx, gy, ways, passable, heights = (np.array(parts) for parts in zip(*grids, strict=True))
    return HarmonicGrid(x[0], y[0], cell, targets, gx, gy, ways, passable, heights)


def _axes(
    targets: Sequence[Point], obstacles: Sequence[Disc], walls: Sequence[Wall], cell: float
) -> tuple[Array, Array]:
    low, high = box_around(targets, obstacles, walls, ROOM)
    counts = np.ceil((high - low) / cell).astype(int) + 1
    if math.prod(counts.tolist()) * len(targets) > MOST_CELLS:
        raise ModelError(
            f"a grid of {counts[0]} × {counts[1]} cells for {len(targets)} targets is too large: "
            f"raise guidance.cell (now {cell:g} m)"
        )
    return low[0] + cell * np.arange(counts[0]), low[1] + cell * np.arange(counts[1])


def _potential(blocked: Mask, goal: Mask, cell: float) -> tuple[Array, Array, Array, Mask, Array]:
    """Directions, ways, what is open, and −log w of one target."""
    from scipy.ndimage import distance_transform_edt

    w = _laplace(blocked, goal)
    reach = w > 0.0
    gx, gy, ways = _ascent(w, reach, goal, cell)
    heights = np.full(w.shape, math.inf)
    np.log(w, out=heights, where=reach)
    heights[reach] *= -1.0
    if not reach.any():
        return gx, gy, ways, reach, heights
    # From what is blocked, such as a start inside the margin, the way leads to what is not.
    free = ~blocked
    apart, (j, i) = distance_transform_edt(blocked, return_indices=True)
    rows, columns = np.indices(w.shape)
    size = np.maximum(apart, 1.0)
    gx = np.where(free, gx, (i - columns) / size)
    gy = np.where(free, gy, (j - rows) / size)
    return gx, gy, np.where(free, ways, ways[j, i] + cell * apart), reach[j, i], heights


def _laplace(blocked: Mask, goal: Mask) -> Array:
    """w: 0 where it is blocked, 1 at the goal, elsewhere the mean of its four neighbours."""
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    unknown = ~blocked & ~goal
    number = np.full(blocked.shape, -1)
    number[unknown] = np.arange(int(unknown.sum()))
    w = goal.astype(float)
    if not goal.any() or not unknown.any():
        return w
    rows, columns, right = [], [], np.zeros(int(unknown.sum()))
    for here, there in _neighbours(blocked.shape):
        row_here, row_there = number[here], number[there]
        both = (row_here >= 0) & (row_there >= 0)
        rows.append(row_here[both])
        columns.append(row_there[both])
        np.add.at(right, row_here[(row_here >= 0) & goal[there]], 1.0)
    row, column = np.concatenate(rows), np.concatenate(columns)
    n = len(right)
    values = np.concatenate([np.full(len(row), -1.0), np.full(n, 4.0)])
    everyone = np.arange(n)
    matrix = csc_matrix(
        (values, (np.concatenate([row, everyone]), np.concatenate([column, everyone]))), (n, n)
    )
    # Without row exchanges no sum has terms of both signs: w keeps its digits down a long passage,
    # where it falls below any absolute precision.
    lu = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
              options={"SymmetricMode": True})  # fmt: skip
    w[unknown] = np.maximum(lu.solve(right), 0.0)
    return w


def _neighbours(shape: tuple[int, ...]) -> list[tuple[Any, Any]]:
    """Slices of all corners with a neighbour to the right, left, above, below, and of these."""
    first, last, every = slice(None, -1), slice(1, None), slice(None)
    return [
        ((every, first), (every, last)),
        ((every, last), (every, first)),
        ((first, every), (last, every)),
        ((last, every), (first, every)),
    ]


def _ascent(w: Array, reach: Mask, goal: Mask, cell: float) -> tuple[Array, Array, Array]:
    """Unit vectors up w, and the way from corner to corner to the goal [m]."""
    padded = np.pad(w, 1)
    dx = padded[1:-1, 2:] - padded[1:-1, :-2]
    dy = padded[2:, 1:-1] - padded[:-2, 1:-1]
    size = np.maximum(np.maximum(abs(dx), abs(dy)), 1e-300)
    dx, dy = dx / size, dy / size
    length = np.maximum(np.hypot(dx, dy), 1e-12)
    ny, nx = w.shape
    best, step = np.arange(ny * nx).reshape(ny, nx), np.zeros((ny, nx))
    highest = w.copy()
    for j, i in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        beside = padded[1 + j : ny + 1 + j, 1 + i : nx + 1 + i]
        # Diagonally only past corners that are free, or the way would cut through one that is not.
        if i and j:
            passed = (padded[1 + j : ny + 1 + j, 1:-1] > 0) & (padded[1:-1, 1 + i : nx + 1 + i] > 0)
            beside = np.where(passed, beside, 0.0)
        better = (beside > highest) & ~goal
        best = np.where(better, np.arange(ny * nx).reshape(ny, nx) + j * nx + i, best)
        step = np.where(better, cell * math.hypot(i, j), step)
        highest = np.where(better, beside, highest)
    ways = _summed(best.ravel(), step.ravel()).reshape(ny, nx)
    return dx / length, dy / length, ways


def _summed(following: NDArray[np.int64], step: Array) -> Array:
    """Lengths of all chains of steps, by doubling: each round sums twice as many steps."""
    while np.any(following[following] != following):
        step, following = step + step[following], following[following]
    return step
