"""A second process for work beside this one's, which drawing is: Python draws on one core only."""

import os
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from types import TracebackType
from typing import Self, TypeVar

T = TypeVar("T")


class SecondProcess:
    """Calls of functions in a process that is started ahead; in this one where there is but a core.

    Args:
        ready: called there as soon as it is up: what takes long to import.
    """

    def __init__(self, ready: Callable[[], object]) -> None:
        self._ready = ready
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)

    def start(self) -> None:
        """Start the process, once; its imports go on beside what follows here.

        Where a system lends no further process or semaphore, there is none.
        """
        if self._pool is not None or (os.cpu_count() or 1) < 2:
            return
        try:
            self._pool = ProcessPoolExecutor(1, get_context("spawn"))
            self._pool.submit(self._ready)
        except (OSError, ImportError, NotImplementedError):
            self._pool = None

    def call(self, function: Callable[[], T]) -> Callable[[], T]:
        """What gives the result of a function, which is run there if the process was started.

        Args:
            function: can be sent there: a function of a module, or a ``partial`` of one.
        """
        if self._pool is None:
            return function
        try:
            sent: Future[T] = self._pool.submit(function)
        except BrokenProcessPool:
            return function

        def result() -> T:
            try:
                return sent.result()
            except BrokenProcessPool:  # it could not start, or was ended: do it here
                return function()

        return result
