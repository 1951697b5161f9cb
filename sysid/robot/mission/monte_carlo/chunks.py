"""Runs in chunks of fixed size: inputs and results of a worker."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sysid.data.record import Array
from sysid.robot.mission.batch.runner import BATCH_SIZE, FAILED
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.loop import Verdict
from sysid.robot.mission.monte_carlo.figures import Figures, stacked
from sysid.robot.mission.monte_carlo.variance_shares import Moments, moments
from sysid.robot.mission.monte_carlo.varied_runs import VariedRuns, figures_alone

BATCH_SIZE_ALONE = 16
"""Runs of a chunk where they go one after the other: little is lost with a worker."""


class Chunk(NamedTuple):
    """Some runs of one plant.

    Attributes:
        runs: numbers of the runs in the batch.
    """

    which: int
    runs: tuple[int, ...]
    seeds: tuple[int, ...]


class ChunkResult(NamedTuple):
    """What became of a chunk.

    Attributes:
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
    parts = []
    for which in range(len(setup.plants)):
        indices = np.flatnonzero(choices == which).tolist()
        for at in range(0, len(indices), size):
            runs = indices[at : at + size]
            parts.append(Chunk(which, tuple(runs), tuple(seeds[k] for k in runs)))
    return parts


@dataclass(frozen=True, eq=False)
class Runner:
    """Runs chunks of a setup, all runs of one at once, or one after the other in NumPy.

    Attributes:
        compiled: for each plant, its runs side by side; empty: one after the other.
    """

    setup: Setup
    compiled: tuple[VariedRuns, ...]

    @staticmethod
    def of(setup: Setup, at_once: bool = True) -> "Runner":
        """A runner of compiled runs, or of single ones."""
        plants = range(len(setup.plants)) if at_once else ()
        return Runner(setup, tuple(VariedRuns(setup, k, BATCH_SIZE) for k in plants))

    def run(self, chunk: Chunk) -> ChunkResult:
        """The runs of a chunk, to their ends."""
        sampler = self.setup.plant_variants[chunk.which].sampler
        samples, varying = sampler.draw(chunk.seeds), sampler.varying
        if self.compiled:
            figures = self.compiled[chunk.which].of(samples)
        else:
            figures = stacked([figures_alone(self.setup, s) for s in chunk.seeds])
        error = figures.final_error_m(self.setup.mission.goal)
        arrived: Array = figures.verdict == Verdict.ARRIVED
        ended: Array = figures.verdict != FAILED
        return ChunkResult(
            figures,
            int(samples.redrawn.sum()),
            int(samples.pulled.sum()),
            moments(samples.inputs, varying, figures.time_s, arrived),
            moments(samples.inputs, varying, error, ended),
        )


def runner_of(given: tuple[Setup, bool]) -> Callable[[Chunk], ChunkResult]:
    """What runs the chunks of a setup, side by side or not, on a worker."""
    return Runner.of(*given).run
