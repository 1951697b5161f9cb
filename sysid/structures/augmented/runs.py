"""Free-run errors of an augmented structure, as a problem to solve."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array
from sysid.fitting.problem import Data
from sysid.fitting.run_errors import RunErrors

if TYPE_CHECKING:
    from sysid.structures.augmented.structure import Augmented


class ChainRuns(RunErrors):
    """y − ŷ of the free run.

    Each run starts in the steady motion of the record's first measurement, so that there
    are no initial states to estimate.

    Args:
        data: (u, y) of each record.
    """

    def __init__(self, structure: "Augmented", data: Data) -> None:
        self._structure = structure
        n = structure.n_core + structure.n_effect_parameters
        super().__init__(n, data, 0, scales=np.ones(structure.ny))

    def runs(self, p: Array) -> list[Array]:
        return [self._structure.predict(p, u, y, 1, 1) for u, y in self.data]

    def tangents(self, p: Array) -> Iterator[Array]:
        """By central differences."""
        for u, y in self.data:
            yield self._structure.gradients(p, u, y).swapaxes(1, 2)
