"""Levenberg–Marquardt over many candidates at once, on runs of the full model.

Gradients are forward differences: a shifted copy is one more item of the batch, which costs half of
a tangent and compiles in a quarter of the time. One copy serves all uncoupled tracks.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from sysid.data.record import Array, Index
from sysid.diagnosis.search.edges import edges_of, on_levels
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import OVERFLOW, Data
from sysid.fitting.batched import Damping, descend_together

PROFILES, PROFILE_POINTS, PROFILE_STEPS = (3.0, 1.3), 9, 8
"""A parameter on which runs depend by jumps is first held from 1/f to f times its value while all
others are searched, """

GRIDS, GRID_POINTS = (1.2, 1.05), 21
"""and then tried on ever finer grids."""

FLAT = 1e-6
"""An item rests when a step gains less than this share of its cost, unless told otherwise."""

DAMPING = Damping(first=1e-2, fall=0.2, rise=6.0, least=1e-9, most=1e6)
"""Enough at first: slopes by differences of runs that jump say little beyond a short step."""


@dataclass(frozen=True, eq=False)
class _BatchItem:
    """How the free parameters of one search are moved and solved.

    Attributes:
        groups: (parameters, tracks) that step together; tracks that feel each other form one.
        columns: parameters that one shifted copy moves.
    """

    groups: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]
    columns: tuple[tuple[int, ...], ...]


def _batch_item(model: FullModel, q: Array, free: Sequence[int]) -> _BatchItem:
    everything = tuple(range(model.tracks))
    if model.joined(q, free):
        return _BatchItem(((tuple(free), everything),), tuple((k,) for k in free))
    rows = [tuple(k for k in free if model.parameters[k].track == i) for i in everything]
    groups = tuple((row, (i,)) for i, row in zip(everything, rows, strict=True) if row)
    depth = max((len(row) for row in rows), default=0)
    columns = tuple(tuple(row[c] for row in rows if c < len(row)) for c in range(depth))
    return _BatchItem(groups, columns)


def search(
    model: FullModel,
    q0: Array,
    free: Sequence[Sequence[int]],
    data: Data,
    iterations: int,
    flat: float = FLAT,
) -> tuple[Array, Array]:
    """Minimise ‖weight (y − run)‖² from every row of ``q0`` over its own free parameters.

    Bounds are kept by projection: a parameter on its bound whose slope points outside is held for
    that step. Tracks that do not feel each other step on their own.

    Args:
        model: simulation.
        q0: starts, (batch, parameters).
        free: free parameters of each item.
        data: records.
        iterations: most steps.
        flat: an item rests when a step gains less than this share of its cost.

    Returns:
        (q (batch, parameters), cost (batch, tracks)).
    """
    batch = [_batch_item(model, q, f) for q, f in zip(q0, free, strict=True)]
    fits = _Fits(model, data, batch, q0)
    theta, cost = descend_together(
        fits.run, fits.start, fits.free, fits.bounds, DAMPING, iterations, flat
    )
    return fits.rows(theta), fits.by_track(cost)


def refined(
    model: FullModel,
    q0: Array,
    free: Sequence[Sequence[int]],
    data: Data,
    iterations: int,
    flat: float = FLAT,
    unknown: Sequence[int] = (),
) -> tuple[Array, Array]:
    """As ``search``, and parameters on which runs depend by jumps on ever finer grids.

    Args:
        unknown: items where such a parameter may still be far off: it is profiled first, widely. A
            single item is always profiled around where it stands.
    """
    smooth = [[k for k in f if not model.parameters[k].stepwise] for f in free]
    jumps = [[k for k in f if model.parameters[k].stepwise] for f in free]
    q, cost = search(model, q0, smooth, data, iterations, flat)
    edged = [k for k, parameters in enumerate(smooth) if edges_of(model, parameters)]
    if edged:
        free_edged = [smooth[k] for k in edged]
        again = partial(search, model, free=free_edged, data=data, iterations=iterations, flat=flat)
        moved, least = on_levels(model, q[edged], free_edged, data, again, best_tracks)
        for k, row, now in zip(edged, moved, least, strict=True):
            if np.sum(now) < np.sum(cost[k]):
                q[k], cost[k] = row, now
    at = [k for k, parameters in enumerate(jumps) if parameters]
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
    model: FullModel,
    q: Array,
    smooth: Sequence[int],
    jumps: Sequence[int],
    data: Data,
    flat: float,
    widely: bool,
) -> Array:
    """An item searched anew at every point of grids over its parameters with jumps."""
    shaped = np.array(_shapes(model, q, smooth, jumps)) if widely else q[None]
    for spread in PROFILES if widely else PROFILES[1:]:
        rows = _spread_out(model, shaped, [jumps] * len(shaped), spread, PROFILE_POINTS)
        rows = rows.reshape(-1, len(q))
        refit, cost = search(model, rows, [smooth] * len(rows), data, PROFILE_STEPS, flat)
        q = best_tracks(model, refit, cost)
        shaped = q[None]
    return q


def _shapes(model: FullModel, q: Array, smooth: Sequence[int], jumps: Sequence[int]) -> list[Array]:
    """An item as it is, and with the starts of the other parameters of an effect that has jumps."""
    owners = {model.parameters[s].owner for s in jumps}
    rows = [q]
    for e in (e for e in model.effects if e.id in owners):
        law = e.law(model.chosen(e, q))
        sets = [
            {k: v for k, v in start.items() if k in smooth}
            for start in model.starts(e)
            if e.law({model.parameters[k].name: v for k, v in start.items()}) is law
        ]
        for values in {tuple(sorted(s.items())) for s in sets}:
            row = q.copy()
            for k, v in values:
                row[k] = v
            rows.append(row)
    return [rows[0], *sorted(rows[1:], key=lambda row: row.tolist())]


def _on_grid(
    model: FullModel, q: Array, parameters: Sequence[Sequence[int]], spread: float, data: Data
) -> Array:
    """The best of a grid around some parameters of each item, track by track."""
    rows = _spread_out(model, q, parameters, spread, GRID_POINTS)
    runs = model.run(rows.reshape(-1, rows.shape[2]), data)
    cost = data.squared_error(runs).reshape(len(q), GRID_POINTS, -1)
    return np.array([best_tracks(model, *item) for item in zip(rows, cost, strict=True)])


def _spread_out(
    model: FullModel, q: Array, parameters: Sequence[Sequence[int]], spread: float, points: int
) -> Array:
    """Some parameters from 1/spread to spread times their value, (batch, points, parameters)."""
    rows = np.repeat(q[:, None], points, axis=1)
    factors = np.geomspace(1.0 / spread, spread, points)
    for item, spread_parameters in zip(rows, parameters, strict=True):
        for s in spread_parameters:
            item[:, s] = np.minimum(item[:, s] * factors, model.parameters[s].upper)
    return rows


def best_tracks(model: FullModel, q: Array, cost: Array) -> Array:
    """Each track's parameters from the item that fits it best; what tracks share from the best of
    all.

    Args:
        model: simulation.
        q: (batch, parameters).
        cost: (batch, tracks).
    """
    cost = np.where(cost < OVERFLOW, cost, np.inf)
    out = q[int(np.argmin(cost.sum(axis=1)))].copy()
    for k, parameter in enumerate(model.parameters):
        if parameter.track >= 0:
            out[k] = q[int(np.argmin(cost[:, parameter.track])), k]
    return np.asarray(out)


def information(model: FullModel, q: Array, free: Sequence[int], data: Data) -> Array:
    """Gauss–Newton matrix JᵀWJ over the free parameters in their own units, (n, n)."""
    item = _BatchItem(((tuple(free), tuple(range(model.tracks))),), tuple((k,) for k in free))
    fits = _Fits(model, data, [item], q[None])
    A, _ = fits.run(fits.start, np.arange(1)).normal(np.arange(1))
    return np.asarray(A[0])


class _Fits:
    """The groups of all items: each is a fit of its own, an item's run is that of all its groups.

    Parameters are counted in their typical sizes.
    """

    def __init__(self, model: FullModel, data: Data, batch: Sequence[_BatchItem], q: Array) -> None:
        self.model, self.data, self.batch, self.q = model, data, batch, q
        self.groups = [(k, *group) for k, item in enumerate(batch) for group in item.groups]
        self.item_of = np.array([k for k, _, _ in self.groups], dtype=np.intp)
        width = max((len(parameters) for _, parameters, _ in self.groups), default=0)
        self.index = np.zeros((len(self.groups), width), dtype=np.intp)
        self.free = np.zeros(self.index.shape, dtype=bool)
        for f, (_, parameters, _) in enumerate(self.groups):
            self.index[f, : len(parameters)] = parameters
            self.free[f, : len(parameters)] = True
        lower, upper, shift = (
            np.array([getattr(s, name) for s in model.parameters])
            for name in ("lower", "upper", "shift")
        )
        self.upper, self.shift = upper, shift
        self.bounds = (lower[self.index], upper[self.index])
        self.start = q[self.item_of[:, None], self.index]

    def rows(self, theta: Array) -> Array:
        """ParameterTable of all items, (batch, parameters)."""
        q = self.q.copy()
        for (k, parameters, _), values in zip(self.groups, theta, strict=True):
            q[k, list(parameters)] = values[: len(parameters)]
        return q

    def by_track(self, cost: Array) -> Array:
        """Costs of all items, (batch, tracks), from those of the groups; what none moves is run."""
        costs = np.full((len(self.q), self.model.tracks), np.nan)
        for (k, _, tracks), group_cost in zip(self.groups, cost, strict=True):
            costs[k, list(tracks)] = group_cost[list(tracks)]
        rest = np.flatnonzero(np.isnan(costs).any(axis=1))
        if len(rest):
            runs = self.model.run(self.q[rest], self.data)
            track_costs = self.data.squared_error(runs)
            costs[rest] = np.where(np.isnan(costs[rest]), track_costs, costs[rest])
        return costs

    def run(self, theta: Array, which: Index) -> "_Trial":
        """Runs of the items of some groups."""
        batch = np.unique(self.item_of[which])
        q = self.rows(theta)
        runs = self.model.run(q[batch], self.data) if len(batch) else ()
        return _Trial(self, q, which, dict(zip(batch.tolist(), runs, strict=True)))


@dataclass(frozen=True, eq=False)
class _Trial:
    """Some groups at some parameters: of all items, and the runs of theirs."""

    fits: _Fits
    q: Array
    which: Index
    runs: dict[int, Array]

    @property
    def cost(self) -> Array:
        """Squared errors of the groups on each track, zero on others', (groups, tracks)."""
        costs = np.zeros((len(self.which), self.fits.model.tracks))
        of_item = {k: self.fits.data.squared_error(run) for k, run in self.runs.items()}
        for row, f in zip(costs, self.which, strict=True):
            k, _, tracks = self.fits.groups[f]
            row[list(tracks)] = of_item[k][list(tracks)]
        return costs

    def normal(self, of: Index) -> tuple[Array, Array]:
        """Normal equations of some of the groups, by differences."""
        fits, groups = self.fits, self.which[of]
        batch = np.unique(fits.item_of[groups]).tolist()
        copies = {k: self._shifted(k) for k in batch}
        rows = np.array([row for k in batch for row in copies[k][0]])
        shifted = iter(fits.model.run(rows, fits.data) if len(rows) else ())
        change = {k: [next(shifted) - self.runs[k] for _ in fits.batch[k].columns] for k in batch}
        size = fits.index.shape[1]
        A, g = np.zeros((len(of), size, size)), np.zeros((len(of), size))
        for at, f in enumerate(groups):
            k, parameters, tracks = fits.groups[f]
            column = {s: c for c, both in enumerate(fits.batch[k].columns) for s in both}
            step = copies[k][1]
            n = len(parameters)
            for i in tracks:
                weight = fits.data.weight[:, i]
                S = np.array([weight * change[k][column[s]][:, i] / step[s] for s in parameters])
                S = np.where(np.isfinite(S), S, 0.0)
                A[at, :n, :n] += S @ S.T
                g[at, :n] += S @ np.nan_to_num(weight * (fits.data.y - self.runs[k])[:, i])
        return A, g

    def _shifted(self, k: int) -> tuple[list[Array], dict[int, float]]:
        """Copies of an item's parameters, one a column, and the shift of each parameter."""
        fits, rows = self.fits, []
        step: dict[int, float] = {}
        for parameters in fits.batch[k].columns:
            at = list(parameters)
            row = self.q[k].copy()
            h = np.where(row[at] + fits.shift[at] > fits.upper[at], -1.0, 1.0) * fits.shift[at]
            row[at] += h
            rows.append(row)
            step |= dict(zip(parameters, h.tolist(), strict=True))
        return rows, step
