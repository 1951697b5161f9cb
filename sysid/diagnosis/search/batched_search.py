"""Levenberg–Marquardt over many candidates at once, on runs of the full model.

Gradients are forward differences: a shifted copy is one more item of the batch, which costs half of
a tangent and compiles in a quarter of the time. One copy serves all uncoupled tracks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import Array, Index
from sysid.diagnosis.policies import ENDLESS
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import Data
from sysid.fitting.batched import Damping, descend_together

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
        q0: starts, (batch, parameters).
        flat: an item rests when a step gains less than this share of its cost.

    Returns:
        (q (batch, parameters), cost (batch, tracks)).
    """
    batch = [_batch_item(model, q, f) for q, f in zip(q0, free, strict=True)]
    fits = _Fits(model, data, batch, q0)
    with np.errstate(over="ignore", invalid="ignore"):  # runs from some starts have no end
        theta, cost = descend_together(
            fits.run, fits.start, fits.free, fits.bounds, DAMPING, iterations, flat
        )
    return fits.rows(theta), fits.by_track(cost)


def best_tracks(model: FullModel, q: Array, cost: Array) -> Array:
    """Each track's parameters from the item that fits it best; what tracks share from the best of
    all.

    Args:
        q: (batch, parameters).
        cost: (batch, tracks).
    """
    cost = np.where(cost < ENDLESS, cost, np.inf)
    out = q[int(np.argmin(cost.sum(axis=1)))].copy()
    track = np.array([p.track for p in model.parameters])
    (own,) = np.nonzero(track >= 0)
    out[own] = q[np.argmin(cost, axis=0)[track[own]], own]
    return np.asarray(out)


def slopes(model: FullModel, q: Array, free: Sequence[int], data: Data) -> Array:
    """∂ŷ/∂q over the free parameters in their own units, (M, tracks, n), by forward differences."""
    if not free:
        return np.zeros((*data.y.shape, 0))
    rows = np.repeat(q[None], len(free) + 1, axis=0)
    steps = [_step(model, q, k) for k in free]
    rows[np.arange(1, len(rows)), list(free)] += steps
    first, *shifted = model.run(rows, data)
    with np.errstate(over="ignore", invalid="ignore"):
        whole = np.array([(run - first) / h for run, h in zip(shifted, steps, strict=True)])
    return np.moveaxis(np.nan_to_num(whole, posinf=0.0, neginf=0.0), 0, 2)


def _step(model: FullModel, q: Array, k: int) -> float:
    """The shift of a parameter for its slope, within its bounds."""
    p = model.parameters[k]
    return -p.shift if q[k] + p.shift > p.upper else p.shift


def information(model: FullModel, q: Array, free: Sequence[int], data: Data) -> Array:
    """Gauss–Newton matrix JᵀWJ over the free parameters in their own units, (n, n)."""
    J = data.weight[:, :, None] * slopes(model, q, free, data)
    return np.asarray(np.einsum("nki,nkj->ij", J, J))


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
        lower, upper = np.array([(p.lower, p.upper) for p in model.parameters]).T
        self.bounds = (lower[self.index], upper[self.index])
        self.start = q[self.item_of[:, None], self.index]

    def rows(self, theta: Array) -> Array:
        """Parameters of all items, (batch, parameters)."""
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
                S = np.where(np.abs(S) < ENDLESS, S, 0.0)  # of a run without end, NaN included
                A[at, :n, :n] += S @ S.T
                g[at, :n] += S @ np.nan_to_num(weight * (fits.data.y - self.runs[k])[:, i])
        return A, g

    def _shifted(self, k: int) -> tuple[list[Array], dict[int, float]]:
        """Copies of an item's parameters, one a column, and the shift of each parameter."""
        rows = []
        step: dict[int, float] = {}
        for parameters in self.fits.batch[k].columns:
            row = self.q[k].copy()
            for at in parameters:
                step[at] = _step(self.fits.model, self.q[k], at)
                row[at] += step[at]
            rows.append(row)
        return rows, step
