"""Units of FMI through rows of inputs, in a separate process.

Run as ``python -m sysid.export.verification.units TOOL CASES OUTPUTS``: CASES is a JSON list of
{unit: file, inputs, outputs: names of variables, u: rows}, OUTPUTS is written with a table of
values for each. What runs is native code of a package, which must not take that process with it.
"""

import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

Rows = list[list[float]]
Run = Callable[[Path, Sequence[str], Sequence[str], Rows], Rows]


def by_fmpy(unit: Path, inputs: Sequence[str], outputs: Sequence[str], u: Rows) -> Rows:
    """Outputs at the instants of the inputs, by FMPy, in the version of the unit."""
    fmpy = import_module("fmpy")
    about = fmpy.read_model_description(str(unit))
    second = about.fmiVersion.startswith("2")
    slave_class = (
        import_module("fmpy.fmi2").FMU2Slave if second else import_module("fmpy.fmi3").FMU3Slave
    )
    folder = fmpy.extract(str(unit))
    try:
        slave = slave_class(
            guid=about.guid,
            unzipDirectory=folder,
            modelIdentifier=about.coSimulation.modelIdentifier,
            instanceName="verified",
        )
        slave.instantiate()
        if second:
            slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        put, get = (
            (slave.setReal, slave.getReal) if second else (slave.setFloat64, slave.getFloat64)
        )
        references, shown = _references(about, inputs), _references(about, outputs)
        dt, y = float(about.defaultExperiment.stepSize), []
        for k, row in enumerate(u):
            put(references, row)
            y.append([float(v) for v in get(shown)])
            slave.doStep(currentCommunicationPoint=k * dt, communicationStepSize=dt)
        slave.terminate()
        slave.freeInstance()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return y


def by_libcosim(unit: Path, inputs: Sequence[str], outputs: Sequence[str], u: Rows) -> Rows:
    """Outputs one sample after each row of inputs, which is still held, by libcosim."""
    execution_class = import_module("libcosimpy.CosimExecution").CosimExecution
    slave_class = import_module("libcosimpy.CosimSlave").CosimLocalSlave
    manipulator = import_module("libcosimpy.CosimManipulator").CosimManipulator.create_override()
    observer = import_module("libcosimpy.CosimObserver").CosimObserver.create_last_value()
    about = import_module("fmpy").read_model_description(str(unit))
    references, shown = _references(about, inputs), _references(about, outputs)
    step = round(1e9 * float(about.defaultExperiment.stepSize))
    execution = execution_class.from_step_size(step_size=step)
    index = execution.add_local_slave(slave_class(fmu_path=str(unit), instance_name="verified"))
    execution.add_manipulator(manipulator=manipulator)
    execution.add_observer(observer=observer)
    y = []
    for row in u:
        manipulator.slave_real_values(slave_index=index, variable_references=references, values=row)
        execution.step()
        values = observer.last_real_values(slave_index=index, variable_references=shown)
        y.append([float(v) for v in values])
    return y


def _references(about: Any, names: Sequence[str]) -> list[int]:
    """Value references of variables."""
    known = {v.name: v.valueReference for v in about.modelVariables}
    return [known[name] for name in names]


TOOLS: dict[str, Run] = {"FMPy": by_fmpy, "libcosimpy": by_libcosim}


def main(tool: str, asked: str, given: str) -> None:
    """Write the outputs, after every unit anew: what was done stays where the next one fails."""
    tables = []
    with tempfile.TemporaryDirectory(prefix="sysid-unit-") as folder:
        for k, case in enumerate(json.loads(Path(asked).read_text(encoding="utf-8"))):
            copy = Path(folder) / str(k) / Path(case["unit"]).name
            copy.parent.mkdir()
            shutil.copyfile(case["unit"], copy)
            tables.append(TOOLS[tool](copy, case["inputs"], case["outputs"], case["u"]))
            Path(given).write_text(json.dumps(tables), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
