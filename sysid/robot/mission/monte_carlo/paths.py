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
from sysid.robot.mission.loop import Verdict
from sysid.robot.mission.monte_carlo.runs import chunks
from sysid.robot.mission.monte_carlo.varied_runs import VariedRuns, why_not_at_once


def paths_of(setup: Setup, seeds: Sequence[int]) -> list[Array]:
    """X, Y of runs from their starts to their ends, (n, 2) each [m].

    Side by side where they can be compiled; a run alone that fails has none.
    """
    if why_not_at_once(setup):
        return [path for seed in seeds for path in _alone(setup, seed)]
    choices = np.array([setup.choice(s) for s in seeds])
    paths: dict[int, Array] = {}
    for which, variant in enumerate(setup.plant_variants):
        runs = np.flatnonzero(choices == which).tolist()
        if not runs:
            continue
        seen: list[tuple[Array, Array]] = []

        def keep(_: Block, shown: Any, seen: list[tuple[Array, Array]] = seen) -> None:
            seen.append(shown)

        samples = variant.sampler.draw([seeds[k] for k in runs])
        # as many columns as the runs themselves had: what was compiled for them serves again
        VariedRuns(setup, which, max(BATCH_SIZE, len(runs))).of(samples, keep)
        verdict = np.concatenate([v for v, _ in seen])
        positions = np.concatenate([p for _, p in seen])
        for column, k in enumerate(runs):
            last = int(np.argmax(verdict[:, column] != Verdict.GOES_ON))
            paths[k] = positions[: last + 1, :2, column]
    return [paths[k] for k in sorted(paths)]


def _alone(setup: Setup, seed: int) -> list[Array]:
    try:
        log = setup.simulated(seed).log
    except ModelError:
        return []
    return [np.column_stack([log["x"], log["y"]])]


@dataclass(frozen=True, eq=False)
class RunPaths:
    """Where runs were at the same instants; those that failed are left out.

    Attributes:
        t: instants [s], (N,).
        pose: x, y [m], ψ [rad] of every run, (K, N, 3); one that has ended stays where it is.
        ended_s: when the last of them had ended [s].
    """

    t: Array
    pose: Array
    ended_s: float


def run_paths(setup: Setup, runs: int, seed: int = 0) -> RunPaths:
    """Drive so many runs and keep their paths, 24 bytes a sample of each.

    Raises:
        ModelError: the plant is none that could drive, or cannot be drawn.
    """
    seeds = run_seeds(seed, runs)
    parts = _single_paths(setup, seeds) if why_not_at_once(setup) else _all_paths(setup, seeds)
    t = max((t for t, _, _ in parts), key=len)
    poses = [np.pad(p, ((0, 0), (0, len(t) - p.shape[1]), (0, 0)), "edge") for _, p, _ in parts]
    return RunPaths(t, np.concatenate(poses), max(ended for _, _, ended in parts))


_Part = tuple[Array, Array, float]
"""Instants, poses and the last end of some runs."""


def _all_paths(setup: Setup, seeds: Sequence[int]) -> list[_Part]:
    batch_size = min(BATCH_SIZE, len(seeds))
    compiled = [VariedRuns(setup, k, batch_size) for k in range(len(setup.plants))]
    parts = []
    for chunk in chunks(setup, seeds, batch_size):
        runner, blocks = compiled[chunk.which], list[tuple[Array, Array]]()

        def keep(block: Block, shown: Any, blocks: list[tuple[Array, Array]] = blocks) -> None:
            blocks.append((block.t, shown[1]))

        figures = runner.of(runner.variant.sampler.draw(chunk.seeds), keep)
        kept = np.flatnonzero(figures.verdict != FAILED)
        t, positions = (np.concatenate(column) for column in zip(*blocks, strict=True))
        pose = np.moveaxis(positions[..., kept], -1, 0)
        parts.append((t, pose, float(figures.time_s[kept].max(initial=0.0))))
    return parts


def _single_paths(setup: Setup, seeds: Sequence[int]) -> list[_Part]:
    parts = []
    for seed in seeds:
        try:
            log = setup.simulated(seed).log
        except ModelError:
            continue
        pose = np.column_stack([log["x"], log["y"], log["psi"]])
        parts.append((log["t"], pose[None], float(log["t"][-1])))
    if not parts:
        raise ModelError("every run of the mission fails, because the plant or a law diverges")
    return parts
