"""Edges at which a run jumps: where a command that lies between two levels begins to act.

A search by slopes does not move such an edge. Between two levels of the command that a log holds
nothing changes, and beyond one of them a whole stretch of the run does; a difference over a small
shift sees neither. So the edges of a lane are moved over the levels, together first, then one by
one, and the other numbers follow after each move.
"""

from collections.abc import Callable, Sequence

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.prepared import Data
from sysid.diagnosis.search.supermodel import SuperModel

MOST = 24
"""Places of an edge that are tried: levels that lie closer are taken every so many."""

REACH = 2.5
"""An edge is sought from 1/f to f times where the slopes left it: starts lie that far apart."""

Search = Callable[[Array], tuple[Array, Array]]
"""Lanes (lanes, slots) → (lanes with their other numbers fitted, cost (lanes, tracks))."""

BestTracks = Callable[[SuperModel, Array, Array], Array]


def edges_of(model: SuperModel, free: Sequence[int]) -> tuple[int, ...]:
    """Free slots of edges at which a run jumps."""
    return tuple(k for k in free if model.slots[k].edge and model.slots[k].jumps)


def on_levels(
    model: SuperModel,
    q: Array,
    free: Sequence[Sequence[int]],
    data: Data,
    search: Search,
    best_tracks: BestTracks,
) -> tuple[Array, Array]:
    """Lanes with their edges where they fit best, (lanes, slots), and costs (lanes, tracks).

    All edges of a track are moved by one factor first, and what jumps there by as much, so that
    larger commands keep their effect; then each edge alone.

    Args:
        model: simulation.
        q: numbers of the lanes, (lanes, slots).
        free: free slots of each lane.
        data: estimation records.
        search: fits the other numbers.
        best_tracks: takes each track's numbers from the lane that fits it best.
    """
    tried = [_moved_together(model, row, mine) for row, mine in zip(q, free, strict=True)]
    found, cost = search(_best(model, tried, data, best_tracks))
    for sign in (1, -1):
        tried = [
            _moved_alone(model, row, mine, data, sign)
            for row, mine in zip(found, free, strict=True)
        ]
        found, cost = search(_best(model, tried, data, best_tracks))
    return found, cost


def _moved_together(model: SuperModel, q: Array, free: Sequence[int]) -> Array:
    """A lane, and with all edges of a track moved by one factor, (rows, slots)."""
    edges = edges_of(model, free)
    rows = [q]
    for factor in np.geomspace(1.0 / REACH, REACH, MOST):
        row = q.copy()
        for i in range(model.tracks):
            mine = [k for k in edges if model.slots[k].track == i]
            moved = [_bounded(model, k, q[k] * factor) for k in mine]
            shift = np.mean([m - q[k] for m, k in zip(moved, mine, strict=True)]) if mine else 0.0
            row[mine] = moved
            for k in _jumps(model, free, i):
                row[k] = _bounded(model, k, q[k] + float(shift))
        rows.append(row)
        rows.append(_whole(model, row, edges, free))
    return np.array(rows)


def _moved_alone(model: SuperModel, q: Array, free: Sequence[int], data: Data, sign: int) -> Array:
    """A lane, and with the edges on one side of zero on each of their places, (rows, slots)."""
    rows = [q]
    mine = [k for k in edges_of(model, free) if model.slots[k].edge == sign]
    places = [_places(data.drive[:, model.slots[k].track] * sign, q[k]) for k in mine]
    for n in range(max((len(p) for p in places), default=0)):
        row = q.copy()
        for k, p in zip(mine, places, strict=True):
            row[k] = _bounded(model, k, p[min(n, len(p) - 1)])
        rows.append(row)
    return np.array(rows)


def _whole(model: SuperModel, row: Array, edges: Sequence[int], free: Sequence[int]) -> Array:
    """The same edges, beyond which the whole command acts."""
    out = row.copy()
    for i in range(model.tracks):
        mine = [k for k in edges if model.slots[k].track == i]
        for k in _jumps(model, free, i):
            out[k] = _bounded(model, k, float(np.mean(row[mine])))
    return out


def _jumps(model: SuperModel, free: Sequence[int], track: int) -> list[int]:
    """Free slots of how far a run jumps at the edges of a track."""
    slots = model.slots
    return [k for k in free if slots[k].jumps and not slots[k].edge and slots[k].track == track]


def _places(drive: Array, now: float) -> Array:
    """Where an edge may lie around ``now``: midway between neighbouring levels of the command."""
    levels = np.unique(np.round(drive[drive > 0.0], 4))
    between = 0.5 * (levels[1:] + levels[:-1])
    near = between[(between > now / REACH) & (between < now * REACH)]
    if len(near) > MOST:
        near = near[np.linspace(0, len(near) - 1, MOST).astype(int)]
    return near if len(near) else np.array([now])


def _bounded(model: SuperModel, k: int, value: float) -> float:
    return float(np.clip(value, model.slots[k].lower, model.slots[k].upper))


def _best(model: SuperModel, rows: Sequence[Array], data: Data, best_tracks: BestTracks) -> Array:
    """The best row of each lane, track by track, (lanes, slots)."""
    runs = model.run(np.concatenate(rows), data)
    with np.errstate(over="ignore", invalid="ignore"):
        cost = np.sum((data.weight * (data.y - runs)) ** 2, axis=1)
    ends = np.cumsum([len(own) for own in rows])[:-1]
    parts = zip(rows, np.split(cost, ends), strict=True)
    return np.array([best_tracks(model, *part) for part in parts])


def between_levels(
    model: SuperModel,
    q: Array,
    free: Sequence[int],
    data: Data,
    held: Data,
    best_tracks: BestTracks,
) -> Array:
    """A lane whose edges suit the held-out records as far as the others leave them open.

    Between two neighbouring levels of the command an edge, and what jumps there, may move together
    without any change of the run on ``data``; a level of ``held`` in between decides.
    """
    edges = edges_of(model, free)
    rows = [q]
    for i in range(model.tracks):
        mine = [k for k in edges if model.slots[k].track == i]
        jumps = _jumps(model, free, i)
        if not mine or not jumps:
            continue
        ends = [_open(data.drive[:, i] * model.slots[k].edge, q[k]) for k in mine]
        low = max(a - q[k] for (a, _), k in zip(ends, mine, strict=True))
        high = min(b - q[k] for (_, b), k in zip(ends, mine, strict=True))
        low = max(low, -min(q[k] for k in jumps))
        for shift in np.linspace(low, high, MOST // 2 + 1)[1:-1]:
            row = q.copy()
            row[[*mine, *jumps]] += shift
            rows.append(row)
    return _best(model, [np.array(rows)], held, best_tracks)[0] if len(rows) > 1 else q


def _open(drive: Array, now: float) -> tuple[float, float]:
    """The neighbouring levels of the command below and above an edge."""
    levels = np.unique(drive[drive > 0.0])
    below, above = levels[levels <= now], levels[levels > now]
    return (
        float(below[-1]) if len(below) else now,
        float(above[0]) if len(above) else now,
    )
