"""The machine in C: compiled once by the system's compiler, kept in the user's cache, called here.

The sources lie beside this file. ``parameters.h`` is written from the dataclasses, so that no field
is declared twice. The library's name holds the hash of all that went into it: a change compiles
anew, and two processes that compile at once make the same file.
"""

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sysid_datasets.physics.parameters import (
    Battery,
    Body,
    Bridge,
    Controller,
    Drive,
    Firmware,
    Friction,
    Gearbox,
    Load,
    Machine,
    Motor,
    Sensor,
    Thermal,
)

Array = NDArray[np.float64]

SOURCES = ("bridge.c", "shaft.c", "ground.c", "run.c")

FLAGS = ("-O3", "-flto", "-fPIC", "-shared", "-fno-math-errno", "-ffp-contract=off")
"""No fused multiplications: the same logs on every processor of a kind."""

MOST_DRIVES = 2


class NoCompilerError(RuntimeError):
    """There is no C compiler, or it does not take the sources; the message says what to do."""


def header() -> str:
    """The C structures of the parameters, every field a double."""
    inner = (Firmware, Bridge, Motor, Friction, Gearbox, Load, Thermal, Sensor)
    text = ["/* Written from parameters.py. */", "#ifndef PARAMETERS_H", "#define PARAMETERS_H"]
    for group in (*inner, Drive, Battery, Body, Controller, Machine):
        text.append("typedef struct {")
        for f in fields(group):
            kind = f.type if isinstance(f.type, type) and is_dataclass(f.type) else None
            if f.name == "drives":
                text.append(f"    Drive drives[{MOST_DRIVES}];")
            else:
                text.append(f"    {kind.__name__ if kind else 'double'} {f.name};")
        text.append(f"}} {group.__name__};")
    return "\n".join([*text, "#endif", ""])


def numbers(part: Any) -> list[float]:
    """All fields of a dataclass in order, those of parts within it in their place.

    Raises:
        ValueError: a field is not a finite number.
    """
    flat: list[float] = []
    for f in fields(part):
        value = getattr(part, f.name)
        if f.name == "drives":
            for drive in (*value, *(Drive(),) * (MOST_DRIVES - len(value))):
                flat += numbers(drive)
        elif is_dataclass(value):
            flat += numbers(value)
        else:
            if not np.isfinite(value):
                raise ValueError(f"{type(part).__name__}.{f.name} is {value}, not a finite number")
            flat.append(float(value))
    return flat


@cache
def library() -> Any:
    """The compiled machine; ``run(machine, run)`` is its one function.

    Raises:
        NoCompilerError: there is none, or it fails.
    """
    folder = files("sysid_datasets.physics")
    texts = {name: (folder / name).read_text(encoding="utf-8") for name in (*SOURCES, "model.h")}
    texts["parameters.h"] = header()
    compiler = _compiler()
    key = hashlib.sha256(repr((sorted(texts.items()), FLAGS, compiler)).encode()).hexdigest()[:16]
    built = _cache_folder() / f"machine-{key}.so"
    if not built.exists():
        _compile(compiler, texts, built)
    loaded = ctypes.CDLL(str(built))
    loaded.run.restype = ctypes.c_int64
    loaded.run.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
    return loaded


def _compiler() -> str:
    for name in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        found = shutil.which(name) if name else None
        if found:
            return found
    raise NoCompilerError(
        "the physics twin is written in C and no compiler was found; install gcc or clang, or name "
        "one in the environment variable CC"
    )


def _cache_folder() -> Path:
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    for folder in (Path(root) / "sysid-physics", Path(tempfile.gettempdir()) / "sysid-physics"):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    raise NoCompilerError("neither the cache nor the temporary folder can be written")


def _compile(compiler: str, texts: dict[str, str], built: Path) -> None:
    with tempfile.TemporaryDirectory(dir=built.parent) as name:
        work = Path(name)
        for file, text in texts.items():
            (work / file).write_text(text, encoding="utf-8")
        call = [compiler, *FLAGS, *SOURCES, "-lm", "-o", "machine.so"]
        done = subprocess.run(call, cwd=work, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            said = (done.stderr.strip().splitlines() or ["no message"])[0]
            raise NoCompilerError(f"{compiler} does not compile the physics twin: {said}")
        (work / "machine.so").replace(built)


class Run(ctypes.Structure):
    """The C structure ``Run`` of run.c."""

    _fields_ = (
        ("step", ctypes.c_double),
        ("steps", ctypes.c_int64),
        ("substeps", ctypes.c_int64),
        ("drives", ctypes.c_int64),
        ("readings", ctypes.c_int64),
        ("read_at", ctypes.c_void_p),
        ("noise", ctypes.c_void_p),
        ("rows", ctypes.c_int64),
        ("row_at", ctypes.c_void_p),
        ("newest", ctypes.c_void_p),
        ("acts_at", ctypes.c_void_p),
        ("command", ctypes.c_void_p),
        ("disturbance", ctypes.c_void_p),
        ("reading", ctypes.c_void_p),
        ("truth", ctypes.c_void_p),
        ("pose", ctypes.c_void_p),
    )


def call(machine: Machine, numbers_of_run: dict[str, Any]) -> None:
    """Run a machine; the arrays of ``numbers_of_run`` are filled in place.

    Raises:
        NoCompilerError: there is no compiler.
        FloatingPointError: the run did not stay finite.
    """
    parameters = np.array(numbers(machine), dtype=np.float64)
    values = {
        k: v.ctypes.data if isinstance(v, np.ndarray) else v for k, v in numbers_of_run.items()
    }
    run = Run(**values)
    failed = library().run(parameters.ctypes.data, ctypes.byref(run))
    if failed:
        at = failed * numbers_of_run["step"]
        raise FloatingPointError(f"the machine left the finite numbers after {at:.4f} s")
