"""All second processes: each ends when the one that started it has ended, however that came.

Nothing else of the project starts one (a test looks).
"""

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from sysid import launcher

INTERVAL = 0.5
"""How often a process of Python asks whether its parent is still there [s]."""

MOST_PRINTED = 1 << 20
"""Bytes that are taken of what a command prints."""

TooLong = subprocess.TimeoutExpired
Command = subprocess.Popen[bytes]

_WATCH = "ends with the parent"

Result = TypeVar("Result")


class Ended(NamedTuple):
    """A command that has ended: its exit code, and what it printed."""

    code: int
    out: str
    err: str


def run(command: Sequence[str], folder: Path, seconds: float, foreign: bool = False) -> Ended:
    """Run a command to its end, within the limits of :mod:`sysid.launcher`.

    What it started itself and left behind is ended, too.

    Args:
        folder: where it runs, and where its temporary files go.
        foreign: whether it is code of somebody else: it gets no network.

    Raises:
        TimeoutError: it takes longer.
    """
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        with started(command, folder, out=out, err=err, foreign=foreign) as process:
            try:
                code = process.wait(seconds)
            except TooLong:
                raise TimeoutError from None
        printed = []
        for stream in (out, err):
            stream.seek(0)
            printed.append(stream.read(MOST_PRINTED).decode("utf-8", "replace"))
    return Ended(code, *printed)


@contextmanager
def started(
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str] | None = None,
    out: Any = subprocess.DEVNULL,
    err: Any = subprocess.DEVNULL,
    foreign: bool = False,
) -> Iterator[Command]:
    """A command that runs while the context lasts, and what it started with it."""
    launch = [sys.executable, "-I", "-S", launcher.__file__, str(os.getpid()), str(int(foreign))]
    process = subprocess.Popen(
        [*launch, *command],
        cwd=folder,
        env={**(environment or os.environ), "TMPDIR": str(folder)},
        stdin=subprocess.DEVNULL,
        stdout=out,
        stderr=err,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        with suppress(OSError, AttributeError):  # Windows knows no groups
            os.killpg(process.pid, signal.SIGKILL)
        process.kill()
        process.wait()


def tied(parent: int, function: Callable[..., Result], *arguments: Any) -> Result:
    """The result of a function in a process that ends with its parent."""
    end_with(parent)
    return function(*arguments)


def end_with(parent: int) -> None:
    """Have this process end as soon as the process of this id is no longer its parent."""
    watched = any(thread.name == _WATCH for thread in threading.enumerate())
    if not watched and parent != os.getpid():  # a pool may serve a call itself
        threading.Thread(target=_watch, args=(parent,), name=_WATCH, daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(INTERVAL)
    os._exit(1)
