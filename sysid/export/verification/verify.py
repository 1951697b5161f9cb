"""``verify``: the self-test of a package on every installed runtime."""

import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.files import write_new
from sysid.errors import ModelError
from sysid.export.verification.co_simulated import CoSimulated, replays_of
from sysid.export.verification.cortex_m import CORTEX_M4
from sysid.export.verification.rebuilt import Foreign, foreign_code
from sysid.export.verification.ros_nodes import RosNodes
from sysid.export.verification.runtimes import COMPILED, Python, Result, Runtime
from sysid.plant.package import files_of, read_package
from sysid.plant.selftest import NAME, TOLERANCE, SelfTest, read_csv, run
from sysid.plant.storage import Files
from sysid.structures.plant import Plant


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

    Raises:
        ModelError: there is no package, or it is damaged, tampered with or hostile.
    """
    package = read_package(path)
    files = files_of(path)
    plant = package.plant()
    test = _selftest(plant, files, str(path))
    replays = replays_of(files, plant, test)
    foreign = foreign_code(package, files)
    runtimes: tuple[Runtime, ...] = (
        Python(_replayed(plant, test), TOLERANCE),
        *COMPILED,
        CORTEX_M4,
        CoSimulated("FMPy", replays),
        CoSimulated("libcosimpy", replays, late=True, folders=("fmu",)),
        RosNodes(),
    )
    with tempfile.TemporaryDirectory(prefix="sysid-verify-") as made:
        folder = Path(made)
        for name, content in files.items():
            write_new(folder / name, content)
        results = tuple(_result(r, foreign, trust, folder, files) for r in runtimes)
        return Verification(str(path), results)


def _result(
    runtime: Runtime, foreign: Mapping[str, Foreign], trust: bool, folder: Path, files: Files
) -> Result:
    """What a runtime gives; code of somebody else runs only where it is trusted."""
    found = [foreign[f] for f in runtime.folders if f in foreign]
    if not found or trust:
        return runtime.replay(folder, files, foreign=bool(found))
    worst = max(found, key=lambda f: f.sources)
    if worst.sources:
        return Result(runtime.name, failed=worst.words)
    return Result(runtime.name, skipped=worst.words)


def _selftest(plant: Plant, files: Files, where: str) -> SelfTest:
    """The self-test of a package.

    Raises:
        ModelError: it is missing, or damaged.
    """
    if NAME not in files:
        raise ModelError(f"{where} has no {NAME}: export the plant again")
    return read_csv(files[NAME], plant, where)


def _replayed(plant: Plant, test: SelfTest) -> float:
    """Largest error of the plant on its self-test, in parts of the range of its output."""
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.max(np.abs(run(plant, test.u) - test.y), axis=0) / test.scale()
    worst = float(np.max(error))
    return worst if np.isfinite(worst) else float("inf")
