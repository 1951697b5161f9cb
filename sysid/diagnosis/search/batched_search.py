"""Levenberg–Marquardt over many candidates at once, on runs of the super-model.

Slopes are forward differences: a shifted copy of a lane is one more lane, which costs less than a
tangent of the compiled simulation (measured: half) and compiles in a quarter of the time. One
shifted copy serves all tracks as long as they do not feel each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from sysid.data.record import Array, Index
from sysid.diagnosis.search.edges import edges_of, on_levels
from sysid.diagnosis.search.prepared import Data
from sysid.diagnosis.search.supermodel import SuperModel
from sysid.fitting.batched import Damping, descend_together

PROFILES, PROFILE_POINTS, PROFILE_STEPS = (3.0, 1.3), 9, 8
"""A number on which runs depend by jumps is first held from 1/f to f times its value while all
others are searched, """

GRIDS, GRID_POINTS = (1.2, 1.05), 21
"""and then tried on ever finer grids."""

ENDLESS = 1e300
"""A cost beyond this is infinite: sums of several would overflow."""

FLAT = 1e-6
"""A lane rests when a step gains less than this share of its cost, unless told otherwise."""

DAMPING = Damping(first=1e-2, fall=0.2, rise=6.0, least=1e-9, most=1e6)
"""Enough at first: slopes by differences of runs that jump say little beyond a short step."""


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
    fits = _Fits(model, data, lanes, q0)
    theta, cost = descend_together(
        fits.run, fits.start, fits.free, fits.bounds, DAMPING, iterations, flat
    )
    return fits.rows(theta), fits.by_track(cost)


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
    edged = [k for k, mine in enumerate(smooth) if edges_of(model, mine)]
    if edged:
        theirs = [smooth[k] for k in edged]
        again = partial(search, model, free=theirs, data=data, iterations=iterations, flat=flat)
        moved, least = on_levels(model, q[edged], theirs, data, again, best_tracks)
        for k, row, now in zip(edged, moved, least, strict=True):
            if np.sum(now) < np.sum(cost[k]):
                q[k], cost[k] = row, now
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
        law = e.law(model.chosen(e, q))
        sets = [
            {k: v for k, v in start.items() if k in smooth}
            for start in model.starts(e)
            if e.law({model.slots[k].name: v for k, v in start.items()}) is law
        ]
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
    with np.errstate(over="ignore", invalid="ignore"):
        squared = np.sum((data.weight * (data.y - runs)) ** 2, axis=1)
    cost = squared.reshape(len(q), GRID_POINTS, -1)
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
    cost = np.where(cost < ENDLESS, cost, np.inf)
    out = q[int(np.argmin(cost.sum(axis=1)))].copy()
    for k, slot in enumerate(model.slots):
        if slot.track >= 0:
            out[k] = q[int(np.argmin(cost[:, slot.track])), k]
    return np.asarray(out)


def information(model: SuperModel, q: Array, free: Sequence[int], data: Data) -> Array:
    """Gauss–Newton matrix JᵀWJ over the free slots in their own units, (n, n)."""
    lane = _Lane(((tuple(free), tuple(range(model.tracks))),), tuple((k,) for k in free))
    fits = _Fits(model, data, [lane], q[None])
    A, _ = fits.run(fits.start, np.arange(1)).normal(np.arange(1))
    return np.asarray(A[0])


class _Fits:
    """The groups of all lanes: each is a fit of its own, a lane's run is that of all its groups.

    Numbers are counted in their typical sizes.
    """

    def __init__(self, model: SuperModel, data: Data, lanes: Sequence[_Lane], q: Array) -> None:
        self.model, self.data, self.lanes, self.q = model, data, lanes, q
        self.groups = [(k, *group) for k, lane in enumerate(lanes) for group in lane.groups]
        self.lane_of = np.array([k for k, _, _ in self.groups], dtype=np.intp)
        width = max((len(slots) for _, slots, _ in self.groups), default=0)
        self.place = np.zeros((len(self.groups), width), dtype=np.intp)
        self.free = np.zeros(self.place.shape, dtype=bool)
        for f, (_, slots, _) in enumerate(self.groups):
            self.place[f, : len(slots)] = slots
            self.free[f, : len(slots)] = True
        lower, upper, shift = (
            np.array([getattr(s, name) for s in model.slots])
            for name in ("lower", "upper", "shift")
        )
        self.upper, self.shift = upper, shift
        self.bounds = (lower[self.place], upper[self.place])
        self.start = q[self.lane_of[:, None], self.place]

    def rows(self, theta: Array) -> Array:
        """Numbers of all lanes, (lanes, slots)."""
        q = self.q.copy()
        for (k, slots, _), mine in zip(self.groups, theta, strict=True):
            q[k, list(slots)] = mine[: len(slots)]
        return q

    def by_track(self, cost: Array) -> Array:
        """Costs of all lanes, (lanes, tracks), from those of the groups; what none moves is run."""
        found = np.full((len(self.q), self.model.tracks), np.nan)
        for (k, _, tracks), mine in zip(self.groups, cost, strict=True):
            found[k, list(tracks)] = mine[list(tracks)]
        rest = np.flatnonzero(np.isnan(found).any(axis=1))
        if len(rest):
            runs = self.model.run(self.q[rest], self.data)
            own = np.array([squares(self.data, run) for run in runs])
            found[rest] = np.where(np.isnan(found[rest]), own, found[rest])
        return found

    def run(self, theta: Array, which: Index) -> "_Trial":
        """Runs of the lanes of some groups."""
        lanes = np.unique(self.lane_of[which])
        q = self.rows(theta)
        runs = self.model.run(q[lanes], self.data) if len(lanes) else ()
        return _Trial(self, q, which, dict(zip(lanes.tolist(), runs, strict=True)))


@dataclass(frozen=True, eq=False)
class _Trial:
    """Some groups at some numbers: of all lanes, and the runs of theirs."""

    fits: _Fits
    q: Array
    which: Index
    runs: dict[int, Array]

    @property
    def cost(self) -> Array:
        """Squared errors of the groups on each track, zero on others', (groups, tracks)."""
        found = np.zeros((len(self.which), self.fits.model.tracks))
        of_lane = {k: squares(self.fits.data, run) for k, run in self.runs.items()}
        for row, f in zip(found, self.which, strict=True):
            k, _, tracks = self.fits.groups[f]
            row[list(tracks)] = of_lane[k][list(tracks)]
        return found

    def normal(self, of: Index) -> tuple[Array, Array]:
        """Normal equations of some of the groups, by differences."""
        fits, mine = self.fits, self.which[of]
        lanes = np.unique(fits.lane_of[mine]).tolist()
        copies = {k: self._shifted(k) for k in lanes}
        rows = np.array([row for k in lanes for row in copies[k][0]])
        shifted = iter(fits.model.run(rows, fits.data) if len(rows) else ())
        change = {k: [next(shifted) - self.runs[k] for _ in fits.lanes[k].columns] for k in lanes}
        size = fits.place.shape[1]
        A, g = np.zeros((len(of), size, size)), np.zeros((len(of), size))
        for at, f in enumerate(mine):
            k, slots, tracks = fits.groups[f]
            column = {s: c for c, both in enumerate(fits.lanes[k].columns) for s in both}
            step = copies[k][1]
            n = len(slots)
            for i in tracks:
                weight = fits.data.weight[:, i]
                S = np.array([weight * change[k][column[s]][:, i] / step[s] for s in slots])
                S = np.where(np.isfinite(S), S, 0.0)
                A[at, :n, :n] += S @ S.T
                g[at, :n] += S @ np.nan_to_num(weight * (fits.data.y - self.runs[k])[:, i])
        return A, g

    def _shifted(self, k: int) -> tuple[list[Array], dict[int, float]]:
        """Copies of a lane's numbers, one a column, and the shift of each slot."""
        fits, rows = self.fits, []
        step: dict[int, float] = {}
        for slots in fits.lanes[k].columns:
            at = list(slots)
            row = self.q[k].copy()
            h = np.where(row[at] + fits.shift[at] > fits.upper[at], -1.0, 1.0) * fits.shift[at]
            row[at] += h
            rows.append(row)
            step |= dict(zip(slots, h.tolist(), strict=True))
        return rows, step


def squares(data: Data, run: Array) -> Array:
    """Squared weighted error of a run (M, tracks) on each track; infinite where it is no number."""
    with np.errstate(over="ignore", invalid="ignore"):
        sums = np.sum((data.weight * (data.y - run)) ** 2, axis=0)
    return np.where(sums < ENDLESS, sums, np.inf)
