"""``verify``: the self-test of a package on every installed runtime."""

import io
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from platform import python_version
from typing import Any, NamedTuple

import numpy as np

from sysid.data.files import write_new
from sysid.errors import ModelError
from sysid.export.package import form_of, package_files
from sysid.export.verification.co_simulated import CoSimulated, replays_of
from sysid.export.verification.ros_nodes import RosNodes
from sysid.export.verification.runtimes import COMPILED, CORTEX_M4, Compiled, Result
from sysid.plant.package import Package, files_of, read_package
from sysid.plant.selftest import NAME, TOLERANCE, SelfTest, read_csv, run
from sysid.plant.storage import Files
from sysid.structures.plant import Plant
from sysid.version import __version__

FOLDERS = ("c", "fmu", "fmu3", "ros")
"""Folders of a package whose files are code that a runtime takes."""

_BINARIES = "binaries/"
"""Where a unit has what a compiler made, which another compiler makes differently."""


class Foreign(NamedTuple):
    """Why the code of a folder may be of somebody else.

    Attributes:
        sources: whether what is read differs, not just what a compiler made of it.
    """

    words: str
    sources: bool


def foreign_code(package: Package, files: Files) -> dict[str, Foreign]:
    """The folders of a package whose files are not, byte for byte, what this version makes.

    Returns:
        Folder → why its code runs only where it is trusted.
    """
    there = [f for f in FOLDERS if any(n.startswith(f"{f}/") for n in files)]
    return {f: why for f in there if (why := _difference(package, files, f)) is not None}


def _difference(package: Package, files: Files, folder: str) -> Foreign | None:
    advice = "export the plant again, or run it closed off by `trust=True`"
    try:
        made = package_files(
            package.model(),
            name=str(package.description.get("name", "")),
            formats=[folder],
            form=form_of(package.description, package.where),
        )
    except ModelError as error:
        return Foreign(f"{folder}/ cannot be made from plant.json ({error}); {advice}", True)
    mine, given = (
        {n: data.replace(b"\r\n", b"\n") for n, data in f.items() if n.startswith(f"{folder}/")}
        for f in (made, files)  # ends of lines do not count, as in the hash
    )
    names = sorted(n for n in {*mine, *given} if mine.get(n) != given.get(n))
    if not names:
        return None
    if all(_sources(mine.get(n, b"")) == _sources(given.get(n, b"")) for n in names):
        return Foreign(f"the binary in {names[0]} is not built here: `trust=True` runs it", False)
    more = f" (and {len(names) - 1} more)" if len(names) > 1 else ""
    words = f"{names[0]}{more} is not what sysid {__version__} makes of plant.json; {advice}"
    return Foreign(words, True)


def _sources(unit: bytes) -> Mapping[str, bytes] | bytes:
    """What a unit holds beside its binaries; of any other file, its bytes."""
    try:
        with zipfile.ZipFile(io.BytesIO(unit)) as archive:
            names = [n for n in archive.namelist() if not n.startswith(_BINARIES)]
            if sum(archive.getinfo(n).file_size for n in names) > len(unit):
                return unit  # ours are stored; this one unpacks to more
            return {n: archive.read(n) for n in names}
    except (zipfile.BadZipFile, RuntimeError, NotImplementedError, ValueError, EOFError):
        return unit


@dataclass(frozen=True)
class Verification:
    """What every runtime gave."""

    package: str
    results: tuple[Result, ...]

    @property
    def passed(self) -> bool:
        """Whether no installed runtime fails."""
        return all(r.passed for r in self.results if not r.skipped)

    def summary(self) -> dict[str, Any]:
        """{package, passed, runtimes: [{name, version, max_error, passed, skipped, failed,
        instructions}]}."""
        runtimes = [asdict(r) for r in self.results]
        return {"package": self.package, "passed": self.passed, "runtimes": runtimes}


def verify(path: str | Path, trust: bool = False) -> Verification:
    """Replay the self-test of a package on every installed runtime.

    Python, gcc, clang, ARM, a Cortex-M4F, which counts instructions, FMPy, libcosim and ROS.

    Code runs in a folder of its own, with limits of time, memory and files, and only where it is
    what this version makes of plant.json. A package whose content was changed after its export is
    refused before anything of it runs.

    Args:
        trust: run other code too, in processes without network that write in that folder alone.
    """
    package = read_package(path)
    files = files_of(path)
    plant = package.plant()
    if NAME not in files:
        raise ModelError(f"{path} has no {NAME}: export the plant again")
    test = read_csv(files[NAME], plant, str(path))
    replays = replays_of(files, plant, test)
    foreign = foreign_code(package, files)
    runtimes = (
        *COMPILED,
        CORTEX_M4,
        CoSimulated("FMPy", replays),
        CoSimulated("libcosimpy", replays, late=True, folders=("fmu",)),
        RosNodes(),
    )
    error = _replayed(plant, test)
    here = Result("python", python_version(), error, error <= TOLERANCE)
    with tempfile.TemporaryDirectory(prefix="sysid-verify-") as made:
        folder = Path(made)
        for name, content in files.items():
            write_new(folder / name, content)
        others = (_result(r, foreign, trust, folder, files) for r in runtimes)
        return Verification(str(path), (here, *others))


def _result(
    runtime: Compiled | CoSimulated | RosNodes,
    foreign: Mapping[str, Foreign],
    trust: bool,
    folder: Path,
    files: Files,
) -> Result:
    """What a runtime gives; code of somebody else runs only where it is trusted."""
    found = [foreign[f] for f in runtime.folders if f in foreign]
    if not found or trust:
        return runtime.replay(folder, files, foreign=bool(found))
    worst = max(found, key=lambda f: f.sources)
    if worst.sources:
        return Result(runtime.name, failed=worst.words)
    return Result(runtime.name, skipped=worst.words)


def _replayed(plant: Plant, test: SelfTest) -> float:
    """Largest error of the plant on its self-test, in parts of the range of its output."""
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.max(np.abs(run(plant, test.u) - test.y), axis=0) / test.scale()
    worst = float(np.max(error))
    return worst if np.isfinite(worst) else float("inf")
