"""The paths of some runs, for pictures and for comparison with a measured one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.record import Array
from sysid.errors import ModelError
from sysid.robot.mission.batch.clock import Block
from sysid.robot.mission.batch.runner import BATCH_SIZE, FAILED
from sysid.robot.mission.batch.sampler import run_seeds
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.monte_carlo.runs import chunks
from sysid.robot.mission.monte_carlo.varied_runs import VariedRuns, why_not_at_once


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


Path = tuple[Array, Array]
"""Instants of a run [s], (n,), and its poses x, y [m], ψ [rad], (n, 3)."""


def _driven(setup: Setup, seeds: Sequence[int], batch_size: int, failed: bool) -> list[Path]:
    """The paths of runs in their order; those that fail side by side where asked for."""
    if why_not_at_once(setup):
        return [path for seed in seeds for path in _alone(setup, seed)]
    compiled = [VariedRuns(setup, k, batch_size) for k in range(len(setup.plants))]
    paths: dict[int, Path] = {}
    for chunk in chunks(setup, seeds, batch_size):
        runner, blocks = compiled[chunk.which], list[tuple[Array, Array]]()

        def keep(block: Block, shown: Any, blocks: list[tuple[Array, Array]] = blocks) -> None:
            blocks.append((block.t, shown[1]))

        figures = runner.of(runner.variant.sampler.draw(chunk.seeds), keep)
        t, positions = (np.concatenate(column) for column in zip(*blocks, strict=True))
        for column, k in enumerate(chunk.runs):
            if failed or figures.verdict[column] != FAILED:
                count = int(np.searchsorted(t, figures.time_s[column])) + 1
                paths[k] = t[:count], positions[:count, :, column]
    return [paths[k] for k in sorted(paths)]


def _alone(setup: Setup, seed: int) -> list[Path]:
    try:
        log = setup.simulated(seed).log
    except ModelError:
        return []
    return [(log["t"], np.column_stack([log["x"], log["y"], log["psi"]]))]
