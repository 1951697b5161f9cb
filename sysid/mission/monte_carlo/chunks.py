"""Runs in chunks of fixed size: what a worker is given, and what it gives back."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sysid.data.record import Array
from sysid.mission.loop import Verdict
from sysid.mission.monte_carlo.compiled import CompiledRuns
from sysid.mission.monte_carlo.draws import Draws
from sysid.mission.monte_carlo.drivers import Moments, moments
from sysid.mission.monte_carlo.figures import (
    FAILED,
    Figures,
    stacked,
)
from sysid.mission.monte_carlo.setup import Setup, figures_alone

LANES = 1024
"""Runs of a chunk. Their states fit into a core's cache, and a call of compiled code costs little
beside them. The result of a run does not depend on it beyond rounding."""

LANES_ALONE = 16
"""Runs of a chunk where they go one after the other: little is lost with a worker."""


class Chunk(NamedTuple):
    """Some runs of one plant.

    Attributes:
        which: the plant.
        runs: numbers of the runs in the batch.
        seeds: of the runs.
    """

    which: int
    runs: tuple[int, ...]
    seeds: tuple[int, ...]


class ChunkResult(NamedTuple):
    """What became of a chunk.

    Attributes:
        figures: of its runs.
        redrawn: draws that were not feasible.
        pulled: runs whose plant was drawn less far than its errors say.
        time, error: sums about the time of runs that arrived and the final error of all.
    """

    figures: Figures
    redrawn: int
    pulled: int
    time: Moments
    error: Moments


def chunks(setup: Setup, seeds: Sequence[int], size: int) -> list[Chunk]:
    """All runs, plant by plant, in chunks of one size but for the last of each plant."""
    choices = np.array([setup.choice(s) for s in seeds])
    found = []
    for which in range(len(setup.plants)):
        own = np.flatnonzero(choices == which).tolist()
        for at in range(0, len(own), size):
            runs = own[at : at + size]
            found.append(Chunk(which, tuple(runs), tuple(seeds[k] for k in runs)))
    return found


@dataclass(frozen=True, eq=False)
class Runner:
    """Runs chunks of a setup, all runs of one at once, or one after the other in NumPy.

    Attributes:
        setup: mission, plants, what varies.
        compiled: for each plant, its runs side by side; empty: one after the other.
    """

    setup: Setup
    compiled: tuple[CompiledRuns, ...]

    @staticmethod
    def of(setup: Setup, at_once: bool = True) -> "Runner":
        """A runner of compiled runs, or of single ones."""
        plants = range(len(setup.plants)) if at_once else ()
        return Runner(setup, tuple(CompiledRuns(setup, k, LANES) for k in plants))

    def run(self, chunk: Chunk) -> ChunkResult:
        """The runs of a chunk, to their ends."""
        drawing = self.setup.drivers[chunk.which].drawing
        draws = drawing.draw(chunk.seeds)
        if self.compiled:
            figures = self.compiled[chunk.which].figures(draws)
        else:
            figures = stacked([figures_alone(self.setup, s) for s in chunk.seeds])
        return self._summed(draws, figures, drawing.varying)

    def _summed(
        self, draws: Draws, figures: Figures, varying: Sequence[tuple[str, tuple[int, ...]]]
    ) -> ChunkResult:
        error = figures.final_error_m(self.setup.mission.goal)
        arrived: Array = figures.verdict == Verdict.ARRIVED
        ended: Array = figures.verdict != FAILED
        return ChunkResult(
            figures,
            int(draws.redrawn.sum()),
            int(draws.pulled.sum()),
            moments(draws.inputs, varying, figures.time_s, arrived),
            moments(draws.inputs, varying, error, ended),
        )
