"""Levenberg–Marquardt over many candidates at once, on runs of the super-model.

Slopes are forward differences: a shifted copy of a lane is one more lane, which costs less than a
tangent of the compiled simulation (measured: half) and compiles in a quarter of the time. One
shifted copy serves all tracks as long as they do not feel each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array
from sysid.discrepancy.search.supermodel import Data, SuperModel

PROFILES, PROFILE_POINTS, PROFILE_STEPS = (3.0, 1.3), 9, 8
"""A number on which runs depend by jumps is first held from 1/f to f times its value while all
others are searched, """

GRIDS, GRID_POINTS = (1.2, 1.05), 21
"""and then tried on ever finer grids."""

FLAT = 1e-6
"""A lane rests when a step gains less than this share of its cost, unless told otherwise."""

STEEPEST = 1e6
"""A lane rests when its damping exceeds this: no step gains."""

Slopes = tuple[Array, Array]
"""(g, H): gradient and Gauss–Newton matrix in scaled numbers."""


@dataclass(frozen=True, eq=False)
class _Lane:
    """How the free slots of one search are moved and solved.

    Attributes:
        groups: (slots, tracks) that step together; tracks that feel each other form one.
        columns: slots that one shifted copy moves.
    """

    groups: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]
    columns: tuple[tuple[int, ...], ...]


def _lane(model: SuperModel, q: Array, free: Sequence[int]) -> _Lane:
    everything = tuple(range(model.tracks))
    if model.joined(q, free):
        return _Lane(((tuple(free), everything),), tuple((k,) for k in free))
    rows = [tuple(k for k in free if model.slots[k].track == i) for i in everything]
    groups = tuple((row, (i,)) for i, row in zip(everything, rows, strict=True) if row)
    depth = max((len(row) for row in rows), default=0)
    columns = tuple(tuple(row[c] for row in rows if c < len(row)) for c in range(depth))
    return _Lane(groups, columns)


def search(
    model: SuperModel,
    q0: Array,
    free: Sequence[Sequence[int]],
    data: Data,
    iterations: int,
    flat: float = FLAT,
) -> tuple[Array, Array]:
    """Minimise ‖weight (y − run)‖² from every row of ``q0`` over its own free slots.

    Bounds are kept by projection: a number on its bound whose slope points outside is held for
    that step. Tracks that do not feel each other step on their own.

    Args:
        model: simulation.
        q0: starts, (lanes, slots).
        free: free slots of each lane.
        data: records.
        iterations: most steps.
        flat: a lane rests when a step gains less than this share of its cost.

    Returns:
        (q (lanes, slots), cost (lanes, tracks)).
    """
    lanes = [_lane(model, q, f) for q, f in zip(q0, free, strict=True)]
    state = _Search(model, data, lanes, q0.copy(), flat)
    for _ in range(iterations):
        active = np.flatnonzero(~state.resting.all(axis=1))
        if not len(active):
            break
        state.advance(active)
    return state.q, state.cost


def refined(
    model: SuperModel,
    q0: Array,
    free: Sequence[Sequence[int]],
    data: Data,
    iterations: int,
    flat: float = FLAT,
    unknown: Sequence[int] = (),
) -> tuple[Array, Array]:
    """As ``search``, and numbers on which runs depend by jumps on ever finer grids.

    Args:
        unknown: lanes where such a number may still be far off: it is profiled first, widely. A
            single lane is always profiled around where it stands.
    """
    smooth = [[k for k in f if not model.slots[k].stepwise] for f in free]
    jumps = [[k for k in f if model.slots[k].stepwise] for f in free]
    q, cost = search(model, q0, smooth, data, iterations, flat)
    at = [k for k, slots in enumerate(jumps) if slots]
    for k in at:
        if k in unknown or len(q) == 1:
            q[k] = _profiled(model, q[k], smooth[k], jumps[k], data, flat, k in unknown)
    for spread in GRIDS if at else ():
        q[at] = _on_grid(model, q[at], [jumps[k] for k in at], spread, data)
        q[at], cost[at] = search(model, q[at], [smooth[k] for k in at], data, iterations, flat)
    if at and len(q) == 1:
        most = min(iterations, PROFILE_STEPS)
        q[at], cost[at] = search(model, q[at], [free[k] for k in at], data, most, flat)
    return q, cost


def _profiled(
    model: SuperModel,
    q: Array,
    smooth: Sequence[int],
    jumps: Sequence[int],
    data: Data,
    flat: float,
    widely: bool,
) -> Array:
    """A lane searched anew at every point of grids over its numbers with jumps."""
    shaped = np.array(_shapes(model, q, smooth, jumps)) if widely else q[None]
    for spread in PROFILES if widely else PROFILES[1:]:
        rows = _spread_out(model, shaped, [jumps] * len(shaped), spread, PROFILE_POINTS)
        rows = rows.reshape(-1, len(q))
        found, cost = search(model, rows, [smooth] * len(rows), data, PROFILE_STEPS, flat)
        q = best_tracks(model, found, cost)
        shaped = q[None]
    return q


def _shapes(
    model: SuperModel, q: Array, smooth: Sequence[int], jumps: Sequence[int]
) -> list[Array]:
    """A lane as it is, and with the starts of the other numbers of an effect that has jumps."""
    owners = {model.slots[s].owner for s in jumps}
    found = [q]
    for e in (e for e in model.effects if e.id in owners):
        sets = [{k: v for k, v in start.items() if k in smooth} for start in model.starts(e)]
        for values in {tuple(sorted(s.items())) for s in sets}:
            row = q.copy()
            for k, v in values:
                row[k] = v
            found.append(row)
    return [found[0], *sorted(found[1:], key=lambda row: row.tolist())]


def _on_grid(
    model: SuperModel, q: Array, slots: Sequence[Sequence[int]], spread: float, data: Data
) -> Array:
    """The best of a grid around some numbers of each lane, track by track."""
    rows = _spread_out(model, q, slots, spread, GRID_POINTS)
    runs = model.run(rows.reshape(-1, rows.shape[2]), data)
    cost = np.sum((data.weight * (data.y - runs)) ** 2, axis=1).reshape(len(q), GRID_POINTS, -1)
    return np.array([best_tracks(model, *lane) for lane in zip(rows, cost, strict=True)])


def _spread_out(
    model: SuperModel, q: Array, slots: Sequence[Sequence[int]], spread: float, points: int
) -> Array:
    """Lanes with some numbers from 1/spread to spread times their value, (lanes, points, slots)."""
    rows = np.repeat(q[:, None], points, axis=1)
    factors = np.geomspace(1.0 / spread, spread, points)
    for lane, mine in zip(rows, slots, strict=True):
        for s in mine:
            lane[:, s] = np.minimum(lane[:, s] * factors, model.slots[s].upper)
    return rows


def best_tracks(model: SuperModel, q: Array, cost: Array) -> Array:
    """Each track's numbers from the lane that fits it best; what tracks share from the best of all.

    Args:
        model: simulation.
        q: (lanes, slots).
        cost: (lanes, tracks).
    """
    cost = np.nan_to_num(cost, nan=np.inf)
    out = q[int(np.argmin(cost.sum(axis=1)))].copy()
    for k, slot in enumerate(model.slots):
        if slot.track >= 0:
            out[k] = q[int(np.argmin(cost[:, slot.track])), k]
    return np.asarray(out)


def information(model: SuperModel, q: Array, free: Sequence[int], data: Data) -> Array:
    """Gauss–Newton matrix JᵀWJ over the free slots in their own units, (n, n)."""
    lane = _Lane(((tuple(free), tuple(range(model.tracks))),), tuple((k,) for k in free))
    state = _Search(model, data, [lane], q[None].copy())
    scale = state.scale[list(free)]
    return np.asarray(state.slopes[0][0][1] / np.outer(scale, scale))


class _Search:
    """Where each lane stands: numbers, costs, slopes, damping."""

    def __init__(
        self,
        model: SuperModel,
        data: Data,
        lanes: Sequence[_Lane],
        q: Array,
        flat: float = FLAT,
    ) -> None:
        self.flat = flat
        self.model, self.data, self.lanes, self.q = model, data, lanes, q
        self.lower = np.array([s.lower for s in model.slots])
        self.upper = np.array([s.upper for s in model.slots])
        self.scale = np.array([s.scale for s in model.slots])
        self.shift = np.array([s.shift for s in model.slots])
        count, tracks = len(q), model.tracks
        self.damping = np.full((count, tracks), 1e-2)
        self.resting = np.zeros((count, tracks), dtype=bool)
        self.slopes: list[list[Slopes]] = [[] for _ in lanes]
        runs = model.run(q, data)
        self.cost = np.array([self._cost(run) for run in runs])
        self._differentiate(range(count), runs)

    def _cost(self, run: Array) -> Array:
        sums = np.sum((self.data.weight * (self.data.y - run)) ** 2, axis=0)
        return np.where(np.isfinite(sums), sums, np.inf)

    def _differentiate(self, lanes: Sequence[int], runs: Array) -> None:
        """Slopes of these lanes, whose runs are given."""
        rows, shifts = [], []
        for k in lanes:
            for slots in self.lanes[k].columns:
                index = np.array(slots)
                h = self.shift[index]
                h = np.where(self.q[k, index] + h > self.upper[index], -h, h)
                moved = self.q[k].copy()
                moved[index] += h
                rows.append(moved)
                shifts.append(dict(zip(slots, h / self.scale[index], strict=True)))
        moved_runs = self.model.run(np.array(rows), self.data) if rows else runs[:0]
        at = 0
        for k, run in zip(lanes, runs, strict=True):
            lane = self.lanes[k]
            width = len(lane.columns)
            J = moved_runs[at : at + width] - run
            column = {s: c for c, slots in enumerate(lane.columns) for s in slots}
            step = {s: h for shift in shifts[at : at + width] for s, h in shift.items()}
            at += width
            r = self.data.weight * (self.data.y - run)
            self.slopes[k] = [
                self._normal(J, r, slots, tracks, column, step) for slots, tracks in lane.groups
            ]

    def _normal(
        self,
        J: Array,
        r: Array,
        slots: tuple[int, ...],
        tracks: tuple[int, ...],
        column: dict[int, int],
        step: dict[int, float],
    ) -> Slopes:
        h = np.array([step[s] for s in slots])
        g, H = np.zeros(len(slots)), np.zeros((len(slots), len(slots)))
        for i in tracks:
            part = J[[column[s] for s in slots], :, i] * self.data.weight[:, i] / h[:, None]
            part = np.where(np.isfinite(part), part, 0.0)
            g += part @ np.nan_to_num(r[:, i])
            H += part @ part.T
        return g, H

    def advance(self, active: NDArray[np.int64]) -> None:
        """One step of every active lane."""
        trial = self.q[active].copy()
        for q, k in zip(trial, active, strict=True):
            for (slots, tracks), (g, H) in zip(self.lanes[k].groups, self.slopes[k], strict=True):
                if not self.resting[k, list(tracks)].all():
                    self._move(q, np.array(slots), g, H, float(self.damping[k, tracks[0]]))
        runs = self.model.run(trial, self.data)
        better = [
            i for i, k in enumerate(active) if self._judge(int(k), trial[i], self._cost(runs[i]))
        ]
        if better:
            # a lane of which one track was turned down runs as its accepted numbers say
            lanes = [int(active[i]) for i in better]
            mixed = [
                not np.array_equal(self.q[k], trial[i]) for i, k in zip(better, lanes, strict=True)
            ]
            kept = runs[better]
            if any(mixed):
                kept[mixed] = self.model.run(self.q[np.array(lanes)[mixed]], self.data)
            self._differentiate(lanes, kept)

    def _judge(self, k: int, trial: Array, cost: Array) -> bool:
        """Take over what has gained, group by group; whether anything has and may gain more."""
        took = False
        for slots, tracks in self.lanes[k].groups:
            at = list(tracks)
            if self.resting[k, at].all():
                continue
            old, new = float(self.cost[k, at].sum()), float(cost[at].sum())
            if new < old:
                self.q[k, list(slots)] = trial[list(slots)]
                self.cost[k, at] = cost[at]
                self.damping[k, at] = np.maximum(self.damping[k, at] / 5.0, 1e-9)
                self.resting[k, at] = (old - new) < self.flat * old
                took = took or not self.resting[k, at].all()
            else:
                self.damping[k, at] *= 6.0
                self.resting[k, at] = self.damping[k, at] > STEEPEST
        return took

    def _move(self, q: Array, slots: Array, g: Array, H: Array, damping: float) -> None:
        """One damped Gauss–Newton step of q within the bounds; g points downhill."""
        outward = ((q[slots] <= self.lower[slots]) & (g < 0)) | (
            (q[slots] >= self.upper[slots]) & (g > 0)
        )
        index = np.flatnonzero(~outward)
        if not len(index):
            return
        A, diagonal = H[np.ix_(index, index)], np.diag(H)[index]
        diagonal = np.maximum(diagonal, 1e-12 * max(float(diagonal.max()), 1e-300))
        step = np.linalg.lstsq(A + damping * np.diag(diagonal), g[index], rcond=None)[0]
        moved = slots[index]
        q[moved] = np.clip(
            q[moved] + self.scale[moved] * step, self.lower[moved], self.upper[moved]
        )
