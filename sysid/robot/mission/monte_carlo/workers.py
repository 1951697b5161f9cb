"""Workers for chunks: threads of this process, processes of this machine, or a cluster."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count

from sysid.errors import SysidError, UsageError
from sysid.robot.mission.monte_carlo.chunks import (
    BATCH_SIZE,
    BATCH_SIZE_ALONE,
    Chunk,
    ChunkResult,
    Runner,
    chunks,
)
from sysid.robot.mission.monte_carlo.cluster import on_cluster
from sysid.robot.mission.monte_carlo.compiled import CompiledRuns
from sysid.robot.mission.monte_carlo.processes import Processes
from sysid.robot.mission.monte_carlo.setup import Setup

PROCESSES = "processes"
"""The scheduler that starts processes on this machine."""


def results(
    setup: Setup, seeds: Sequence[int], scheduler: str | None, obstacle: str
) -> tuple[list[Chunk], Iterator[ChunkResult]]:
    """The chunks of a batch, and what becomes of them in this order.

    The same chunks of the same runs, whoever runs them: so is their result, bit for bit, on
    machines of one type.

    Args:
        scheduler: None for this process, ``processes``, or the address of a Dask scheduler.
        obstacle: why the runs cannot go side by side; empty where they can.

    Raises:
        UsageError: there is no such scheduler.
    """
    at_once = not obstacle
    parts = chunks(setup, seeds, BATCH_SIZE if at_once else BATCH_SIZE_ALONE)
    if scheduler is None and at_once:
        return parts, threaded(Runner.of(setup), parts)
    if scheduler in (None, PROCESSES):
        return parts, Processes(setup, at_once, min(cpu_count() or 1, len(parts))).results(parts)
    if scheduler is not None and "://" in scheduler:
        return parts, on_cluster(scheduler, setup, at_once, parts)
    raise UsageError(
        f"there is no scheduler {scheduler!r}: give {PROCESSES}, or the address of a Dask "
        "scheduler such as tcp://localhost:8786"
    )


def threaded(runner: Runner, parts: Sequence[Chunk]) -> Iterator[ChunkResult]:
    """Chunk after chunk in this process, one on each core at a time."""
    with ThreadPoolExecutor(cpu_count()) as pool:
        yield from pool.map(runner.run, parts)


def why_not_at_once(setup: Setup) -> str:
    """What keeps the runs of a setup from going side by side; empty for nothing.

    A law or a plant that takes its numbers for Python's, by ``if``, ``float`` or a function of
    NumPy, can be run and not traced.
    """
    for which in range(len(setup.plants)):
        runs = CompiledRuns(setup, which, 1)
        try:
            runs.check()
        except SysidError as error:
            return str(error)
        except Exception as error:  # whatever a law of another package raises on traced numbers
            first = str(error).strip().partition("\n")[0]
            return f"{_culprit(setup, which, error)} cannot be compiled ({first})"
    return ""


def _culprit(setup: Setup, which: int, error: BaseException) -> str:
    """The part whose method was running when it failed."""
    mission, variant = setup.mission, setup.plant_variants[which]
    parts = {
        type(getattr(mission, role)): f"the law of {role}"
        for role in ("guidance", "control", "navigation", "motion")
    }
    parts |= {type(s): f"the sensor {name}" for name, s in variant.scene.sensors.items()}
    plant = f"the plant {setup.plants[which].name}"
    parts |= {type(variant.robot): plant, type(setup.plants[which]): plant}
    culprit, place = "the loop of the mission", error.__traceback__
    while place is not None:
        culprit = parts.get(type(place.tb_frame.f_locals.get("self")), culprit)
        place = place.tb_next
    return culprit
