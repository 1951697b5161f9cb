"""Free-run errors of an augmented structure, as a problem to solve."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array
from sysid.fitting.problem import Problem
from sysid.structures.linear.predictor import HUGE

if TYPE_CHECKING:
    from sysid.structures.augmented.structure import Augmented


class ChainRuns(Problem):
    """y − ŷ of the free run, output after output, record after record.

    Each run starts in the steady motion of the record's first measurement, so that there
    are no initial states to estimate.

    Args:
        structure: the chain.
        data: (u, y) of each record.
    """

    def __init__(self, structure: "Augmented", data: Sequence[tuple[Array, Array]]) -> None:
        self._structure, self._data = structure, data
        per_core = 2 * structure.order
        n = structure.ny * per_core + structure.n_effect_parameters
        self.index = np.arange(n)
        self.n_initial = 0
        self.lengths = tuple(len(y) for _, y in data for _ in range(structure.ny))
        self.channels = tuple(i for _ in data for i in range(structure.ny))

    def residual(self, p: Array) -> Array:
        s = self._structure
        with np.errstate(all="ignore"):
            e = np.concatenate([s.errors(p, u, y, 1).T.ravel() for u, y in self._data])
        if not np.all(np.isfinite(e)) or np.max(np.abs(e), initial=0.0) > HUGE:
            return np.full(len(e), HUGE)
        return e

    def jacobian(self, p: Array) -> Array:
        """Their derivative, by central differences."""
        with np.errstate(all="ignore"):
            parts = [self._structure.slopes(p, u, y) for u, y in self._data]
        columns = np.concatenate([np.moveaxis(d, 1, 0).reshape(-1, len(p)) for d in parts])
        return np.asarray(-np.nan_to_num(columns, nan=0.0, posinf=HUGE, neginf=-HUGE))
