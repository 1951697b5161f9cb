"""Units of a package in co-simulation tools, each in its own process."""

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from sysid.data.files import contents
from sysid.errors import ModelError
from sysid.export.fmu.replay import Replay, plant_replay, replay_from
from sysid.export.verification.runtimes import Result, run
from sysid.plant.selftest import TOLERANCE, SelfTest
from sysid.plant.storage import Files
from sysid.structures.plant import Plant

FOLDERS = ("fmu", "fmu3")
"""Where a package has its units: of FMI 2.0, of FMI 3.0."""

UNIT = "fmu/plant.fmu"
"""Where a package has its plant as a unit."""

_UNITS = "sysid.export.verification.units"


def replays_of(files: Files, plant: Plant, test: SelfTest) -> dict[str, Replay]:
    """What each unit of a package must give, by its name in the package."""
    replays = {}
    for name in files:
        folder, _, unit = name.rpartition("/")
        if folder not in FOLDERS or not unit.endswith(".fmu"):
            continue
        if unit == "plant.fmu":
            replays[name] = plant_replay(plant, test)
            continue
        rows = f"{name.removesuffix('.fmu')}.csv"
        if rows not in files:
            raise ModelError(f"the package has {name} and no {rows}: export the plant again")
        replays[name] = replay_from(files[rows].decode("utf-8", "replace"), rows)
    return replays


@dataclass(frozen=True, eq=False)
class CoSimulated:
    """The units of a package, by a tool that runs such units.

    Attributes:
        name: of the tool, and of the package of Python that has it.
        replays: what each unit must give, by its name in the package.
        late: whether it reads outputs one sample late, with the inputs still held.
        folders: those whose units it can run.
    """

    name: str
    replays: Mapping[str, Replay]
    late: bool = False
    folders: tuple[str, ...] = FOLDERS

    def replay(self, folder: Path, files: Files, foreign: bool = False) -> Result:
        """Run every unit; the largest error of all."""
        for module in ("fmpy", self.name.lower()):
            if find_spec(module) is None:
                extra = "pip install 'sysid-workbench[fmu]'"
                return Result(self.name, skipped=f"{module} is not installed: {extra}")
        installed = version(self.name)
        units = [u for u in self.replays if u.partition("/")[0] in self.folders]
        if not units:
            words = "has no FMU" if not self.replays else "has no FMU of a version that it runs"
            return Result(self.name, installed, skipped=f"the package {words}")
        try:
            worst = self._error(folder, units, foreign)
        except ModelError as refused:
            return Result(self.name, installed, failed=str(refused))
        return Result(self.name, installed, worst, worst <= TOLERANCE)

    def _error(self, folder: Path, units: Sequence[str], foreign: bool) -> float:
        """Largest error of units in parts of the range of an output."""
        asked, given = (folder / f"{self.name}-{what}.json" for what in ("cases", "outputs"))
        cases = []
        for unit in units:
            wanted = self.replays[unit]
            names = {"inputs": wanted.inputs, "outputs": wanted.outputs}
            cases.append({"unit": str(folder / unit), **names, "u": wanted.u.tolist()})
        asked.write_text(json.dumps(cases), encoding="utf-8")
        command = [sys.executable, "-m", _UNITS, self.name, str(asked), str(given)]
        done = run(command, folder, foreign)
        tables = json.loads(contents(given)) if given.is_file() else []
        worst = 0.0
        for k, unit in enumerate(units):
            expected = self.replays[unit].late if self.late else self.replays[unit].now
            y = np.array(tables[k] if k < len(tables) else [], dtype=float)
            if y.shape != expected.shape:
                why = done.err.strip().splitlines()[-1:] or ["no answer"]
                raise ModelError(f"{unit} does not run: {why[0]}")
            error = float(np.max(np.abs(y - expected) / self.replays[unit].scale))
            worst = max(worst, error if np.isfinite(error) else float("inf"))
        return worst
