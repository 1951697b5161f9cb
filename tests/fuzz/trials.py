"""One input given to one parser: nothing, a sentence, or what must not be."""

import signal
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

from command_lines import BrokenError
from mutations import mutated
from parsers import PARSERS, encoded

from sysid.errors import SysidError

SECONDS = 5.0
"""CPU time after which an input counts as a hang."""


class Hang(BaseException):
    """The input took too long."""


@contextmanager
def _limited() -> Iterator[None]:
    def end(number: int, frame: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def drawn(name: str, seed: int) -> bytes:
    """The input of a parser that belongs to a seed."""
    rng = Random(f"{name} {seed}")
    parser = PARSERS[name]
    return encoded(mutated(rng.choice(_seeds(name)), rng), parser.suffix)


@cache
def _seeds(name: str) -> tuple[Any, ...]:
    return tuple(PARSERS[name].seeds())


def valid(name: str, folder: Path) -> list[str]:
    """What is said against the inputs of a parser that are to be right; empty for nothing."""
    said = []
    for seed in _seeds(name):
        path = folder / f"input{PARSERS[name].suffix}"
        path.write_bytes(encoded(seed, PARSERS[name].suffix))
        try:
            PARSERS[name].read(path)
        except Exception as error:
            said.append(f"{type(error).__name__}: {error}")
    return said


def fault(name: str, content: bytes, folder: Path) -> str:
    """What is wrong with how a parser takes an input: exception and place; empty for nothing."""
    path = folder / f"input{PARSERS[name].suffix}"
    path.write_bytes(content)
    try:
        with _limited(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            PARSERS[name].read(path)
    except SysidError as error:
        text = str(error)
        if len(text) > LONGEST:
            return f"a sentence of {len(text)} letters: {text[:80]}"
    except BrokenError as error:
        lines = [x for x in str(error).splitlines() if 'File "' in x and "/sysid" in x]
        return f"{str(error).splitlines()[-1][:120]} at {lines[-1].strip() if lines else ''}"
    except (Exception, Hang) as error:
        own = [f for f in traceback.extract_tb(error.__traceback__) if "/sysid" in f.filename]
        at = f"{own[-1].filename.rpartition('/sysid')[2]}:{own[-1].lineno}" if own else "?"
        return f"{type(error).__name__} at {at}: {str(error)[:100]}"
    return ""


LONGEST = 3000
"""Letters of a sentence that somebody might still read."""
