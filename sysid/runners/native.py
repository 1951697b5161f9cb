"""C source to a function that Python calls: compiled once a machine, kept, loaded by ``ctypes``."""

import ctypes
import hashlib
import os
import shutil
import tempfile
from functools import lru_cache
from pathlib import Path

from sysid.processes import run
from sysid.runners.compiled import cache_folder

FLAGS = ("-O2", "-fPIC", "-shared", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off")
"""Two thirds of the speed of ``-O3 -march=native`` at a quarter of its compilation; without
contraction the same numbers on every machine."""

LONGEST = 300.0
"""Seconds that a compilation may take on a machine that does other things, too."""

COMPILERS = ("cc", "gcc", "clang")


@lru_cache(1)
def compiler() -> str | None:
    """The C compiler of this machine: ``$CC``, or one of the usual names; None without one."""
    names = (*filter(None, [os.environ.get("CC")]), *COMPILERS)
    return next((path for name in names if (path := shutil.which(name))), None)


@lru_cache(32)
def library(source: str) -> ctypes.CDLL:
    """The shared library of a C source, compiled where it is not kept from an earlier command.

    It lies in the cache folder under the hash of source, flags and compiler; where that cannot be
    written it is compiled into a folder that goes with the process.

    Raises:
        OSError: there is no compiler, or it does not accept the source.
    """
    cc = compiler()
    if cc is None:
        raise OSError("there is no C compiler (cc) on the path")
    key = hashlib.sha256("\0".join((source, cc, *FLAGS)).encode()).hexdigest()[:24]
    folder = cache_folder()
    if folder is not None and (kept := folder / f"kernel-{key}.so").exists():
        return ctypes.CDLL(str(kept))
    with tempfile.TemporaryDirectory() as made:
        built = Path(made) / "kernel.so"
        (Path(made) / "kernel.c").write_text(source, encoding="utf-8")
        command = [cc, *FLAGS, "-o", str(built), str(Path(made) / "kernel.c"), "-lm"]
        done = run(command, Path(made), LONGEST)
        if done.code:
            raise OSError(f"{cc} does not accept a generated kernel: {done.err.strip()[:300]}")
        if folder is not None and _moved(built, folder / f"kernel-{key}.so"):
            return ctypes.CDLL(str(folder / f"kernel-{key}.so"))
        return ctypes.CDLL(str(built))


def _moved(built: Path, target: Path) -> bool:
    """Whether a file could be put into the cache, whole or not at all."""
    try:
        part = target.with_suffix(f".{os.getpid()}")
        shutil.copyfile(built, part)
        part.replace(target)
    except OSError:
        return False
    return True
