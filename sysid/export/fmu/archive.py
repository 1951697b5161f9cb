"""A unit as one file: description, sources, and a binary for this platform."""

import platform
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from sysid import processes
from sysid.errors import ModelError
from sysid.export.fmu.description import Unit, model_description
from sysid.export.templates import fill
from sysid.plant.storage import zip_bytes

SECONDS = 120.0
"""What a compiler may take: it takes a second."""


@dataclass(frozen=True)
class Version:
    """A version of the standard.

    Attributes:
        number: its own.
        name: of the C file with its functions, and of the template of its description.
        folders: (system, machine) → folder of the binaries.
    """

    number: str
    name: str
    folders: Callable[[str, str], str]


def _folder_2(system: str, machine: str) -> str:
    bits = "64" if sys.maxsize > 2**32 else "32"
    short = {"linux": "linux", "windows": "win", "darwin": "darwin"}.get(system, system)
    return f"{short}{bits}" if machine in ("x86_64", "x86") else f"{machine}-{short}"


FMI_2 = Version("2.0", "fmi2", _folder_2)
FMI_3 = Version("3.0", "fmi3", lambda system, machine: f"{machine}-{system}")


def headers() -> Path:
    """The folder of FMI's headers, which come with FMPy."""
    spec = find_spec("fmpy")
    if spec is None or spec.origin is None:
        raise ModelError(
            "an FMU needs the headers of FMI, which the extra fmu installs: pip install "
            "'sysid-workbench[fmu]'"
        )
    return Path(spec.origin).parent / "c-code"


def archive(unit: Unit, version: Version = FMI_2) -> bytes:
    """The unit as a zip whose bytes depend on its content and the compiler alone."""
    sources = sources_of(unit, version)
    inside = {f"sources/{n}": text.encode("utf-8") for n, text in sources.items()}
    if version is FMI_3:
        inside["sources/buildDescription.xml"] = fill("fmu/buildDescription.xml", unit=unit).encode(
            "utf-8"
        )
    inside["modelDescription.xml"] = model_description(unit, version.name).encode("utf-8")
    binary = compiled(unit, sources, version)
    if binary is not None:
        machine = platform.machine().lower()
        folder = version.folders(platform.system().lower(), _PROCESSORS.get(machine, machine))
        inside[f"binaries/{folder}/{unit.name}{_suffix()}"] = binary
    return zip_bytes(inside)


def sources_of(unit: Unit, version: Version) -> dict[str, str]:
    """All C files and headers of a unit by name."""
    return {
        **unit.sources,
        "fmu_model.h": fill("fmu/model.h", unit=unit),
        "unit.h": fill("fmu/unit.h"),
        f"{version.name}.c": fill(f"fmu/{version.name}.c"),
    }


def compiled(unit: Unit, sources: Mapping[str, str], version: Version) -> bytes | None:
    """The shared library of a unit; None where no compiler is installed."""
    include = headers()
    compiler = next((c for c in ("cc", "gcc", "clang") if shutil.which(c)), None)
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory(prefix="sysid-fmu-") as made:
        folder = Path(made)
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        target = f"{unit.name}{_suffix()}"
        # hidden: functions of two units in one process must not meet
        flags = ["-std=c99", "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-fvisibility=hidden"]
        names = [f"{version.name}.c", *unit.compiled]
        command = [compiler, *flags, f"-I{include}", "-o", target, *names, "-lm"]
        done = processes.run(command, folder, SECONDS)
        if done.code:
            raise ModelError(f"the unit does not compile: {' '.join(done.err.split())[:300]}")
        return (folder / target).read_bytes()


_PROCESSORS = {"amd64": "x86_64", "i386": "x86", "i686": "x86", "arm64": "aarch64"}
"""Processors as FMI 3.0 calls them, where a system calls them otherwise."""


def _suffix() -> str:
    return {"Windows": ".dll", "Darwin": ".dylib"}.get(platform.system(), ".so")
