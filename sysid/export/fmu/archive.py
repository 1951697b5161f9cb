"""A unit as one file: description, sources, and a binary for this platform."""

import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from sysid.errors import ModelError
from sysid.export.fmu.description import Unit
from sysid.plant.storage import zip_bytes

SECONDS = 120.0
"""What a compiler may take: it takes a second."""


def headers() -> Path:
    """The folder of FMI's headers, which come with FMPy.

    Raises:
        ModelError: FMPy is not installed.
    """
    found = find_spec("fmpy")
    if found is None or found.origin is None:
        raise ModelError(
            "a unit needs the headers of FMI, which come with the extra fmu: pip install "
            "'sysid-workbench[fmu]'"
        )
    return Path(found.origin).parent / "c-code"


def archive(unit: Unit, sources: Mapping[str, str]) -> bytes:
    """The unit as a zip whose bytes depend on its content and the compiler alone.

    Args:
        unit: what it says of itself.
        sources: C files and headers by name.

    Raises:
        ModelError: FMPy is not installed, or the compiler refuses the code.
    """
    files = {f"sources/{n}": text.encode("utf-8") for n, text in sources.items()}
    files["modelDescription.xml"] = unit.xml().encode("utf-8")
    binary = compiled(unit, sources)
    if binary is not None:
        files[f"binaries/{_platform()}/{unit.name}{_suffix()}"] = binary
    return zip_bytes(files)


def compiled(unit: Unit, sources: Mapping[str, str]) -> bytes | None:
    """The shared library of a unit; None where no compiler is installed.

    Raises:
        ModelError: FMPy is not installed, or the compiler refuses the code.
    """
    include = headers()
    compiler = next((c for c in ("cc", "gcc", "clang") if shutil.which(c)), None)
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory(prefix="sysid-fmu-") as made:
        folder = Path(made)
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        target = f"{unit.name}{_suffix()}"
        flags = ["-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC", "-fvisibility=default"]
        command = [compiler, *flags, f"-I{include}", "-o", target, *unit.sources, "-lm"]
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=False, timeout=SECONDS
        )
        if done.returncode:
            raise ModelError(f"the unit does not compile: {' '.join(done.stderr.split())[:300]}")
        return (folder / target).read_bytes()


def _platform() -> str:
    """The folder of this platform's binary, as FMI 2.0 calls it."""
    bits = "64" if sys.maxsize > 2**32 else "32"
    system = {"Linux": "linux", "Windows": "win", "Darwin": "darwin"}.get(platform.system(), "")
    if platform.machine().lower() not in ("x86_64", "amd64", "i386", "i686"):
        return f"{platform.machine()}-{system}"
    return f"{system}{bits}"


def _suffix() -> str:
    return {"Windows": ".dll", "Darwin": ".dylib"}.get(platform.system(), ".so")
