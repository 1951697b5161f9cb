"""Many runs of a mission: chunks to workers, their results joined."""

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import NamedTuple

import numpy as np

from sysid.data.record import Array
from sysid.errors import UsageError
from sysid.robot.mission.batch.pool import PROCESSES, Job
from sysid.robot.mission.batch.runner import BATCH_SIZE, FAILED
from sysid.robot.mission.batch.sampler import run_seeds
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.clearance import has_surfaces
from sysid.robot.mission.contracts import SteppablePlant
from sysid.robot.mission.loop import Verdict
from sysid.robot.mission.monte_carlo.mission_runs import MissionRuns
from sysid.robot.mission.monte_carlo.variance_shares import moments, shares
from sysid.robot.mission.monte_carlo.varied_runs import (
    Figures,
    VariedRuns,
    figures_alone,
    joined,
    stacked,
    why_not_at_once,
)
from sysid.robot.mission.spec import Mission
from sysid.structures.model import Model

BATCH_SIZE_ALONE = 16
"""Runs of a chunk where they go one after the other: little is lost with a worker."""


class Chunk(NamedTuple):
    """Some runs of one plant."""

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
    time: Array
    error: Array


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


def runner_of(given: tuple[Setup, bool]) -> Callable[[Chunk], ChunkResult]:
    """What runs the chunks of a setup to their ends, all runs of one side by side, or one after
    the other in NumPy."""
    setup, at_once = given
    plants = range(len(setup.plants)) if at_once else ()
    compiled = [VariedRuns(setup, k, BATCH_SIZE) for k in plants]

    def run(chunk: Chunk) -> ChunkResult:
        sampler = setup.plant_variants[chunk.which].sampler
        samples, varying = sampler.draw(chunk.seeds), sampler.varying
        if compiled:
            figures = compiled[chunk.which].of(samples)
        else:
            figures = stacked([figures_alone(setup, s) for s in chunk.seeds])
        error = figures.final_error_m(setup.mission.goal)
        arrived: Array = figures.verdict == Verdict.ARRIVED
        ended: Array = figures.verdict != FAILED
        return ChunkResult(
            figures,
            int(samples.redrawn.sum()),
            int(samples.pulled.sum()),
            moments(samples.inputs, varying, figures.time_s, arrived),
            moments(samples.inputs, varying, error, ended),
        )

    return run


MOST_RUNS = 10_000_000
"""A batch of more runs would not end while somebody waits, and adds nothing."""

_ALONE = "The runs went one after the other, in processes: {}."

Progress = Callable[[int], None]
"""Takes how many more runs are done."""


def simulate_runs(
    mission: Mission,
    plants: Sequence[Model | SteppablePlant],
    runs: int,
    seed: int = 0,
    vary: Sequence[str] | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> MissionRuns:
    """Drive a mission many times, with what is not known for sure drawn for every run.

    All runs of a chunk go side by side in one compiled loop over the laws and the plant that a
    single run takes; their draws are made by NumPy from a seed a run.

    Args:
        mission: what to do, and, in its ``vary``, what differs from run to run.
        plants: fitted models, or plants that are the same in every run; the first is nominal, and
            the others drive where models vary.
        seed: of the batch; run k of it has the seed ``run_seeds(seed, runs)[k]``.
        vary: names of what varies, in the sizes of the mission; None for what the mission says.
        scheduler: who runs the chunks: None for threads of this process, ``processes``, or the
            address of a Dask scheduler.

    Returns:
        Outcomes with intervals, quantiles, what matters, and the worst runs.

    Raises:
        UsageError: a name or a number makes no sense.
        ModelError: the plant is none that could drive, or cannot be drawn.
    """
    if not 1 <= runs <= MOST_RUNS:
        raise UsageError(f"{runs} runs are impossible; give a number from 1 to {MOST_RUNS}")
    began = perf_counter()
    setup = Setup.of(mission, plants, vary)
    seeds = run_seeds(seed, runs)
    alone = why_not_at_once(setup)
    parts = chunks(setup, seeds, BATCH_SIZE_ALONE if alone else BATCH_SIZE)
    chunk_results: list[ChunkResult] = []
    job = Job(runner_of, (setup, not alone))
    coming = job.results(parts, PROCESSES if alone and scheduler is None else scheduler)
    for chunk, result in zip(parts, coming, strict=True):
        chunk_results.append(result)
        if progress is not None:
            progress(len(chunk.runs))
    nothing = np.zeros(())
    time = sum((r.time for r in chunk_results), nothing)
    error = sum((r.error for r in chunk_results), nothing)
    order = np.argsort([k for chunk in parts for k in chunk.runs])
    varying = setup.plant_variants[0].sampler.varying
    same = len(setup.plants) == 1  # the numbers of several plants are not the same numbers
    return MissionRuns(
        seed=seed,
        seconds=perf_counter() - began,
        goal=mission.goal,
        obstacles=has_surfaces(mission.scene()),
        vary=setup.varied,
        seeds=tuple(seeds),
        figures=joined([r.figures for r in chunk_results], order),
        redrawn=sum(r.redrawn for r in chunk_results),
        time_drivers=shares(time, varying) if same else None,
        error_drivers=shares(error, varying) if same else None,
        notes=(
            *setup.notes(
                sum(r.redrawn for r in chunk_results), sum(r.pulled for r in chunk_results), runs
            ),
            *([_ALONE.format(alone)] if alone else []),
        ),
    )
