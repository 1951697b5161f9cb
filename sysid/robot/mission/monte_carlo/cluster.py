"""Chunks of runs on a Dask cluster."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any
from uuid import uuid4

from sysid.errors import UsageError
from sysid.robot.mission.monte_carlo.chunks import Chunk, ChunkResult, Runner
from sysid.robot.mission.monte_carlo.setup import Setup


@dataclass(frozen=True)
class Job:
    """A setup as workers know it again: by its name alone.

    Attributes:
        at_once: whether the runs of a chunk go side by side.
    """

    name: str
    at_once: bool
    setup: Setup = field(compare=False)


@lru_cache(maxsize=2)
def _runner(job: Job) -> Runner:
    """What runs a job's chunks on a worker, compiled once."""
    return Runner.of(job.setup, job.at_once)


def run_on_worker(job: Job, chunk: Chunk) -> ChunkResult:
    """One chunk, on a worker."""
    return _runner(job).run(chunk)


def on_cluster(
    address: str, setup: Setup, at_once: bool, parts: Sequence[Chunk]
) -> Iterator[ChunkResult]:
    """What becomes of every chunk, in their order; the cluster repeats what a dead worker had.

    Args:
        address: of the scheduler, ``tcp://host:8786``; its workers have this package.
        at_once: whether the runs of a chunk go side by side.

    Raises:
        UsageError: Dask is missing, or nothing answers there.
    """
    try:
        from distributed import Client
    except ImportError:
        raise UsageError(
            "a cluster needs the package dask[distributed]: pip install 'sysid-workbench[dask]', "
            "or use processes"
        ) from None
    try:
        client: Any = Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise UsageError(
            f"no Dask scheduler answers at {address} ({error}): start one, or use processes"
        ) from None
    with client:
        job = client.scatter(Job(uuid4().hex, at_once, setup.plain()), broadcast=True)
        futures = [client.submit(run_on_worker, job, chunk, pure=False) for chunk in parts]
        for future in futures:
            yield future.result()
