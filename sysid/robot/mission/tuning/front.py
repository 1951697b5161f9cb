"""The Pareto front of many sets of gains, and the proposed set."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import Array, Index


@dataclass(frozen=True, eq=False)
class Front:
    """The sets that no other one beats in every criterion.

    Attributes:
        members: rows of the table of criteria, by their first criterion.
        scaled: distances of the members from the best of each criterion, in parts of the distance
            of the front's median from it, (members, criteria).
    """

    members: Index
    scaled: Array

    @property
    def distance(self) -> Array:
        """Distance of each member from the point that is best in everything, (members,)."""
        return np.asarray(np.sqrt(np.sum(self.scaled**2, axis=1)))


def non_dominated(values: Array) -> NDArray[np.bool_]:
    """Rows that no other row beats: smaller or equal everywhere and smaller somewhere.

    Args:
        values: criteria, all to be made small, (K, c).
    """
    kept = np.ones(len(values), dtype=bool)
    for k, row in enumerate(values):
        if kept[k]:
            no_worse = np.all(values <= row, axis=1)
            kept[k] = not np.any(no_worse & np.any(values < row, axis=1))
    return kept


def front(values: Array, resolution: Array) -> Front:
    """The front, with one member for indistinguishable sets.

    Criteria are compared in steps of their resolution; of several sets with the same steps the one
    nearest to their lower corner stays (ε-dominance).

    Args:
        values: criteria, all to be made small and finite, (K, c), K above 0.
        resolution: differences that count, (c,).

    Source: Laumanns, Thiele, Deb and Zitzler, Evolutionary Computation 10 (2002) 263–282.
    """
    steps = np.floor(values / resolution)
    candidates = np.flatnonzero(non_dominated(steps))
    best: dict[tuple[float, ...], int] = {}
    corner = np.sum((values / resolution - steps) ** 2, axis=1)
    for k in candidates.tolist():
        key = tuple(steps[k].tolist())
        if key not in best or corner[k] < corner[best[key]]:
            best[key] = k
    chosen = np.array(list(best.values()), dtype=np.intp)
    chosen = chosen[non_dominated(values[chosen])]
    chosen = chosen[np.lexsort(values[chosen].T[::-1])]
    members = values[chosen]
    least = members.min(axis=0)
    usual = np.maximum(np.median(members, axis=0) - least, resolution)
    return Front(chosen, (members - least) / usual)
