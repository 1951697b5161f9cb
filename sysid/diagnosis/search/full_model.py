"""The full model: every effect of the catalogue in one compiled simulation.

Absent effects sit at their null values and cost nothing, so that trying a candidate means freeing
a few parameters. Candidates, starts and shifted copies for slopes are shared among the cores.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np

from sysid.data.record import Array
from sysid.diagnosis.search.parameter_table import ParameterTable
from sysid.diagnosis.search.prepared import Data
from sysid.effects.base import Effect
from sysid.runners.native import compiler
from sysid.structures.augmented.batch import Stepped
from sysid.structures.augmented.kernel import kernel

WORTH_A_THREAD = 20000
"""Samples to simulate from which a second thread saves more than it costs."""


class FullModel(ParameterTable):
    """All effects around cores of one order, for a number of tracks."""

    def __init__(
        self, effects: Sequence[Effect], order: int, tracks: int, speed: Array, dt: float
    ) -> None:
        super().__init__(effects, order, tracks, speed, dt)
        run = kernel if compiler() else Stepped
        self._null, self._kernel = self.null, run(self.effects, order, tracks, dt)
        shared = {e.id for e in self.effects if e.shared}
        self._index = np.array(
            [
                [self.index[owner, name, -1 if owner in shared else i] for i in range(tracks)]
                for owner, name in self._kernel.rows
            ],
            dtype=np.int64,
        )

    def run(self, q: Array, data: Data) -> Array:
        """Measurements for parameter vectors q (batch, parameters), shape (batch, M, tracks)."""
        q = np.atleast_2d(q)
        parts = min(os.cpu_count() or 1, len(q), 1 + len(q) * len(data.y) // WORTH_A_THREAD)

        def one(rows: Array) -> Array:
            return self._kernel.run(rows, self._null, self._index, data.signals)

        if parts == 1:
            return one(q)
        return np.concatenate(list(_threads().map(one, np.array_split(q, parts))))


@cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count())
