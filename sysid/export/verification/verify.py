"""``verify``: the self-test of a package on every installed runtime."""

import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import ModelError
from sysid.export.verification.co_simulated import CoSimulated, replays_of
from sysid.export.verification.cortex_m import CORTEX_M4
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


def verify(path: str | Path) -> Verification:
    """Replay the self-test of a package on every installed runtime.

    Python, gcc, clang, ARM, a Cortex-M4F, which counts instructions, FMPy, libcosim and ROS.

    The C code is compiled and run in a folder of its own, with a limit of time. A package whose
    content was changed after its export is refused before anything of it runs.

    Raises:
        ModelError: there is no package, or it is damaged, tampered with or hostile.
    """
    package = read_package(path)
    files = files_of(path)
    plant = package.plant()
    test = _selftest(plant, files, str(path))
    replays = replays_of(files, plant, test)
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
            place = folder / name
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(content)
        return Verification(str(path), tuple(r.replay(folder, files) for r in runtimes))


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
