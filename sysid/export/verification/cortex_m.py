"""The C code on a Cortex-M4F that qemu-system-arm emulates, with the instructions of a step."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files as resources
from pathlib import Path
from string import Template
from tempfile import gettempdir

from sysid.export.verification.runtimes import FLAGS, Compiled, run
from sysid.plant.storage import Files

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
