"""Who runs the chunks changes nothing, and one that is killed costs time alone."""

import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mission_cases import Robot, goal

from benchmarks.agreement import agreement
from sysid.errors import ModelError, UsageError
from sysid.robot.mission.batch.pool import PROCESSES, Job
from sysid.robot.mission.batch.runner import why_not_at_once
from sysid.robot.mission.batch.sampler import run_seeds
from sysid.robot.mission.batch.setup import Setup
from sysid.robot.mission.contracts import Command, ControlInputs, Scene
from sysid.robot.mission.monte_carlo.runs import (
    ChunkResult,
    chunks,
    runner_of,
    simulate_runs,
)
from sysid.robot.mission.settings import ControlSettings

MISSION = goal(0.3, 0.1)


def same(one: list[ChunkResult], other: list[ChunkResult]) -> None:
    """Equal to the last bit."""
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        for x, y in zip((*a.figures, a.time), (*b.figures, b.time), strict=True):
            np.testing.assert_array_equal(x, y)


@dataclass(frozen=True)
class Deadly:
    """Work that kills its own process the first time that it meets one part."""

    folder: Path

    def __call__(self, part: int) -> int:
        mark = self.folder / "killed"
        if part == 2 and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return part * part


@pytest.mark.slow
def test_a_process_that_is_killed_costs_no_run(tmp_path: Path) -> None:
    assert list(Job(Deadly, tmp_path).results(range(6), PROCESSES)) == [0, 1, 4, 9, 16, 25]
    assert (tmp_path / "killed").exists()


def always_killed(_: None) -> Callable[[int], None]:
    return lambda part: os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.slow
def test_a_part_that_kills_every_process_is_given_up() -> None:
    with pytest.raises(ModelError, match="3 processes died over one chunk of runs"):
        list(Job(always_killed, None).results(range(2), PROCESSES))


@pytest.mark.slow
def test_processes_give_the_same() -> None:
    setup = Setup.of(MISSION, [Robot()])
    parts = chunks(setup, run_seeds(2, 12), 3)
    here = list(map(runner_of((setup, True)), parts))
    same(list(Job(runner_of, (setup, True)).results(parts, PROCESSES)), here)


def test_a_cluster_gives_the_same() -> None:
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    setup = Setup.of(MISSION, [Robot()])
    parts = chunks(setup, run_seeds(2, 6), 3)
    here = list(map(runner_of((setup, False)), parts))
    quiet = {"dashboard_address": None, "silence_logs": 50}
    with distributed.LocalCluster(1, processes=False, threads_per_worker=1, **quiet) as cluster:
        job = Job(runner_of, (setup, False))
        same(list(job.results(parts, cluster.scheduler_address)), here)


class Stubborn(ControlSettings):
    """A law that takes its numbers for Python's."""

    def start(self, scene: Scene, xp: Any) -> tuple[()]:
        return ()

    def step(
        self, state: tuple[()], inputs: ControlInputs, dt: float, xp: Any
    ) -> tuple[tuple[()], Command]:
        return (), Command(0.3 if float(inputs.references.speed) > 0.0 else 0.0, 0.0)


def test_a_law_that_cannot_be_compiled_is_named_and_runs_all_the_same() -> None:
    mission = goal(0.3, 0.0, control=Stubborn())
    setup = Setup.of(mission, [Robot()])
    assert why_not_at_once(setup).startswith("the law of control cannot be compiled (")
    assert why_not_at_once(Setup.of(MISSION, [Robot()])) == ""
    batch = simulate_runs(mission, [Robot()], 4, seed=1)
    assert "one after the other, in processes: the law of control" in batch.notes[-1]
    assert agreement(setup, batch.seeds, batch.figures).largest == 0.0


@pytest.mark.parametrize("kind", ["ekf", "ukf", "compass", "finite-model"])
def test_a_filter_with_default_sensors_is_compiled(kind: str) -> None:
    mission = goal(0.3, 0.0, navigation={"kind": kind})
    setup = Setup.of(mission, [Robot()])
    assert "noise" in setup.varied
    assert why_not_at_once(setup) == ""


@dataclass(frozen=True)
class Impatient(Robot):
    """A plant that takes its numbers for Python's."""

    def step(self, x: Any, u: Any) -> Any:
        return super().step(x, np.array([float(v) for v in u]))


def test_a_plant_that_cannot_be_compiled_is_named() -> None:
    setup = Setup.of(MISSION, [Impatient()])
    assert why_not_at_once(setup).startswith("the plant Impatient cannot be compiled (")


def test_an_unknown_scheduler_is_refused() -> None:
    with pytest.raises(UsageError, match="there is no scheduler 'cloud': give processes"):
        simulate_runs(MISSION, [Robot()], 4, scheduler="cloud")
