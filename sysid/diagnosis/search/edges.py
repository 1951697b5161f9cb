"""Edges at which a run jumps: where a command that lies between two levels begins to act.

A search by slopes does not move such an edge. Between two levels of the command that a log holds
nothing changes, and beyond one of them a whole stretch of the run does; a difference over a small
shift sees neither. So the edges of an item are moved over the levels, together first, then one by
one, and the other parameters follow after each move.
"""

from collections.abc import Callable, Sequence

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.full_model import FullModel
from sysid.diagnosis.search.prepared import Data

MOST = 24
"""Places of an edge that are tried: levels that lie closer are taken every so many."""

REACH = 2.5
"""An edge is sought from 1/f to f times where the slopes left it: starts lie that far apart."""

Search = Callable[[Array], tuple[Array, Array]]
"""(batch, parameters) → (the same with the other parameters fitted, cost (batch, tracks))."""

BestTracks = Callable[[FullModel, Array, Array], Array]


def edges_of(model: FullModel, free: Sequence[int]) -> tuple[int, ...]:
    """Free parameters of edges at which a run jumps."""
    return tuple(k for k in free if model.parameters[k].edge and model.parameters[k].jumps)


def on_levels(
    model: FullModel,
    q: Array,
    free: Sequence[Sequence[int]],
    data: Data,
    search: Search,
    best_tracks: BestTracks,
) -> tuple[Array, Array]:
    """Items of a batch with their edges where they fit best, (batch, parameters), and costs (batch,
    tracks).

    All edges of a track are moved by one factor first, and what jumps there by as much, so that
    larger commands keep their effect; then each edge alone.

    Args:
        model: simulation.
        q: parameters of the items, (batch, parameters).
        free: free parameters of each item.
        data: estimation records.
        search: fits the other parameters.
        best_tracks: takes each track's parameters from the item that fits it best.
    """
    tried = [_moved_together(model, row, own) for row, own in zip(q, free, strict=True)]
    moved, cost = search(_best(model, tried, data, best_tracks))
    for sign in (1, -1):
        tried = [
            _moved_alone(model, row, own, data, sign) for row, own in zip(moved, free, strict=True)
        ]
        moved, cost = search(_best(model, tried, data, best_tracks))
    return moved, cost


def _moved_together(model: FullModel, q: Array, free: Sequence[int]) -> Array:
    """An item, and with all edges of a track moved by one factor, (rows, parameters)."""
    edges = edges_of(model, free)
    rows = [q]
    for factor in np.geomspace(1.0 / REACH, REACH, MOST):
        row = q.copy()
        for i in range(model.tracks):
            edges_of_track = [k for k in edges if model.parameters[k].track == i]
            moved = [_bounded(model, k, q[k] * factor) for k in edges_of_track]
            shift = (
                np.mean([m - q[k] for m, k in zip(moved, edges_of_track, strict=True)])
                if edges_of_track
                else 0.0
            )
            row[edges_of_track] = moved
            for k in _jumps(model, free, i):
                row[k] = _bounded(model, k, q[k] + float(shift))
        rows.append(row)
        rows.append(_whole(model, row, edges, free))
    return np.array(rows)


def _moved_alone(model: FullModel, q: Array, free: Sequence[int], data: Data, sign: int) -> Array:
    """An item with the edges on one side of zero at each of their positions, (rows, parameters)."""
    rows = [q]
    edges = [k for k in edges_of(model, free) if model.parameters[k].edge == sign]
    positions = [_positions(data.drive[:, model.parameters[k].track] * sign, q[k]) for k in edges]
    for n in range(max((len(p) for p in positions), default=0)):
        row = q.copy()
        for k, p in zip(edges, positions, strict=True):
            row[k] = _bounded(model, k, p[min(n, len(p) - 1)])
        rows.append(row)
    return np.array(rows)


def _whole(model: FullModel, row: Array, edges: Sequence[int], free: Sequence[int]) -> Array:
    """The same edges, beyond which the whole command acts."""
    out = row.copy()
    for i in range(model.tracks):
        edges_of_track = [k for k in edges if model.parameters[k].track == i]
        for k in _jumps(model, free, i):
            out[k] = _bounded(model, k, float(np.mean(row[edges_of_track])))
    return out


def _jumps(model: FullModel, free: Sequence[int], track: int) -> list[int]:
    """Free parameters of how far a run jumps at the edges of a track."""
    parameters = model.parameters
    return [
        k
        for k in free
        if parameters[k].jumps and not parameters[k].edge and parameters[k].track == track
    ]


def _positions(drive: Array, now: float) -> Array:
    """Where an edge may lie around ``now``: midway between neighbouring levels of the command."""
    levels = np.unique(np.round(drive[drive > 0.0], 4))
    between = 0.5 * (levels[1:] + levels[:-1])
    near = between[(between > now / REACH) & (between < now * REACH)]
    if len(near) > MOST:
        near = near[np.linspace(0, len(near) - 1, MOST).astype(int)]
    return near if len(near) else np.array([now])


def _bounded(model: FullModel, k: int, value: float) -> float:
    return float(np.clip(value, model.parameters[k].lower, model.parameters[k].upper))


def _best(model: FullModel, rows: Sequence[Array], data: Data, best_tracks: BestTracks) -> Array:
    """The best row of each item, track by track, (batch, parameters)."""
    cost = data.squared_error(model.run(np.concatenate(rows), data))
    ends = np.cumsum([len(item_rows) for item_rows in rows])[:-1]
    parts = zip(rows, np.split(cost, ends), strict=True)
    return np.array([best_tracks(model, *part) for part in parts])


def between_levels(
    model: FullModel,
    q: Array,
    free: Sequence[int],
    data: Data,
    holdout: Data,
    best_tracks: BestTracks,
) -> Array:
    """An item whose edges suit the held-out records as far as the others leave them open.

    Between two neighbouring levels of the command an edge, and what jumps there, may move together
    without any change of the run on ``data``; a level of ``holdout`` in between decides.
    """
    edges = edges_of(model, free)
    rows = [q]
    for i in range(model.tracks):
        edges_of_track = [k for k in edges if model.parameters[k].track == i]
        jumps = _jumps(model, free, i)
        if not edges_of_track or not jumps:
            continue
        ends = [_open(data.drive[:, i] * model.parameters[k].edge, q[k]) for k in edges_of_track]
        low = max(a - q[k] for (a, _), k in zip(ends, edges_of_track, strict=True))
        high = min(b - q[k] for (_, b), k in zip(ends, edges_of_track, strict=True))
        low = max(low, -min(q[k] for k in jumps))
        for shift in np.linspace(low, high, MOST // 2 + 1)[1:-1]:
            row = q.copy()
            row[[*edges_of_track, *jumps]] += shift
            rows.append(row)
    return _best(model, [np.array(rows)], holdout, best_tracks)[0] if len(rows) > 1 else q


def _open(drive: Array, now: float) -> tuple[float, float]:
    """The neighbouring levels of the command below and above an edge."""
    levels = np.unique(drive[drive > 0.0])
    below, above = levels[levels <= now], levels[levels > now]
    return (float(below[-1]) if len(below) else now, float(above[0]) if len(above) else now)
