"""Fits with parameters at which runs jump: edges on the command's axis, and what no slope shows.

Where a command that lies between two levels begins to act, nothing changes between the levels that
a log holds, and beyond one of them a whole stretch of the run does; a difference over a small shift
sees neither. So the edges of an item are moved over the levels, together first, then one by one.
Other parameters on which runs depend by jumps are tried on ever finer grids. The rest follows
after each move.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.policies import RULE
from sysid.diagnosis.search.batched_search import FLAT, best_tracks, search
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import Data
from sysid.diagnosis.search.screen import screened

PROFILES, PROFILE_POINTS, PROFILE_STEPS = (3.0, 1.3), 9, 8
"""A parameter on which runs depend by jumps is first held from 1/f to f times its value while all
others are searched, """

PROFILED = 4
"""Points of a profile that are searched: those that leave least when the others follow to first
order."""

GRIDS, GRID_POINTS = (1.2, 1.05), 21
"""and then tried on ever finer grids."""

MOST = 24
"""Places of an edge that are tried: levels that lie closer are taken every so many."""

REACH = 2.5
"""An edge is sought from 1/f to f times where the slopes left it: starts lie that far apart."""

Search = Callable[[Array], tuple[Array, Array]]
"""(batch, parameters) → (the same with the other parameters fitted, cost (batch, tracks))."""


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
    smooth = [[k for k in f if not model.parameters[k].of.stepwise] for f in free]
    jumps = [[k for k in f if model.parameters[k].of.stepwise] for f in free]
    q, cost = search(model, q0, smooth, data, iterations, flat)
    edged = [k for k, parameters in enumerate(smooth) if edges_of(model, parameters)]
    if edged:
        free_edged = [smooth[k] for k in edged]
        again = partial(search, model, free=free_edged, data=data, iterations=iterations, flat=flat)
        moved, least = _on_levels(model, q[edged], free_edged, data, again)
        for k, row, now in zip(edged, moved, least, strict=True):
            if np.sum(now) < np.sum(cost[k]):
                q[k], cost[k] = row, now
    at = [k for k, parameters in enumerate(jumps) if parameters]
    for k in at:
        if k in unknown or len(q) == 1:
            q[k] = _profiled(model, q[k], smooth[k], jumps[k], data, flat, k in unknown)
    for spread in GRIDS if at else ():
        rows = _spread_out(model, q[at], [jumps[k] for k in at], spread, GRID_POINTS)
        q[at] = _best(model, list(rows), data)
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
        at_start = screened(model, q, smooth, rows, data).at_start
        rows = rows[np.argsort(at_start.sum(axis=1))[:PROFILED]]
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


def edges_of(model: FullModel, free: Sequence[int]) -> tuple[int, ...]:
    """Free parameters of edges at which a run jumps."""
    return tuple(k for k in free if model.parameters[k].of.edge and model.parameters[k].of.jumps)


def _by_track(model: FullModel, free: Sequence[int]) -> list[tuple[int, list[int], list[int]]]:
    """Each track with its free edges, and its parameters of how far a run jumps there."""
    edges, every = edges_of(model, free), model.parameters
    jumps = [k for k in free if every[k].of.jumps and not every[k].of.edge]
    tracks = dict.fromkeys(every[k].side for k in edges)

    def of(some: Sequence[int], i: int) -> list[int]:
        return [k for k in some if every[k].side == i]

    return [(i, of(edges, i), of(jumps, i)) for i in sorted(tracks)]


def _on_levels(
    model: FullModel, q: Array, free: Sequence[Sequence[int]], data: Data, again: Search
) -> tuple[Array, Array]:
    """Items of a batch (batch, parameters) with their edges where they fit best, and costs (batch,
    tracks).

    All edges of a track are moved by one factor first, and what jumps there by as much, so that
    larger commands keep their effect; then each edge alone.
    """
    tried = [_moved_together(model, row, own) for row, own in zip(q, free, strict=True)]
    moved, cost = again(_best(model, tried, data))
    for sign in (1, -1):
        pairs = zip(moved, free, strict=True)
        moved, cost = again(
            _best(model, [_moved_alone(model, *pair, data, sign) for pair in pairs], data)
        )
    return moved, cost


def _moved_together(model: FullModel, q: Array, free: Sequence[int]) -> Array:
    """An item, and with all edges of a track moved by one factor, (rows, parameters).

    The same edges once more, beyond which the whole command acts.
    """
    rows, every = [q], model.parameters
    for factor in np.geomspace(1.0 / REACH, REACH, MOST):
        row, whole = q.copy(), q.copy()
        for _, edges, jumps in _by_track(model, free):
            row[edges] = whole[edges] = moved = [every[k].within(q[k] * factor) for k in edges]
            shift = float(np.mean(moved - q[edges]))
            row[jumps] = [every[k].within(q[k] + shift) for k in jumps]
            whole[jumps] = [every[k].within(float(np.mean(moved))) for k in jumps]
        rows += [row, whole]
    return np.array(rows)


def _moved_alone(model: FullModel, q: Array, free: Sequence[int], data: Data, sign: int) -> Array:
    """An item with the edges on one side of zero at each of their positions, (rows, parameters)."""
    rows, every = [q], model.parameters
    edges = [k for k in edges_of(model, free) if every[k].of.edge == sign]
    positions = [_positions(data.drive[:, max(every[k].side, 0)] * sign, q[k]) for k in edges]
    for n in range(max((len(p) for p in positions), default=0)):
        row = q.copy()
        for k, p in zip(edges, positions, strict=True):
            row[k] = every[k].within(p[min(n, len(p) - 1)])
        rows.append(row)
    return np.array(rows)


def _positions(drive: Array, now: float) -> Array:
    """Where an edge may lie around ``now``: midway between neighbouring levels of the command."""
    levels = np.unique(np.round(drive[drive > 0.0], 4))
    between = 0.5 * (levels[1:] + levels[:-1])
    near = between[(between > now / REACH) & (between < now * REACH)]
    if len(near) > MOST:
        near = near[np.linspace(0, len(near) - 1, MOST).astype(int)]
    return near if len(near) else np.array([now])


def _best(model: FullModel, rows: Sequence[Array], data: Data) -> Array:
    """The best row of each item, track by track, (batch, parameters)."""
    cost = data.squared_error(model.run(np.concatenate(rows), data))
    ends = np.cumsum([len(item_rows) for item_rows in rows])[:-1]
    parts = zip(rows, np.split(cost, ends), strict=True)
    return np.array([best_tracks(model, *part) for part in parts])


def between_levels(
    model: FullModel, q: Array, free: Sequence[int], data: Data, holdout: Data
) -> Array:
    """An item whose edges suit the held-out samples as far as the others leave them open.

    Between two neighbouring levels of the command an edge, and what jumps there, may move together
    without any change of the run on ``data``; a level of ``holdout`` in between decides, where it
    matters to it.
    """
    rows = [q]
    for i, edges, jumps in _by_track(model, free):
        if not jumps:
            continue
        drive = data.drive[data.weight[:, min(max(i, 0), model.tracks - 1)] > 0.0, max(i, 0)]
        ends = [_open(drive * model.parameters[k].of.edge, q[k]) for k in edges]
        room = np.array(ends) - q[edges][:, None]
        low, high = max(np.max(room[:, 0]), -np.min(q[jumps])), np.min(room[:, 1])
        if not np.isfinite(low + high):
            continue
        for shift in np.linspace(low, high, MOST // 2 + 1)[1:-1]:
            row = q.copy()
            row[[*edges, *jumps]] += shift
            rows.append(row)
    if len(rows) == 1:
        return q
    moved = _best(model, [np.array(rows)], holdout)[0]
    now, then = np.sqrt(holdout.squared_error(model.run(np.array([q, moved]), holdout)).sum(axis=1))
    return moved if RULE.tie * then < now else q


def _open(drive: Array, now: float) -> tuple[float, float]:
    """The neighbouring levels of the command below and above an edge; of a side that is never
    commanded there are none."""
    levels = np.unique(drive[drive > 0.0])
    if not len(levels):
        return -np.inf, np.inf
    below, above = levels[levels <= now], levels[levels > now]
    return (float(below[-1]) if len(below) else now, float(above[0]) if len(above) else now)
