"""Runtimes of a plant package: each replays the self-test and says how far off it was."""

import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from platform import python_version
from typing import Protocol

from sysid.errors import ModelError
from sysid.plant.storage import Files

SECONDS = 120.0
"""What a compiler or a self-test may take: they take a second, and a program that was tampered with
must not keep us waiting."""

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")

PROGRAMS = {"selftest": "selftest.c", "loop_selftest": "loop_selftest.c"}
"""Self-tests of a package, and the source that makes each."""


@dataclass(frozen=True)
class Result:
    """What a runtime gave.

    Attributes:
        name: of the runtime.
        version: of it; empty where it is not there.
        max_error: largest error in parts of the range of its output; None where it did not run.
        passed: whether that is within what the self-test allows.
        skipped: why it did not run; empty where it did.
        failed: why it failed, where there is no number to tell; empty otherwise.
    """

    name: str
    version: str = ""
    max_error: float | None = None
    passed: bool = False
    skipped: str = ""
    failed: str = ""


class Runtime(Protocol):
    """Something that can run a package."""

    @property
    def name(self) -> str: ...

    def replay(self, folder: Path, files: Files) -> Result:
        """Run the self-tests of a package whose files lie in ``folder``."""
        ...


@dataclass(frozen=True)
class Python:
    """This interpreter, by the package's plant.json.

    Attributes:
        error: of the replay, which was made when the package was read.
        allowed: largest error.
    """

    error: float
    allowed: float
    name: str = "python"

    def replay(self, folder: Path, files: Files) -> Result:
        """What reading the package showed."""
        return Result(self.name, python_version(), self.error, self.error <= self.allowed)


@dataclass(frozen=True)
class Compiled:
    """The C code, by a compiler, on this machine or on one that is emulated.

    Attributes:
        name: of the runtime.
        compiler: command.
        emulator: command that runs what it makes; empty for this machine.
        asks_version: what the last of both is asked for its version.
    """

    name: str
    compiler: str
    emulator: str = ""
    asks_version: str = "-dumpversion"

    @cached_property
    def commands(self) -> tuple[str, ...]:
        """What must be installed."""
        return tuple(c for c in (self.compiler, self.emulator) if c)

    def replay(self, folder: Path, files: Files) -> Result:
        """Compile and run both self-tests."""
        missing = [c for c in self.commands if shutil.which(c) is None]
        if missing:
            return Result(self.name, skipped=f"{missing[0]} is not installed")
        version = _first_line([self.commands[-1], self.asks_version], folder)
        if "c/selftest.c" not in files:
            return Result(self.name, version, skipped="the package has no C code")
        c = folder / "c"
        try:
            errors = [e for program in PROGRAMS for e in self._errors(c, program, files)]
        except ModelError as error:
            return Result(self.name, version, failed=str(error))
        return Result(self.name, version, max(errors), True)

    def _errors(self, c: Path, program: str, files: Files) -> Iterator[float]:
        """What a self-test prints.

        Raises:
            ModelError: it does not compile, or fails.
        """
        if f"c/{PROGRAMS[program]}" not in files:
            return
        mains = PROGRAMS.values()
        sources = sorted(p.name for p in c.glob("*.c") if p.name not in mains)
        if program == "selftest":
            sources = [s for s in sources if s == "plant.c"]
        made = f"{program}_{self.name}"
        static = ["-static"] if self.emulator else []
        build = [self.compiler, *FLAGS, *static, "-o", made, PROGRAMS[program], *sources, "-lm"]
        done = _run(build, c)
        if done.returncode:
            raise ModelError(f"{program} does not compile: {_sentence(done.stderr)}")
        done = _run([*([self.emulator] if self.emulator else []), f"./{made}"], c)
        found = [word for line in done.stdout.splitlines() for word in line.split()[-1:]]
        named = [line.split()[0] for line in done.stdout.splitlines() if " " in line]
        errors = [_number(w) for w, n in zip(found, named or [""], strict=False) if n != "later"]
        if done.returncode or not errors:
            raise ModelError(f"{program} fails: {' '.join(done.stdout.split()) or 'no answer'}")
        yield from errors


@dataclass(frozen=True)
class Absent:
    """A runtime for a form that the package does not have.

    Attributes:
        name: of the runtime.
        reason: in a sentence.
    """

    name: str
    reason: str

    def replay(self, folder: Path, files: Files) -> Result:
        """Nothing runs."""
        return Result(self.name, skipped=self.reason)


COMPILED = (
    Compiled("gcc", "gcc"),
    Compiled("clang", "clang"),
    Compiled("qemu-arm", "arm-linux-gnueabihf-gcc", "qemu-arm", "-version"),
)


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise ModelError(f"a self-test prints {word!r} where a number belongs") from None


def _first_line(command: Sequence[str], folder: Path) -> str:
    lines = _run(command, folder).stdout.splitlines()
    return lines[0].strip() if lines else ""


def _sentence(text: str) -> str:
    """The first line of a compiler that says what is wrong."""
    lines = [line.strip() for line in text.splitlines() if "error" in line]
    return lines[0] if lines else " ".join(text.split())[:200]


def _run(command: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command to its end or to :data:`SECONDS`, whichever is first.

    Raises:
        ModelError: it takes too long.
    """
    try:
        return subprocess.run(
            command,
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
            timeout=SECONDS,
            stdin=subprocess.DEVNULL,
            errors="replace",
        )
    except subprocess.TimeoutExpired:
        raise ModelError(f"{command[0]} takes longer than {SECONDS:g} s; it was stopped") from None
