"""Many runs of a mission: chunks to workers, their results joined; the paths of some of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import NamedTuple

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError, UsageError
from sysid.robot.mission.batch.figures import FAILED, Figures
from sysid.robot.mission.batch.pool import PROCESSES, Job
from sysid.robot.mission.batch.runner import BATCH_SIZE, BatchRunner, why_not_at_once
from sysid.robot.mission.batch.sampler import run_seeds
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.clearance import has_surfaces
from sysid.robot.mission.contracts import SteppablePlant
from sysid.robot.mission.loop import Verdict
from sysid.robot.mission.monte_carlo.mission_runs import MissionRuns
from sysid.robot.mission.monte_carlo.variance_shares import moments, shares
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
    setup, alone = given
    runners = [BatchRunner(setup, k, BATCH_SIZE, alone=alone) for k in range(len(setup.plants))]

    def run(chunk: Chunk) -> ChunkResult:
        sampler = setup.plant_variants[chunk.which].sampler
        samples, varying = sampler.draw(chunk.seeds), sampler.varying
        figures = runners[chunk.which].of(samples).figures
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
    job = Job(runner_of, (setup, bool(alone)))
    coming = job.results(parts, PROCESSES if alone and scheduler is None else scheduler)
    for chunk, result in zip(parts, coming, strict=True):
        chunk_results.append(result)
        if progress is not None:
            progress(len(chunk.runs))
    nothing = np.zeros(())
    time = sum((r.time for r in chunk_results), nothing)
    error = sum((r.error for r in chunk_results), nothing)
    order = np.argsort([k for chunk in parts for k in chunk.runs])
    columns = zip(*(r.figures for r in chunk_results), strict=True)
    varying = setup.plant_variants[0].sampler.varying
    same = len(setup.plants) == 1  # the numbers of several plants are not the same numbers
    return MissionRuns(
        seed=seed,
        seconds=perf_counter() - began,
        goal=mission.goal,
        obstacles=has_surfaces(mission.scene()),
        vary=setup.varied,
        seeds=tuple(seeds),
        figures=Figures(*(np.concatenate(column)[order] for column in columns)),
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


@dataclass(frozen=True, eq=False)
class RunPaths:
    """Where runs were at the same instants.

    Attributes:
        t: instants [s], (N,).
        pose: x, y [m], ψ [rad] of every run, (K, N, 3); one that has ended stays where it is.
        ended_s: when the last of them had ended [s].
    """

    t: Array
    pose: Array
    ended_s: float


def run_paths(setup: Setup, runs: int, seed: int = 0) -> RunPaths:
    """Drive so many runs and keep the paths of those that do not fail, 24 bytes a sample each."""
    paths = _driven(setup, run_seeds(seed, runs), min(BATCH_SIZE, runs), failed=False)
    if not paths:
        raise ModelError("every run of the mission fails, because the plant or a law diverges")
    t = max((t for t, _ in paths), key=len)
    poses = [np.pad(pose, ((0, len(t) - len(pose)), (0, 0)), "edge") for _, pose in paths]
    return RunPaths(t, np.array(poses), max(float(t[-1]) for t, _ in paths))


def paths_of(setup: Setup, seeds: Sequence[int]) -> list[Array]:
    """X, Y of runs from their starts to their ends, (n, 2) each [m].

    Side by side where they can be compiled; a run alone that fails has none.
    """
    # as many columns as the runs themselves had: what was compiled for them serves again
    return [pose[:, :2] for _, pose in _driven(setup, seeds, BATCH_SIZE, failed=True)]


RunPath = tuple[Array, Array]
"""Instants of a run [s], (n,), and its poses x, y [m], ψ [rad], (n, 3)."""


def _driven(setup: Setup, seeds: Sequence[int], batch_size: int, failed: bool) -> list[RunPath]:
    """The paths of runs in their order; those that fail side by side where asked for."""
    alone, paths = bool(why_not_at_once(setup)), dict[int, RunPath]()
    runners = [BatchRunner(setup, k, batch_size, alone=alone) for k in range(len(setup.plants))]
    for chunk in chunks(setup, seeds, batch_size):
        runner = runners[chunk.which]
        figures, t, rows = runner.of(runner.variant.sampler.draw(chunk.seeds), recorded=True)
        for column, k in enumerate(chunk.runs):
            ended = figures.time_s[column]
            if np.isfinite(ended) and (failed or figures.verdict[column] != FAILED):
                count = int(np.searchsorted(t, ended)) + 1
                paths[k] = t[:count], rows[:count, :, column]
    return [paths[k] for k in sorted(paths)]
