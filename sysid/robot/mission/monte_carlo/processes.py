"""Chunks of runs on processes of this machine; a process that dies costs no run."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from typing import Any

from sysid import processes
from sysid.errors import ModelError
from sysid.robot.mission.monte_carlo.chunks import Chunk, ChunkResult, Runner
from sysid.robot.mission.monte_carlo.setup import Setup

MOST_DEATHS = 3
"""Processes that may die over one chunk: then the chunk kills them, not the machine."""


@dataclass(eq=False)
class _Worker:
    """A process, the line to it, and the chunk that it has."""

    process: Any
    line: "Connection[Any, Any]"
    busy: int | None = None


@dataclass(eq=False)
class Processes:
    """Processes that serve chunks, as many as are asked for; those that die are replaced.

    Attributes:
        at_once: whether the runs of a chunk go side by side.
        workers: those that live.
    """

    setup: Setup
    at_once: bool
    count: int
    workers: list[_Worker] = field(default_factory=list)

    def results(self, parts: Sequence[Chunk]) -> Iterator[ChunkResult]:
        """What becomes of every chunk, in their order.

        Raises:
            ModelError: a chunk cannot be run, or its processes die again and again.
        """
        waiting, deaths = list(range(len(parts)))[::-1], [0] * len(parts)
        done: dict[int, ChunkResult] = {}
        yielded = 0
        try:
            while yielded < len(parts):
                self._hand_out(parts, waiting)
                for worker in self._heard():
                    self._take(worker, waiting, deaths, done)
                while yielded in done:
                    yield done.pop(yielded)
                    yielded += 1
        finally:
            self.close()

    def close(self) -> None:
        """End all processes."""
        for worker in self.workers:
            worker.process.kill()
            worker.process.join()
            worker.line.close()
        self.workers.clear()

    def _hand_out(self, parts: Sequence[Chunk], waiting: list[int]) -> None:
        """A chunk to every process that has none, and a new process where one is missing."""
        while len(self.workers) < min(self.count, len(waiting) + len(self.workers)):
            self.workers.append(self._started())
        for worker in self.workers:
            if worker.busy is None and waiting:
                worker.busy = waiting.pop()
                try:
                    worker.line.send(parts[worker.busy])
                except OSError:  # it died idle: its end of the line says so
                    continue

    def _started(self) -> _Worker:
        our_end, worker_end = Pipe()
        process = processes.worker(_serve, worker_end, self.setup.plain(), self.at_once)
        worker_end.close()
        return _Worker(process, our_end)

    def _heard(self) -> list[_Worker]:
        """Processes that have said something, or died."""
        by_line = {id(worker.line): worker for worker in self.workers}
        return [by_line[id(line)] for line in wait([worker.line for worker in self.workers])]

    def _take(
        self,
        worker: _Worker,
        waiting: list[int],
        deaths: list[int],
        done: dict[int, ChunkResult],
    ) -> None:
        chunk = worker.busy
        try:
            answer = worker.line.recv()
        except (EOFError, OSError):  # it was killed: its chunk waits again
            self.workers.remove(worker)
            worker.process.join()
            worker.line.close()
            if chunk is not None:
                deaths[chunk] += 1
                if deaths[chunk] >= MOST_DEATHS:
                    raise ModelError(
                        f"{MOST_DEATHS} processes died over one chunk of runs (exit code "
                        f"{worker.process.exitcode}): there may be too little memory; use fewer"
                    ) from None
                waiting.append(chunk)
            return
        if isinstance(answer, BaseException):
            raise answer
        if chunk is not None:
            done[chunk], worker.busy = answer, None


def _serve(line: "Connection[Any, Any]", setup: Setup, at_once: bool) -> None:
    """Run chunk after chunk until the line is cut."""
    runner = Runner.of(setup, at_once)
    while True:
        try:
            chunk = line.recv()
        except (EOFError, OSError, KeyboardInterrupt):
            return
        try:
            line.send(runner.run(chunk))
        except Exception as error:  # whatever it is, the one who waits for it has to hear
            line.send(error)
