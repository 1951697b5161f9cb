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
        self,
        effects: Sequence[Effect],
        order: int,
        tracks: int,
        speed: Array,
        dt: float,
        inputs: int = 0,
        lag: Array | None = None,
    ) -> None:
        super().__init__(effects, order, tracks, speed, dt, inputs, lag)
        run = kernel if compiler() else Stepped
        self._null, self._kernel = (
            self.null,
            run(self.effects, order, width := max(self.inputs, tracks), dt, tracks),
        )
        sides = {e.id: self.sides(e) for e in self.effects} | {"core": range(tracks)}
        self._index = np.array(
            [
                [self._at(owner, name, sides[owner], i) for i in range(width)]
                for owner, name in self._kernel.rows
            ],
            dtype=np.int64,
        )

    def _at(self, owner: str, name: str, sides: Sequence[int], i: int) -> int:
        """The entry of a row of the kernel on its track i."""
        side = i if (owner, name) == ("core", "gain") else sides[i % len(sides)]
        return self.index[owner, name, side]

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
