"""Who runs the parts of a batch: threads of this process, processes of this machine, or a cluster.

The same parts give the same results, bit for bit on machines of one type.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, TypeVar
from uuid import uuid4

from sysid.errors import ModelError, UsageError
from sysid.processes import tied

PROCESSES = "processes"
"""The scheduler that starts processes on this machine."""

MOST_DEATHS = 3
"""Processes that may die over one part: then the part kills them, not the machine."""

Part = TypeVar("Part")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Job:
    """Work that a worker knows again by its name, so that it is set up once.

    Attributes:
        work: makes what runs a part of what is given, compiled where it can be.
        given: to be sent to another process.
    """

    work: Callable[[Any], Callable[[Any], Any]]
    given: Any = field(compare=False)
    name: str = field(default_factory=lambda: uuid4().hex)

    def results(self, parts: Sequence[Any], scheduler: str | None = None) -> Iterator[Any]:
        """What becomes of every part, in their order.

        Args:
            scheduler: None for threads of this process, ``processes``, or the address of a Dask
                scheduler, ``tcp://host:8786``, whose workers have this package.
        """
        if scheduler is None:
            return threaded(self.work(self.given), parts)
        if scheduler == PROCESSES:
            return _in_processes(self, parts)
        if "://" in scheduler:
            return _on_cluster(self, parts, scheduler)
        raise UsageError(
            f"there is no scheduler {scheduler!r}: give {PROCESSES}, or the address of a Dask "
            "scheduler such as tcp://localhost:8786"
        )


@lru_cache(maxsize=2)
def _set_up(job: Job) -> Callable[[Any], Any]:
    return job.work(job.given)


def run_on_worker(job: Job, part: Any) -> Any:
    """One part, on a worker."""
    return _set_up(job)(part)


def threaded(work: Callable[[Part], Result], parts: Sequence[Part]) -> Iterator[Result]:
    """Part after part in this process, one on each core at a time."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        yield from pool.map(work, parts)


def _in_processes(job: Job, parts: Sequence[Any]) -> Iterator[Any]:
    """A process that dies costs the time of its part: what is not there yet is run again."""
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    done = deaths = 0
    while done < len(parts):
        rest = parts[done:]
        count = max(2, min(os.cpu_count() or 1, len(rest)))  # a pool of one would be this process
        pool = Parallel(n_jobs=count, return_as="generator", pre_dispatch="all")  # ends at once
        calls = (delayed(tied)(os.getpid(), run_on_worker, job, part) for part in rest)
        try:
            for result in pool(calls):
                yield result
                done, deaths = done + 1, 0
        except TerminatedWorkerError:
            deaths += 1
            if deaths >= MOST_DEATHS:
                raise ModelError(
                    f"{MOST_DEATHS} processes died over one chunk of runs: there may be too "
                    "little memory; use fewer"
                ) from None


def _on_cluster(job: Job, parts: Sequence[Any], address: str) -> Iterator[Any]:
    """The cluster repeats what a dead worker had."""
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
        sent = client.scatter(job, broadcast=True)
        futures = [client.submit(run_on_worker, sent, part, pure=False) for part in parts]
        for future in futures:
            yield future.result()
