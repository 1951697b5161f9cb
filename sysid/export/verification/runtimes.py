"""Runtimes of a plant package: each replays the self-test and reports its error.

A Cortex-M4F is one that qemu-system-arm emulates, with the instructions of a step.
"""

import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib.resources import files as resources
from pathlib import Path
from string import Template
from tempfile import gettempdir

from sysid import processes
from sysid.errors import ModelError
from sysid.launcher import REFUSED
from sysid.plant.storage import Files

SECONDS = 120.0
"""What a compiler or a self-test may take: they take a second, and a program that was tampered with
must not keep us waiting."""

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")

MOST_SAID = 300
"""Letters that are shown of what a program says that fails."""

COUNTED = "instructions"
"""Begins a line with the instructions of a function: its name, mean and most."""

PROGRAMS = {"selftest": "selftest.c", "loop_selftest": "loop_selftest.c"}
"""Self-tests of a package, and the source that makes each."""


@dataclass(frozen=True)
class Result:
    """What a runtime gave.

    Attributes:
        version: of the runtime; empty where it is not there.
        max_error: largest error in parts of the range of its output; None where it did not run.
        passed: whether that is within what the self-test allows.
        skipped: why it did not run; empty where it did.
        failed: why it failed, without a number; empty otherwise.
        instructions: of the step functions, {mean, most} a call, where the runtime counts them.
    """

    name: str
    version: str = ""
    max_error: float | None = None
    passed: bool = False
    skipped: str = ""
    failed: str = ""
    instructions: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Compiled:
    """The C code, by a compiler, on this machine or on one that is emulated.

    Attributes:
        emulator: command that runs what it makes; empty for this machine.
        asks_version: what the last of both is asked for its version.
    """

    name: str
    compiler: str
    emulator: str = ""
    asks_version: str = "-dumpversion"
    folders: tuple[str, ...] = ("c",)

    @cached_property
    def commands(self) -> tuple[str, ...]:
        """What must be installed."""
        return tuple(c for c in (self.compiler, self.emulator) if c)

    def lacks(self) -> str:
        """What is not installed, in a few words; empty where all is there."""
        missing = [c for c in self.commands if shutil.which(c) is None]
        return f"{missing[0]} is not installed" if missing else ""

    def prepare(self, folder: Path, files: Files) -> None:
        """Write what is compiled beside the sources of a package."""

    def build(self, made: str, sources: Sequence[str]) -> list[str]:
        static = ["-static"] if self.emulator else []
        return [self.compiler, *FLAGS, *static, "-o", made, *sources, "-lm"]

    def command(self, made: str) -> list[str]:
        return [*([self.emulator] if self.emulator else []), f"./{made}"]

    def replay(self, folder: Path, files: Files, foreign: bool = False) -> Result:
        """Compile and run both self-tests of a package whose files lie in ``folder``.

        Args:
            foreign: whether somebody else may have written their code.
        """
        lacking = self.lacks()
        if lacking:
            return Result(self.name, skipped=lacking)
        said = run([self.commands[-1], self.asks_version], folder).out.splitlines()
        version = said[0].strip() if said else ""
        if "c/selftest.c" not in files:
            return Result(self.name, version, skipped="the package has no C code")
        self.prepare(folder, files)
        try:
            printed = [
                line
                for program in PROGRAMS
                for line in self._printed(folder / "c", program, files, foreign)
            ]
            errors, instructions = _errors(printed), _instructions(printed)
        except ModelError as error:
            return Result(self.name, version, failed=str(error))
        return Result(self.name, version, max(errors), True, instructions=instructions)

    def _printed(self, c: Path, program: str, files: Files, foreign: bool) -> list[str]:
        """Lines that a self-test prints, none where the package has no such program."""
        if f"c/{PROGRAMS[program]}" not in files:
            return []
        mains = PROGRAMS.values()
        sources = sorted(p.name for p in c.glob("*.c") if p.name not in mains)
        if program == "selftest":
            sources = [s for s in sources if s == "plant.c"]
        made = f"{program}_{self.name}"
        done = run(self.build(made, [PROGRAMS[program], *sources]), c, foreign)
        if done.code:
            raise ModelError(f"{program} does not compile: {_sentence(done.err)}")
        done = run(self.command(made), c, foreign)
        lines = done.out.splitlines()
        if done.code or not lines:
            why = " ".join(f"{done.out} {done.err}".split())[:MOST_SAID]
            raise ModelError(f"{program} fails: {why or 'no answer'}")
        return lines


def _errors(printed: Sequence[str]) -> list[float]:
    """The errors among lines of a self-test: a number, after the name of what it is of."""
    words = [line.split() for line in printed if line.strip()]
    return [_number(t[-1]) for t in words if t[0] not in ("later", COUNTED)]


def _instructions(printed: Sequence[str]) -> dict[str, dict[str, float]]:
    """The instructions of step functions among these lines, the first of each."""
    counts: dict[str, dict[str, float]] = {}
    for word, name, mean, most in (t for t in map(str.split, printed) if len(t) == 4):
        if word == COUNTED:
            counts.setdefault(name, {"mean": _number(mean), "most": _number(most)})
    return counts


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


def _sentence(text: str) -> str:
    """The first line of a compiler that says what is wrong."""
    lines = [line.strip() for line in text.splitlines() if "error" in line]
    return lines[0] if lines else " ".join(text.split())[:200]


def run(command: Sequence[str], folder: Path, foreign: bool = False) -> processes.Ended:
    """Run a command to its end or to :data:`SECONDS`, whichever is first.

    Args:
        foreign: whether it is code of somebody else, which gets no network.

    Raises:
        ModelError: it takes too long, or this system cannot take the network from it.
    """
    try:
        done = processes.run(command, folder, SECONDS, foreign)
    except TimeoutError:
        raise ModelError(f"{command[0]} takes longer than {SECONDS:g} s; it was stopped") from None
    if foreign and done.code == REFUSED:
        raise ModelError("this system cannot take the network from code of somebody else")
    return done


TARGET = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
"""A Cortex-M4 with its unit for single precision; double precision is computed in software."""

_LIBRARY = "rdimon.specs"
"""newlib with semihosting."""

MACHINE = (
    "-M", "mps2-an386", "-cpu", "cortex-m4", "-icount", "shift=0", "-display", "none",
    "-serial", "none", "-monitor", "none", "-semihosting-config", "enable=on,target=native",
)  # fmt: skip
"""An instruction takes a nanosecond, always; what the program prints comes out of qemu."""

FOLDER = "cortex_m"
"""Folder of what is compiled beside a package."""

_STEP = re.compile(r"^void (\w+_step)\(", re.MULTILINE)
_HEADER = re.compile(r"c/\w+\.h")


@dataclass(frozen=True)
class CortexM(Compiled):
    """Compiled with newlib, run by qemu-system-arm, which counts instructions."""

    def lacks(self) -> str:
        missing = super().lacks()
        if missing:
            return missing
        specs = run([self.compiler, f"-print-file-name={_LIBRARY}"], Path(gettempdir()))
        absent = specs.out.strip() == _LIBRARY
        return "newlib for arm-none-eabi is not installed" if absent else ""

    def prepare(self, folder: Path, files: Files) -> None:
        """Start-up, linker script, what counts, and the options that put it around the steps."""
        target = folder / FOLDER
        target.mkdir(exist_ok=True)
        headers = [files[n].decode("utf-8") for n in files if _HEADER.fullmatch(n)]
        steps = sorted({name for text in headers for name in _STEP.findall(text)})
        timed = "".join(f"TIMED({n})\n" for n in steps)
        calls = "\n".join(f'    tell("{n}", &of_{n});' for n in steps)
        for name in ("start.c", "mps2.ld", "timing.c"):
            text = resources(__package__).joinpath("templates", name).read_text(encoding="utf-8")
            if name == "timing.c":
                text = Template(text).substitute(timed=timed, told=calls)
            (target / name).write_text(text, encoding="utf-8")
        (target / "options").write_text(
            "".join(f"-Wl,-wrap={n}\n" for n in ("nothing", *steps)), encoding="utf-8"
        )

    def build(self, made: str, sources: Sequence[str]) -> list[str]:
        """With a start-up of our own: the program is alone on the machine."""
        target = f"../{FOLDER}"
        return [
            self.compiler, *FLAGS, *TARGET, f"-specs={_LIBRARY}", "-nostartfiles",
            "-T", f"{target}/mps2.ld", f"@{target}/options", "-o", made,
            *sources, f"{target}/start.c", f"{target}/timing.c", "-lm",
        ]  # fmt: skip

    def command(self, made: str) -> list[str]:
        return [self.emulator, *MACHINE, "-kernel", made]


CORTEX_M4 = CortexM("cortex-m4", "arm-none-eabi-gcc", "qemu-system-arm", "-version")
